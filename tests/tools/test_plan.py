"""`aeroshell plan`: what it prints, draws and refuses, as a user would call it."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tools.cli import main

pytestmark = pytest.mark.jit_only

Run = tuple[int, str, str]


@pytest.fixture
def plan(capfd: pytest.CaptureFixture[str]) -> Any:
    """Runs the command: exit status, stdout, stderr."""

    def run(*arguments: str) -> Run:
        status = main(["plan", *arguments])
        out, err = capfd.readouterr()
        return status, out, err

    return run


def test_the_shipped_plan_ends_at_its_target(plan: Any) -> None:
    status, out, err = plan("rlv")
    assert (status, err) == (0, "")
    assert re.search(r"converged; ends 0\.\d+ km from the target; \d+ flights ahead", out)
    assert "latitude deg" in out and "final bank deg" in out


def test_json_holds_iterations_knots_and_trajectory(plan: Any) -> None:
    status, out, _ = plan("rlv", "--set", "entry.latitude_deg=15", "--json")
    found = json.loads(out)
    assert status == 0
    assert found["ending"] == "converged"
    errors = [row["target_error"] for row in found["iterations"]]
    assert len(errors) >= 3 and errors == sorted(errors, reverse=True) and errors[-1] < 1.0
    assert len(found["bank_index"]) == len(found["bank_deg"]) == 8
    assert abs(found["latitude_error_deg"]) < 0.01 and abs(found["longitude_error_deg"]) < 0.01
    altitudes = found["trajectory"]["alt_m"]
    assert altitudes[0] == pytest.approx(121_809.0) and altitudes[-1] == pytest.approx(25e3)
    assert found["coast_s"] <= 15.0


def test_a_picture_is_drawn(plan: Any, tmp_path: Path) -> None:
    path = tmp_path / "plan.png"
    assert plan("rlv", "--plot", str(path))[0] == 0
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert path.stat().st_size > 50_000


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["target.longitude_deg=170"], "km from the target"),
        (["limits.heat_flux_max_kwpm2=200"], "km from the target"),
        (["target.latitude_deg=60"], "km from the target"),
    ],
)
def test_a_target_or_a_limit_out_of_reach_is_told_by_how_much(
    plan: Any, settings: list[str], words: str
) -> None:
    status, out, _ = plan("rlv", *(x for s in settings for x in ("--set", s)))
    assert status == 1
    assert words in out
    assert re.search("^(small step|out of iterations|stuck)", out, re.MULTILINE)


@pytest.mark.parametrize(
    ("entry", "target"),
    [
        ({"longitude_deg": 150.0}, {"longitude_deg": -145.3}),  # across the date line
        ({"latitude_deg": 12.0}, {}),  # from the other hemisphere
        ({"heading_deg": 80.0}, {"latitude_deg": 16.0}),  # to the left
        ({"latitude_deg": -3.0, "heading_deg": 80.0}, {"latitude_deg": 13.0}),
    ],
)
def test_a_plan_crosses_the_date_line_and_the_equator_and_turns_either_way(
    plan: Any, entry: dict[str, float], target: dict[str, float]
) -> None:
    settings = [f"entry.{k}={v}" for k, v in entry.items()]
    settings += [f"target.{k}={v}" for k, v in target.items()]
    status, out, _ = plan("rlv", *(x for s in settings for x in ("--set", s)))
    assert status == 0, out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["hyperion-1"], "law 'planned-lqr' is not designed for hyperion-1"),
        (["nowhere"], "is not shipped"),
        (["rlv", "--load", "gains/hyperion-1/lqy.load"], "is made for mission hyperion-1"),
        (["rlv", "--set", "design.plan.given_knots=9"], "given_knots is 9, allowed"),
        (["rlv", "--plot", "/nowhere/x.png"], "--plot /nowhere/x.png: cannot be written"),
    ],
)
def test_what_cannot_be_planned_is_refused_in_a_sentence(
    plan: Any, arguments: list[str], words: str
) -> None:
    status, out, err = plan(*arguments)
    assert status == 1
    assert out == ""
    assert words in err and err.count("\n") == 1
