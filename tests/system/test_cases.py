"""A case from the command line to the review: flown, recorded, told."""

import json
from pathlib import Path
from typing import Any

import pytest

from sim_harness.telemetry.records import RECORDING_NAME
from tools.cli import main
from tools.review.sheet import sheet
from tools.review.source import open_flights

pytestmark = pytest.mark.jit_only

OTHER_PLACES = """
[cases.north]
title = "other places"
entry.latitude_deg = 5.0
[[cases.north.waypoints]]
name = "northern"
longitude_deg = 40.0
latitude_deg = 50.0
"""
SHORT = ("--bus", "memory", "--set", "end.time_max_s=2", "--force")


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str]) -> Any:
    """Runs a command: exit status, stdout, stderr."""

    def command(*arguments: str) -> tuple[int, str, str]:
        status = main([*arguments])
        out, err = capfd.readouterr()
        return status, out, err

    return command


def flown(run: Any, folder: Path, *arguments: str) -> dict[str, Any]:
    status, out, err = run("fly", *arguments, *SHORT, "--json", "--out", str(folder))
    assert status == 0, err
    found: dict[str, Any] = json.loads(out)
    return found


def test_a_case_flies_the_commands_that_set_gives_and_is_told(run: Any, tmp_path: Path) -> None:
    of_case = flown(run, tmp_path / "a", "rlv", "--case", "case-1")
    by_set = flown(run, tmp_path / "b", "rlv", "--set", "entry.latitude_deg=20")
    shipped = flown(run, tmp_path / "c", "rlv")
    assert (of_case["case"], by_set["case"]) == ("case-1", None)
    assert of_case["command_sha256"] == by_set["command_sha256"]
    assert of_case["final_latitude_deg"] == by_set["final_latitude_deg"]
    assert of_case["final_latitude_deg"] != shipped["final_latitude_deg"]
    _, out, _ = run("info", str(tmp_path / "a" / RECORDING_NAME), "--json")
    assert json.loads(out)["manifest"]["case"] == "case-1"


def test_the_review_tells_the_case_and_shows_its_places(run: Any, tmp_path: Path) -> None:
    text = Path("sim_harness/missions/rlv.toml").read_text(encoding="utf-8")
    law, gains = 'law = "planned-lqr"', Path("gains/rlv").resolve()
    own = tmp_path / "own.toml"
    own.write_text(text.replace(law, f'{law}\ngains = "{gains}"') + OTHER_PLACES, encoding="utf-8")
    flown(run, tmp_path / "a", str(own), "--case", "north")
    flight = open_flights([tmp_path / "a" / RECORDING_NAME])[0]
    assert flight.gaps == []
    assert "- case: `north`" in sheet([flight])
    assert [place["name"] for place in flight.tables["waypoints"]] == ["northern"]
    assert flight.tables["entry"]["latitude_deg"] == 5.0


@pytest.mark.parametrize("verb", [
    ("fly", "rlv"), ("plan", "rlv"), ("campaign", "rlv", "--dispersions", "table2", "-n", "1"),
])  # fmt: skip
def test_an_unknown_case_is_refused_in_one_sentence(verb: tuple[str, ...], run: Any) -> None:
    status, out, err = run(*verb, "--case", "case-9")
    assert (status, out) == (1, "")
    assert err.startswith('aeroshell: case "case-9" is not one of rlv, nearest is case-')
    assert "allowed case-1, case-2, case-3, case-4, case-5" in err and err.count("\n") == 1


def test_a_mission_is_shown_with_its_cases(run: Any) -> None:
    _, out, _ = run("missions", "rlv")
    assert "  case-4  latitude -10 deg\n" in out
    _, out, _ = run("missions", "rlv", "--json")
    assert json.loads(out)["cases"]["case-5"] == "latitude -15 deg"
    _, out, _ = run("missions", "hyperion-1")
    assert out.endswith("cases: none\n")


def test_a_campaign_of_a_case_is_known_by_it_and_flown_again(run: Any, tmp_path: Path) -> None:
    folder = tmp_path / "campaign"
    words = ("campaign", "rlv", "--case", "case-2", "--dispersions", "table2", "-n", "2")
    more = ("--set", "end.time_max_s=2", "--no-report", "--out", str(folder))
    assert run(*words, *more)[0] == 0
    manifest = json.loads((folder / "campaign.json").read_text(encoding="utf-8"))
    assert manifest["identity"]["case"] == manifest["job"]["case"] == "case-2"
    assert manifest["fixed"]["entry.latitude_deg"] == 15.0
    assert manifest["title"].endswith("case-2: latitude 15 deg")
    assert "--case case-2" in manifest["command"]
    other = [word.replace("case-2", "case-3") for word in (*words, *more)]
    status, _, err = run(*other)
    assert status == 1 and "case case-2 (asked for: case-3)" in err
    again = ("fly", "--from", str(folder), "--run", "2", "--bus", "memory", "--no-record")
    _, out, _ = run(*again, "--json", "--out", str(tmp_path / "again"))
    assert json.loads(out)["case"] == "case-2"
    status, _, err = run(*again, "--case", "case-2", "--out", str(tmp_path / "more"))
    assert status == 1 and "takes no --case" in err
