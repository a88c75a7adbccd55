"""Numbers that README prints of a command are the command's.

A flight's numbers are compared to their last printed digit. On another processor's C library the
frame in which a tracker is released may be the next one (then the commands are others): what one
minor frame weighs is allowed there, and no more.
"""

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.rules.sources import ROOT
from tools.cli import main
from tools.show import ROWS

pytestmark = pytest.mark.jit_only

README = (ROOT / "README.md").read_text(encoding="utf-8")
RESULT_ROW = re.compile(r"^│ (?P<label>[^│]+?) *│ *(?P<flown>[-\d,.]+) │(?P<rest>.*)$", re.M)
MEASURED = re.compile(r"^\| (1,\d00) \|(.*)\|$", re.M)
NATURAL_PEAK = re.search(r"Natural peak heat flux.*?: (?P<flown>[\d,.]+) kW/m2;.*?```sh\naeroshell "
                         r"(?P<command>.*?)$", README, re.M | re.S)  # fmt: skip
BUS_LOAD = re.search(r"^\| worst-case bus load.*?\| (?P<share>[\d.]+) % \|", README, re.M)
IN_MEMORY = "--bus memory --no-record"
COMMANDS_OF_README = "8b3454f26fbac6a7"  # of the flight whose table README shows
ONE_FRAME_S = 0.02
ONE_FRAME = {  # of hyperion-1: what the metric gains in a frame, at its fastest
    "heat_load_mjpm2": 1.8 * ONE_FRAME_S,
    "ground_range_km": 8.0 * ONE_FRAME_S,
    "heat_flux_max_kwpm2": 30.0 * ONE_FRAME_S,
    "heat_flux_max_after_activation_kwpm2": 30.0 * ONE_FRAME_S,
    "load_factor_max_g": 0.1 * ONE_FRAME_S,
    "heat_flux_error_mjpm2": 0.2 * ONE_FRAME_S,
    "bank_effort_degs": 180.0 * ONE_FRAME_S,
    "flight_time_s": ONE_FRAME_S,
}
Fly = Callable[[str], dict[str, Any]]


def number(text: str) -> float:
    """A number as the pages write it."""
    return float(text.replace(",", ""))


def half_digit(text: str) -> float:
    """Half of a number's last digit."""
    return 0.5 * 10.0 ** -len(text.partition(".")[2])


def assert_shows(text: str, value: float, slack: float = 0.0) -> None:
    """A printed number is the value, rounded; `slack` for another frame of release."""
    assert value == pytest.approx(number(text), rel=0, abs=half_digit(text) * 1.000001 + slack)


@pytest.fixture
def fly(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Fly:
    """A flight in memory by its arguments: the object that it prints."""
    monkeypatch.chdir(tmp_path)

    def flown(arguments: str) -> dict[str, Any]:
        assert main([*shlex.split(arguments), "--json"]) == 0
        return dict(json.loads(capsys.readouterr().out))

    return flown


def slack_of(told: dict[str, Any], key: str) -> float:
    """What the release in another frame may change; nothing where the commands are README's."""
    is_same = told["command_sha256"].startswith(COMMANDS_OF_README)
    return 0.0 if is_same else ONE_FRAME[key]


def test_the_result_that_readme_shows_is_the_one_printed(fly: Fly) -> None:
    told = fly(f"fly hyperion-1 {IN_MEMORY}")
    keys = {label.strip(): key for label, key, _ in ROWS}
    shown = {m["label"].strip(): m for m in RESULT_ROW.finditer(README)}
    assert set(shown) == {label for label, key in keys.items() if told[key] is not None}
    for label, row in shown.items():
        assert_shows(row["flown"], told[keys[label]], slack_of(told, keys[label]))
        if source := re.match(r" *([\d,.]+) │ *([-+][\d.]+)% │", row["rest"]):
            deviation = 100.0 * (told[keys[label]] / number(source[1]) - 1.0)
            assert_shows(source[2], deviation, slack=0.01)


@pytest.mark.parametrize(
    ("row", "law"), list(zip(MEASURED.findall(README), ["nominal"] * 5 + ["lqy"] * 5, strict=True))
)
def test_the_figures_measured_against_the_source_are_those_flown(
    row: tuple[str, str], law: str, fly: Fly
) -> None:
    cells = [cell.strip() for cell in row[1].split("|")]
    told = fly(f"fly hyperion-1 {IN_MEMORY} --law {law} --set heat_flux_max_kwpm2={number(row[0])}")
    for key, (source, shown, percent) in (
        ("heat_load_mjpm2", cells[:3]),
        ("ground_range_km", cells[3:]),
    ):
        assert_shows(shown, told[key], ONE_FRAME[key])
        deviation = 100.0 * (told[key] / number(source) - 1.0)
        assert_shows(percent.removesuffix(" %"), deviation, slack=0.01)


def test_the_natural_peak_is_the_one_flown(fly: Fly) -> None:
    assert NATURAL_PEAK is not None
    assert_shows(NATURAL_PEAK["flown"], fly(NATURAL_PEAK["command"])["heat_flux_max_kwpm2"])


def test_the_worst_case_bus_load_is_the_one_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert BUS_LOAD is not None
    assert main(["bus", "load"]) == 0
    assert f"{BUS_LOAD['share']} % of 1000000 bit/s" in capsys.readouterr().out
