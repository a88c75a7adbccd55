"""Cases of a mission: named sets of other values of its keys, flown with `--case`.

In the file the values stand beside a case's title, under their keys or in tables as the mission has
them; `grouped_cases` gathers them under `keys`, by dotted names, before they are checked.
"""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from flight_sw.errors import MissionError
from sim_harness.mission.documents import quoted
from sim_harness.mission.errors import nearest
from sim_harness.mission.quantities import Meaning, Section, Text

TITLE = "title"


class Case(Section):
    """A named case of the mission: beside its title, any keys of the mission with other values."""

    title: Annotated[str, Text("one line that `aeroshell missions NAME` shows", "a text")]
    keys: Annotated[
        dict[str, Any], Meaning("any key of the mission; tables are merged, lists replaced whole")
    ] = Field(default={})


def _values(table: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Values by dotted key; a list is one value, and so is a table without any."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict) and value:
            found.update(_values(value, f"{prefix}{key}."))
        else:
            found[prefix + key] = value
    return found


def grouped_cases(raw: Any) -> Any:
    """The file's `[cases]` with each case's values under `keys`, by their dotted names."""
    if not isinstance(raw, dict):
        return raw
    cases = {}
    for name, table in raw.items():
        if not isinstance(table, dict):
            cases[name] = table  # refused where the cases are checked
            continue
        title = {k: v for k, v in table.items() if k == TITLE}
        cases[name] = {**title, "keys": _values({k: v for k, v in table.items() if k != TITLE})}
    return cases


def case_of(cases: Mapping[str, Case], name: str, mission: str) -> Case:
    """A mission's case by its name."""
    if name not in cases:
        allowed = f"allowed {', '.join(cases)}" if cases else "its file has no [cases]"
        raise MissionError(
            f"case {quoted(name)} is not one of {mission}{nearest(name, cases)}; {allowed}"
        )
    return cases[name]
