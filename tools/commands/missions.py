"""`aeroshell missions`: what is shipped."""

import json
from typing import Annotated

import typer

from flight_sw.runtime.streams import tell


def missions(
    as_json: Annotated[bool, typer.Option("--json", help="print a JSON list")] = False,
) -> None:
    """List the shipped missions; a path of a mission TOML of your own flies as well."""
    from sim_harness.mission.mission import list_missions
    from sim_harness.world.missions import load_mission
    from tools.gains.design import laws_of, read_tree
    from tools.gains.image import DESIGN_NAME

    rows = []
    for shipped in list_missions():
        mission = load_mission(shipped.path)
        design = mission.gains_folder / DESIGN_NAME
        laws = laws_of(read_tree(design), design) if design.is_file() else []
        rows.append({"name": shipped.name, "title": shipped.title, "laws": laws})
    if as_json:
        tell(json.dumps(rows, indent=1))
        return
    width = max(len(row["name"]) for row in rows)
    for row in rows:
        tell(f"{row['name']:<{width}}  {row['title']}  (laws: {', '.join(row['laws'])})")
