"""Damaged missions, designs, dispersions, load images and campaigns: a result or one sentence."""

from pathlib import Path

import pytest

from tests.fuzz.children import failures, failures_of_files
from tests.fuzz.text_kinds import NAMES

CASES = Path(__file__).parent / "cases"
DEFAULT, SLOW = 1000, 100_000
SEED = 20_261_130


@pytest.mark.jit_only
@pytest.mark.parametrize("name", NAMES)
def test_damaged_files_are_read_or_refused(name: str) -> None:
    assert failures(f"tests.fuzz.text_kinds:{name}", range(SEED, SEED + DEFAULT)) == []


@pytest.mark.slow
@pytest.mark.jit_only
@pytest.mark.parametrize("name", NAMES)
def test_very_many_damaged_files_are_read_or_refused(name: str) -> None:
    assert failures(f"tests.fuzz.text_kinds:{name}", range(SLOW)) == []


@pytest.mark.jit_only
@pytest.mark.parametrize("name", NAMES)
def test_cases_that_were_found_are_read_or_refused(name: str) -> None:
    kept = sorted((CASES / name.lower()).glob("*"))
    assert failures_of_files(f"tests.fuzz.text_kinds:{name}", kept) == []
