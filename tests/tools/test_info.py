"""`aeroshell info` tells what was recorded, and whether all of it is there."""

import json
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from flight_sw.errors import RecordingError
from sim_harness.telemetry.recorder import Recorder
from sim_harness.telemetry.records import LogLevel
from tests.sim_harness.recordings import DBC, DT_S, MANIFEST, drain, one_message
from tools.commands.info import _state, info

TRUTH = np.dtype(
    [("t_s", "f8"), ("alt_m", "f8"), ("heat_flux_wpm2", "f8"), ("heat_flux_max_wpm2", "f8")]
)
MODES = [1] * 20 + [2] * 25 + [3] * 5

TEXT = """\
flight.mcap: complete, 0.98 s of flight
50 CAN frames in 50 minor frames; 10 samples of the truth; SIZE MB; attached aeroshell.dbc

manifest
  mission            test-1
  law                none
  seed               7
  format             2
  telemetry_rate_hz  10.0

outcome
  outcome               end condition
  dropped_frames        0
  dropped_minor_frames  0
  dropped_truth_rows    0
  dropped_log_lines     0

modes
       0.00 s  COAST
       0.40 s  ENTRY
       0.90 s  TERMINAL

events
       0.00 s  INFO     mode COAST
       0.00 s  INFO     guidance phase 0
       0.00 s  INFO     tracking off
       0.00 s  INFO     navigation fix on
       0.40 s  INFO     mode ENTRY, was COAST
       0.50 s  ERROR    actuator stuck
       0.90 s  INFO     mode TERMINAL, was ENTRY

extremes
  peak heat flux                1.702 kW/m2  at      0.50 s
  highest altitude            122.000 km     at      0.00 s
  lowest altitude             121.100 km     at      0.90 s
"""


@pytest.fixture
def flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    t_s = np.arange(50) * DT_S
    truth = np.zeros(50, TRUTH)
    truth["t_s"], truth["alt_m"] = t_s, 122e3 - 1e3 * t_s
    truth["heat_flux_wpm2"] = 1700.0 - 1e3 * np.abs(t_s - 0.5)
    truth["heat_flux_max_wpm2"] = 1702.0  # between two samples
    with Recorder(Path("flight.mcap"), MANIFEST, DBC) as recorder:
        recorder.write_bus(one_message("FSW_STATUS", [{"mode": m, "fix_valid": 1} for m in MODES]))
        recorder.write_truth(truth)
        recorder.log(0.5, LogLevel.ERROR, "actuator stuck")
        drain(recorder)
        recorder.close("end condition")
    return Path("flight.mcap")


def run(*arguments: str) -> Result:
    app = typer.Typer()
    app.command()(info)
    return CliRunner().invoke(app, arguments)


def test_text_has_manifest_modes_events_and_extremes(flight: Path) -> None:
    size = f"{flight.stat().st_size / 1e6:.1f}"
    assert run(str(flight)).stdout == TEXT.replace("SIZE", size)


def test_a_folder_stands_for_the_recording_in_it(flight: Path, tmp_path: Path) -> None:
    assert run(".").stdout == run(str(flight)).stdout
    (tmp_path / "empty").mkdir()
    refused = run("empty")
    assert isinstance(refused.exception, RecordingError)
    assert str(refused.exception) == "empty/flight.mcap: cannot be read, No such file or directory"


def test_json_is_one_object_with_the_same_facts(flight: Path) -> None:
    found = json.loads(run(str(flight), "--json").stdout)
    assert found["is_complete"] and found["is_of_this_dbc"]
    assert found["until_s"] == 0.98
    assert (found["frames"], found["minor_frames"], found["truth_rows"]) == (50, 50, 10)
    assert found["manifest"]["mission"] == "test-1"
    assert found["modes"] == [
        {"t_s": 0.0, "mode": "COAST"},
        {"t_s": 0.4, "mode": "ENTRY"},
        {"t_s": 0.9, "mode": "TERMINAL"},
    ]
    assert found["events"][-2] == {"t_s": 0.5, "level": "ERROR", "text": "actuator stuck"}
    assert found["extremes"][0] == {
        "title": "peak heat flux", "name": "heat_flux_wpm2", "value": 1702.0, "t_s": 0.5,
    }  # fmt: skip


def test_a_cut_recording_says_that_it_is_incomplete_and_until_when(flight: Path) -> None:
    content = flight.read_bytes()
    flight.write_bytes(content[: content.index(b"aeroshell.outcome")])
    shown = run(str(flight)).stdout
    assert shown.startswith(
        "flight.mcap: incomplete, its recorder was cut off; it holds 0.98 s of flight\n"
    )
    assert "\noutcome\n" not in shown
    assert json.loads(run(str(flight), "--json").stdout)["is_complete"] is False


def test_a_spoilt_frame_and_another_dbc_are_told(tmp_path: Path) -> None:
    rows = one_message("FSW_STATUS", [{"mode": 1}] * 3)
    rows["frame"]["data"][1] ^= np.uint64(1 << 33)
    dbc = DBC["aeroshell.dbc"][1].replace(b"Aeroshell: ", b"Older: ")
    with Recorder(tmp_path / "a.mcap", {}, {"aeroshell.dbc": ("text/plain", dbc)}) as recorder:
        recorder.write_bus(rows)
    shown = run(str(tmp_path / "a.mcap")).stdout
    assert "; 1 frames of no known form; read through its own DBC" in shown
    assert "  0.00 s  COAST\n" in shown and "SAFE" not in shown


@pytest.mark.parametrize("into_dbc", [-20, 100])
def test_a_recording_cut_before_its_dbc_tells_its_manifest(tmp_path: Path, into_dbc: int) -> None:
    path = tmp_path / "a.mcap"
    with Recorder(path, MANIFEST, DBC):
        pass
    content = path.read_bytes()
    path.write_bytes(content[: content.index(b"aeroshell.dbc") + into_dbc])
    shown = run(str(path)).stdout
    assert shown.startswith(f"{path}: incomplete, its recorder was cut off; it holds 0.00 s")
    assert "; no DBC is attached, its frames are not decoded\n" in shown
    assert "  mission            test-1\n" in shown


def test_a_guidance_phase_has_the_name_that_its_law_gives_it(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", {"law": "drag-state"}, DBC) as recorder:
        recorder.write_bus(one_message("FSW_STATUS", [{"phase": p} for p in (0, 0, 1, 7)]))
    shown = run(str(tmp_path / "a.mcap")).stdout
    assert "guidance phase waiting\n" in shown
    assert "guidance phase tracking, was waiting\n" in shown
    assert "guidance phase 7, was tracking\n" in shown


@pytest.mark.parametrize(("from_journal_s", "told"), [(0.0, ""), (0.004, ""), (0.01, "0.01 s")])
def test_of_the_journal_is_told_what_two_decimals_show(from_journal_s: float, told: str) -> None:
    found = {"path": "a", "is_complete": False, "until_s": 9.0, "from_journal_s": from_journal_s}
    assert _state(found).partition(", the last ")[2].partition(" in its journal")[0] == told


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t_s\n")
    assert isinstance(run(str(tmp_path / "a.csv")).exception, RecordingError)
