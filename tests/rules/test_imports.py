"""Imports go one way: the flight software knows nothing of the ground, the harness no tools."""

import ast
from pathlib import Path

import pytest

from tests.rules.sources import FLIGHT, HARNESS, name_of, python_files, tree_of

GROUND = {
    "sim_harness", "tools", "tests", "can", "control", "matplotlib",
    "scipy", "pydantic", "typer", "rich", "mcap",
}  # fmt: skip
BANNED = {FLIGHT: GROUND, HARNESS: {"tools", "tests"}}
ICD_READER = "cantools"  # parses the DBC at boot, in the one place below
ICD = FLIGHT / "icd"


def imported_packages(tree: ast.AST) -> set[str]:
    """First names of all absolute imports, also those inside functions and by name."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found.add(node.module)
        elif isinstance(node, ast.Call) and node.args:
            called = ast.unparse(node.func)
            named = node.args[0]
            if called.endswith(("import_module", "__import__")) and isinstance(named, ast.Constant):
                found.add(str(named.value))
    return {name.split(".")[0] for name in found}


def banned_for(path: Path) -> set[str]:
    """What this file must not import."""
    banned = next(names for folder, names in BANNED.items() if folder in path.parents)
    if FLIGHT in path.parents and ICD not in path.parents:
        return banned | {ICD_READER}
    return banned


@pytest.mark.parametrize("path", python_files("flight_sw", "sim_harness"), ids=name_of)
def test_imports_go_one_way(path: Path) -> None:
    wrong = imported_packages(tree_of(path)) & banned_for(path)
    assert not wrong, f"{name_of(path)} imports {sorted(wrong)}"


@pytest.mark.parametrize(
    "source",
    [
        "import sim_harness.world.vehicle",
        "from sim_harness.world import planet",
        "def f():\n    import sim_harness",
        "import importlib\nimportlib.import_module('sim_harness.bus')",
        "__import__('sim_harness')",
    ],
)
def test_every_way_to_import_is_seen(source: str) -> None:
    assert "sim_harness" in imported_packages(ast.parse(source))


def test_own_subpackages_are_not_taken_for_the_ground() -> None:
    source = "from . import can\nfrom .can import e2e\nfrom flight_sw.can import codec"
    assert imported_packages(ast.parse(source)) == {"flight_sw"}
