"""The dictionaries hold what the code uses: citation keys, and the fields of shared records."""

import re
from pathlib import Path

import pytest

from flight_sw.records import dictionary
from sim_harness.world.records import FLYING, OUTCOMES, PHYSICAL_ENDS
from tests.rules.sources import ROOT, name_of, python_files

REFERENCES = (ROOT / "docs" / "references.md").read_text(encoding="utf-8")
LIMITS = (ROOT / "docs" / "limits.md").read_text(encoding="utf-8")
NOTATION = (ROOT / "docs" / "notation.md").read_text(encoding="utf-8")
OUTCOME_CELLS = 5  # outcome, when, exit, and what is outside the bars

# In brackets and neither an index (`x[ALPHA]`) nor a link: a source.
KEY = re.compile(r"(?<![\w\])])\[([A-Z][A-Z0-9]+(?:-[A-Z0-9]+)*)\](?!\()")
KEYS = {m.group(1) for m in re.finditer(r"^\| \[([A-Z0-9-]+)\] \|", REFERENCES, re.MULTILINE)}
CITING = [
    *python_files("flight_sw", "sim_harness", "tools"),
    *sorted((ROOT / "docs").rglob("*.md")),
]


@pytest.mark.parametrize("path", CITING, ids=name_of)
def test_every_citation_has_an_entry(path: Path) -> None:
    cited = {m.group(1) for m in KEY.finditer(path.read_text(encoding="utf-8"))}
    assert cited <= KEYS, f"{name_of(path)} cites {sorted(cited - KEYS)}, not in docs/references.md"


@pytest.mark.parametrize("record", ["NAV", "GUIDANCE"])
def test_every_shared_field_is_in_the_notation(record: str) -> None:
    dtype = getattr(dictionary, record)
    assert [name for name in dtype.names if f"`{name}`" not in NOTATION] == []


def test_the_table_of_outcomes_tells_the_exit_status_of_each() -> None:
    rows = {
        cells[1].strip(): cells[-2].strip()
        for cells in (line.split("|") for line in LIMITS.splitlines())
        if len(cells) == OUTCOME_CELLS
    }
    for code, outcome in enumerate(OUTCOMES):
        if code != FLYING:
            assert rows[outcome] == ("0" if code in PHYSICAL_ENDS else "1"), outcome


def test_keys_are_found_in_the_table() -> None:
    assert {"MOOIJ18", "US76", "AUTOSAR-E2E", "YANHE"} <= KEYS
