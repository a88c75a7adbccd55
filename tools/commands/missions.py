"""`aeroshell missions`: what is shipped, and what a mission has."""

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flight_sw.runtime.streams import tell

if TYPE_CHECKING:
    from pathlib import Path


def missions(
    mission: Annotated[
        str | None, typer.Argument(help="one of them, or the path of a mission TOML: its cases too")
    ] = None,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="print a JSON list")] = False,
) -> None:
    """List the shipped missions, or show one; a mission TOML of your own flies as well."""
    from sim_harness.mission.mission import find, list_missions

    if mission is not None:
        found = _facts(find(mission))
        tell(json.dumps(found, indent=1)) if as_json else _show(found)
        return
    rows = [_facts(shipped.path) for shipped in list_missions()]
    if as_json:
        tell(json.dumps(rows, indent=1))
        return
    width = max(len(row["name"]) for row in rows)
    for row in rows:
        cases = f"; {len(row['cases'])} cases" if row["cases"] else ""
        tell(f"{row['name']:<{width}}  {row['title']}  (laws: {', '.join(row['laws'])}{cases})")


def _facts(path: "Path") -> dict[str, Any]:
    """What is told of a mission."""
    from sim_harness.world.missions import load_mission
    from tools.gains.design import laws_of, read_tree
    from tools.gains.image import DESIGN_NAME

    mission = load_mission(path)
    design = mission.gains_folder / DESIGN_NAME
    return {
        "name": mission.name,
        "title": mission.title,
        "laws": laws_of(read_tree(design), design) if design.is_file() else [],
        "cases": {name: case.title for name, case in mission.cases.items()},
        "dispersions": list(mission.dispersions),
    }


def _show(found: dict[str, Any]) -> None:
    """One mission: title, laws, cases, dispersion sets."""
    from flight_sw.runtime.echo import echoed

    tell(f"{found['name']}  {echoed(found['title'])}")
    for what in ("laws", "dispersions"):
        tell(f"{what}: {', '.join(map(echoed, found[what])) or 'none'}")
    tell("cases:" if found["cases"] else "cases: none")
    width = max(map(len, found["cases"]), default=0)
    for name, title in found["cases"].items():
        tell(f"  {name:<{width}}  {echoed(title)}")
