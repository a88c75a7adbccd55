"""A session of tests ends, in any order, and does not pass without the flights that it is about."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests import allowances
from tests.rules.sources import ROOT

TESTS = f"""
import pytest
from tests import allowances

allowances.TIME_LIMIT_S = 0.5


@pytest.mark.parametrize("n", range({{slipped}}))
def test_slips(n):
    pytest.skip("{allowances.SLIPPED} 3 flights: [...]")


def test_is_skipped_for_another_reason():
    pytest.skip("nobody is here")


@pytest.mark.parametrize("n", range({{spinning}}))
def test_spins(n):
    while True:
        pass
"""


def session(folder: Path, *options: str, slipped: int = 0, spinning: int = 0) -> tuple[int, str]:
    """Exit status and output of a session of made-up tests under the rules of ours."""
    path = folder / "test_made_up.py"
    path.write_text(TESTS.format(slipped=slipped, spinning=spinning), encoding="utf-8")
    command = [
        sys.executable, "-m", "pytest", "-p", "tests.conftest", "-p", "no:cacheprovider",
        "-c", str(ROOT / "pyproject.toml"), "--rootdir", str(folder), *options, str(path),
    ]  # fmt: skip
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=200
    )
    return done.returncode, done.stdout


@pytest.mark.parametrize("slipped", [allowances.SLIPPED_MAX, allowances.SLIPPED_MAX + 1])
def test_a_session_that_slips_too_often_fails_and_says_where(tmp_path: Path, slipped: int) -> None:
    status, out = session(tmp_path, slipped=slipped)
    assert (status == 0) == (slipped <= allowances.SLIPPED_MAX)
    listed = out.partition("skipped because the machine slipped")[2]
    assert listed.count("::test_slips[") >= slipped
    assert f"{slipped} skipped, at most {allowances.SLIPPED_MAX}" in listed


def test_a_test_that_spins_is_ended_and_the_others_run(tmp_path: Path) -> None:
    status, out = session(tmp_path, "--order-seed", "5", spinning=2)
    assert status == 1
    assert out.count("took more than 0.5 s") >= 2
    assert "2 failed, 2 skipped" in out


def test_a_seed_gives_an_order_of_its_own_and_always_the_same(tmp_path: Path) -> None:
    def order(*options: str) -> list[str]:
        out = session(tmp_path, *options, "--collect-only", "-q", spinning=9)[1]
        return [line.partition("::")[2] for line in out.splitlines() if "::" in line]

    plain, first, again = order(), order("--order-seed", "1"), order("--order-seed", "1")
    assert len(plain) == 11 and plain != first == again
    assert sorted(plain) == sorted(first)
