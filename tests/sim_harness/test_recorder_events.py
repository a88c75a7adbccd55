"""The log of a recording tells what the flight computer reported, at the minor frame it did."""

from pathlib import Path
from string import Formatter

import numpy as np
import pytest

from flight_sw import icd
from sim_harness.telemetry.events import OF_LAWS
from sim_harness.telemetry.reader import open_recording
from sim_harness.telemetry.recorder import Recorder
from sim_harness.telemetry.records import LogLevel, LogLine
from tests.sim_harness.recordings import DBC, DT_S, drain, one_message

INFO, WARNING = LogLevel.INFO, LogLevel.WARNING


def log_of(path: Path, rows: np.ndarray, step: int) -> list[tuple[int, LogLevel, str]]:
    """Minor frame, level and text of what is logged."""
    with Recorder(path, {}, DBC) as recorder:
        for start in range(0, len(rows), step):
            recorder.write_bus(rows[start : start + step])
            drain(recorder)
    lines: list[LogLine] = open_recording(path).log
    return [(round(line.t_s / DT_S), line.level, line.text) for line in lines]


@pytest.mark.parametrize("step", [1, 3, 100])
def test_each_change_of_mode_is_logged_once(tmp_path: Path, step: int) -> None:
    modes = [0, 1, 1, 1, 2, 2, 4, 4, 1, 2, 3]
    values = [{"mode": mode, "fix_valid": mode != 4} for mode in modes]
    assert log_of(tmp_path / "a.mcap", one_message("FSW_STATUS", values), step) == [
        (0, INFO, "mode STANDBY"),
        (0, INFO, "guidance phase 0"),
        (0, INFO, "tracking off"),
        (0, INFO, "navigation fix on"),
        (1, INFO, "mode COAST, was STANDBY"),
        (4, INFO, "mode ENTRY, was COAST"),
        (6, WARNING, "mode SAFE, was ENTRY"),
        (6, WARNING, "navigation fix off, was on"),
        (8, INFO, "mode COAST, was SAFE"),
        (8, INFO, "navigation fix on, was off"),
        (9, INFO, "mode ENTRY, was COAST"),
        (10, INFO, "mode TERMINAL, was ENTRY"),
    ]


NAMED = {"computer": 1, "harness": 1}


def test_every_request_of_the_ground_is_an_event(tmp_path: Path) -> None:
    rows = one_message("GROUND_REQUEST", [{"request": n, **NAMED} for n in (1, 1, 2)])
    assert log_of(tmp_path / "a.mcap", rows, 1) == [
        (0, INFO, "ground request ARM"),
        (1, INFO, "ground request ARM"),
        (2, INFO, "ground request STOP"),
    ]


@pytest.mark.parametrize("step", [1, 100])
def test_each_doubt_that_ended_in_belief_is_a_warning_and_none_is_no_event(
    tmp_path: Path, step: int
) -> None:
    counts = [0, 0, 1, 1, 3]
    rows = one_message("RX_HEALTH_A", [{"candidates_believed": n} for n in counts])
    assert log_of(tmp_path / "a.mcap", rows, step) == [
        (2, WARNING, "doubted navigation believed 1, was 0"),
        (4, WARNING, "doubted navigation believed 3, was 1"),
    ]


def test_a_spoilt_report_is_no_event(tmp_path: Path) -> None:
    rows = one_message("FSW_STATUS", [{"mode": 1}, {"mode": 4}, {"mode": 1}])
    rows["frame"]["data"][1] ^= np.uint64(1 << 60)
    told = log_of(tmp_path / "a.mcap", rows, 1)
    assert [text for _, _, text in told if text.startswith("mode")] == ["mode COAST"]


def test_a_plan_s_stages_are_events_with_how_it_ended(tmp_path: Path) -> None:
    """What the law `planned-lqr` says of its telemetry, by the words of the DBC."""
    seeking = {"plan_stage": 1}
    in_force = {"plan_stage": 3, "plan_ending": 1, "plan_source": 1, "plan_flights": 5}
    failed = {"plan_stage": 4, "plan_ending": 3, "plan_flights": 41}
    rows = one_message("TM_PLAN_D", [seeking, seeking, in_force, in_force, failed])
    assert log_of(tmp_path / "a.mcap", rows, 2) == [
        (0, INFO, "plan seeking"),
        (2, INFO, "plan in force, was seeking: converged after 5 flights ahead, source onboard"),
        (4, WARNING, "plan failed, was in force: out of iterations after 41 flights ahead, "
         "source load"),
    ]  # fmt: skip


def test_what_a_law_tells_with_an_event_is_in_the_same_message() -> None:
    for name, event in OF_LAWS.items():
        (message,) = (m for m in icd.LAYOUT if name in {s.name for s in m.signals})
        told = {field for _, field, _, _ in Formatter().parse(event.told) if field}
        assert told <= {signal.name for signal in message.signals}
