"""Damaged recordings, journals and DBC attachments end in what is whole, or in one sentence."""

from pathlib import Path

import pytest

from tests.fuzz.children import failures, failures_of_files

HERE = "tests.fuzz.recordings"
KINDS = ("RECORDINGS", "JOURNALS", "DBCS")
FOUND = Path(__file__).parent / "found"
CASES, FLIGHTS, MANY = 1000, 200, 100_000
CHECKED = {"NUMBA_BOUNDSCHECK": "1"}

pytestmark = pytest.mark.jit_only


@pytest.mark.parametrize("kind", KINDS)
def test_a_thousand_damaged_ones_hurt_nothing(kind: str) -> None:
    assert failures(f"{HERE}:{kind}", range(CASES)) == []


@pytest.mark.parametrize("kind", ["RECORDINGS", "JOURNALS"])
def test_no_kernel_reads_beyond_its_bounds(kind: str) -> None:
    assert failures(f"{HERE}:{kind}", range(CASES, CASES + 300), environment=CHECKED) == []


def test_hundreds_of_damaged_flights_are_replayed_or_refused() -> None:
    assert failures(f"{HERE}:REPLAYS", range(CASES, CASES + FLIGHTS)) == []


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*KINDS, "REPLAYS"])
@pytest.mark.parametrize("environment", [{}, CHECKED], ids=["compiled", "bounds-checked"])
def test_a_hundred_thousand_damaged_ones_hurt_nothing(
    kind: str, environment: dict[str, str]
) -> None:
    found = failures(f"{HERE}:{kind}", range(2 * CASES, 2 * CASES + MANY), environment=environment)
    assert found == []


@pytest.mark.parametrize("folder", sorted(FOUND.glob("*")), ids=lambda path: path.name)
def test_what_once_hurt_does_no_more(folder: Path) -> None:
    kind = f"{HERE}:{folder.name.upper()}"
    assert failures_of_files(kind, sorted(folder.iterdir())) == []
