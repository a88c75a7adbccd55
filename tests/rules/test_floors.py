"""The house has floors: a module imports from floors below its own, and nothing goes round."""

import ast
import graphlib
from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.rules.sources import ROOT, python_files, tree_of

FLOORS = {
    "flight_sw": (
        ("errors", "timing"),
        ("records",),
        ("runtime",),
        ("icd", "estimation", "model", "limits"),
        ("can", "guidance", "modes"),
        ("reception",),
        ("computer", "load_image"),
        ("announcer", "executive"),
        ("boot",),
        ("__main__",),
    ),
    "sim_harness": (
        ("jit", "missions"),
        ("fence",),
        ("mission", "telemetry"),
        ("world", "bus", "replay"),
        ("flight",),
    ),
}
"""From the ground up. What shares a floor knows nothing of each other."""
HOUSES = (*FLOORS, "tools")
SUBPACKAGES_OF_TOOLS = (
    ("gains", "tracks"),
    ("review",),
    ("campaign",),
    ("report", "reproduce"),
    ("commands",),
)


def module_of(path: Path) -> str:
    """The dotted name of a file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in python_files(*HOUSES)}


def imports_of(tree: ast.AST, known: Mapping[str, object]) -> set[str]:
    """Modules of ours that a file imports, at any depth and also for types alone."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.add(whole if whole in known else node.module)
    return found & known.keys()


def graph() -> dict[str, set[str]]:
    """What every module of ours imports."""
    return {
        name: imports_of(tree_of(path), MODULES) - {name} for name, path in sorted(MODULES.items())
    }


def circle_in(imports: Mapping[str, set[str]]) -> list[str]:
    """A circle of imports; empty if there is none."""
    try:
        graphlib.TopologicalSorter(imports).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


def unit_of(module: str) -> str:
    """The part of a house that a module belongs to: its package, or itself if it is loose."""
    return module.split(".")[1] if "." in module else ""


def wrong_steps(house: str, floors: tuple[tuple[str, ...], ...]) -> list[str]:
    """Imports within a house that go up, or across a floor."""
    level = {unit: number for number, floor in enumerate(floors) for unit in floor}
    found = []
    for name, imports in graph().items():
        unit = unit_of(name)
        if name.split(".")[0] != house or unit not in level:
            continue
        for target in imports:
            other = unit_of(target)
            if target.split(".")[0] == house and other in level and other != unit:
                if level[other] >= level[unit]:
                    found.append(f"{name} imports {target}")
    return found


def test_no_import_goes_round() -> None:
    assert circle_in(graph()) == []


@pytest.mark.parametrize("house", FLOORS)
def test_every_module_stands_on_a_floor(house: str) -> None:
    units = {unit_of(name) for name in MODULES if name.split(".")[0] == house} - {""}
    assert units == {unit for floor in FLOORS[house] for unit in floor}


@pytest.mark.parametrize("house", FLOORS)
def test_imports_go_down(house: str) -> None:
    assert wrong_steps(house, FLOORS[house]) == []


def test_imports_between_the_packages_of_tools_go_down() -> None:
    assert wrong_steps("tools", SUBPACKAGES_OF_TOOLS) == []


def test_a_family_of_laws_knows_no_other() -> None:
    for root in ("flight_sw.guidance.", "tools.gains."):
        families = {unit.name for unit in (ROOT / "flight_sw" / "guidance").iterdir()}
        for name, imports in graph().items():
            own = name.removeprefix(root).split(".")[0]
            if not name.startswith(root) or own not in families:
                continue
            theirs = {t.removeprefix(root).split(".")[0] for t in imports if t.startswith(root)}
            assert theirs & families <= {own}, f"{name} imports {sorted(theirs & families)}"


def test_what_is_designed_for_a_family_lies_under_its_name() -> None:
    def packages(folder: Path) -> set[str]:
        return {path.parent.name for path in folder.glob("*/__init__.py")}

    flown = packages(ROOT / "flight_sw" / "guidance")
    assert flown
    assert packages(ROOT / "tools" / "gains") == flown
    assert {p.name for p in (ROOT / "tests" / "flight_sw" / "guidance").iterdir() if p.is_dir()} - {
        "__pycache__"
    } == flown


@pytest.mark.parametrize(
    "source",
    [
        "from a import b",
        "import a.b",
        "from a.b import c",
        "def f():\n    from a.b import c",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from a import b",
    ],
)
def test_every_import_is_seen(source: str) -> None:
    assert imports_of(ast.parse(source), {"a": 0, "a.b": 0}) == {"a.b"}


def test_a_circle_is_seen() -> None:
    assert set(circle_in({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})) == {"a", "b", "c"}
