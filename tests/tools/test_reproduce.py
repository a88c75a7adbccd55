"""Papers reproduced: what a row claims, how the verdict counts, and the command from end to end."""

import json
from typing import Any

import pytest
from rich.console import Console

from tools.cli import main
from tools.commands import reproduce as command
from tools.reproduce import mooij
from tools.reproduce.judged import (
    Part,
    Reproduction,
    Row,
    at_least,
    at_most,
    claim,
    close,
    near,
    rms,
    told,
)
from tools.reproduce.show import show


@pytest.mark.parametrize(("here", "holds"), [
    (102.0, True), (98.0, True), (102.1, False), (97.9, False), (float("nan"), False),
])  # fmt: skip
def test_near_is_within_a_share_of_the_papers_number_on_both_sides(
    here: float, holds: bool
) -> None:
    assert near("range", here, 100.0, "km", 0.02 + 1e-12).holds is holds
    assert near("range", here, 100.0, "km", None).holds is None


@pytest.mark.parametrize(("here", "holds"), [(1.25, True), (0.75, True), (1.26, False)])
def test_close_is_within_a_distance(here: float, holds: bool) -> None:
    assert close("load", here, 1.0, "g", 0.25).holds is holds


@pytest.mark.parametrize(("here", "below", "above"), [
    (4.0, True, False), (5.0, True, True), (6.0, False, True),
    (float("nan"), False, False),
])  # fmt: skip
def test_a_bound_is_part_of_what_it_allows_and_no_number_meets_none(
    here: float, below: bool, above: bool
) -> None:
    assert at_most("q", here, 5.0).holds is below
    assert at_least("q", here, 5.0).holds is above


def test_the_deviation_is_that_from_the_paper_not_from_here() -> None:
    assert near("q", 110.0, 100.0, "", None).deviation == "+10.0%"
    assert close("q", 0.5, 1.0, "", 1.0).deviation == "-0.5"
    assert rms([3.0, 4.0]) == pytest.approx(12.5**0.5)


def reproduction(*rows: Row) -> Reproduction:
    """One with these rows in one part."""
    return Reproduction("PAPER", [Part("a table", "chance", list(rows))], quick=False)


def test_the_verdict_counts_judged_rows_alone() -> None:
    some = reproduction(told("a", 1.0), claim("b", True), claim("c", False), claim("d", True))
    assert some.verdict == "2 of 3 hold"
    assert not some.all_hold
    assert reproduction(told("a", 1.0), claim("b", True)).all_hold


def test_the_last_line_is_the_verdict_and_every_row_is_shown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    some = reproduction(told("first", 1234.5, "km", "1,200"), claim("second", False))
    show(some, Console(width=60))
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == "0 of 1 hold"
    assert any("first, km" in line and "1,200" in line and "1,234.5" in line for line in lines)
    assert any("second" in line and "NO" in line for line in lines)
    assert "chance" in lines


def test_no_figure_is_cut_however_narrow_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    quantity = "a quantity with a name as long as those of the longest rows of a batch"
    some = reproduction(near(quantity, 5741.25, 5743.1, "km", 0.025))
    show(some, Console(width=40))
    shown = capsys.readouterr().out
    (line,) = [line for line in shown.splitlines() if quantity in line]
    assert all(text in line for text in ("5,743.1", "5,741.2", "+0.0%", "within 2.5%", "yes"))
    assert "…" not in shown


@pytest.mark.parametrize(("holds", "status"), [(True, 0), (False, 1)])
def test_a_missed_bar_is_exit_status_one(
    holds: bool,
    status: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked: list[Any] = []

    def flown(*, quick: bool, progress: Any) -> Reproduction:
        asked.append(quick)
        return reproduction(claim("it", holds))

    monkeypatch.setattr(mooij, "reproduce", flown)
    assert main(["reproduce", "mooij", "--quick", "--json"]) == status
    told_ = json.loads(capsys.readouterr().out)
    assert (told_["hold"], told_["judged"]) == (int(holds), 1)
    assert main(["reproduce", "mooij"]) == status
    assert capsys.readouterr().out.rstrip().endswith(f"{int(holds)} of 1 hold")
    assert asked == [True, False]
    assert command.app.registered_commands


@pytest.mark.slow
@pytest.mark.share
@pytest.mark.jit_only
def test_a_quick_look_at_mooij_holds(capsys: pytest.CaptureFixture[str]) -> None:
    status = main(["reproduce", "mooij", "--quick", "--json"])
    told_ = json.loads(capsys.readouterr().out)
    assert status == 0, [
        row for part in told_["parts"] for row in part["rows"] if row["holds"] is False
    ]
    assert told_["judged"] >= 55
