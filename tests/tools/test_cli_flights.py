"""Flights from the command line: what is printed, what is left, what an interruption leaves."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sim_harness.telemetry.reader import open_recording

pytestmark = pytest.mark.jit_only

ROOT = Path(__file__).parents[2]
AEROSHELL = [sys.executable, "-m", "tools.cli"]
KEYS = """mission law bus pace seed outcome flight_time_s heat_load_mjpm2 ground_range_km
heat_flux_max_kwpm2 heat_flux_max_after_activation_kwpm2 load_factor_max_g heat_flux_error_mjpm2
bank_effort_degs minor_frames frames_sent frames_received frames_rejected command_sha256 load_crc32
step_time_us speedup compile_s""".split()


def aeroshell(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """One command in a folder."""
    return subprocess.run(
        [*AEROSHELL, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def test_json_prints_the_summary_and_nothing_else(tmp_path: Path) -> None:
    told = aeroshell(
        tmp_path, "fly", "hyperion-1", "--bus", "memory", "--json", "--no-record", "--out", "a"
    )
    assert told.returncode == 0, told.stderr
    summary = json.loads(told.stdout)
    assert [key for key in KEYS if key not in summary] == []
    assert set(summary["step_time_us"]) == {"p50", "p99", "p999", "max"}
    assert summary == json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["outcome"] == "end condition"
    assert not (tmp_path / "a" / "flight.mcap").exists()


def test_a_bus_flight_leaves_recording_and_summary_and_is_not_overwritten(tmp_path: Path) -> None:
    arguments = ("fly", "hyperion-1", "--set", "time_max_s=20", "--out", "a")
    first = aeroshell(tmp_path, *arguments)
    assert first.returncode == 0, first.stderr
    recording = open_recording(tmp_path / "a" / "flight.mcap")
    assert recording.is_complete
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["minor_frames"] == 1000  # 20 s at 50 Hz
    again = aeroshell(tmp_path, *arguments)
    assert again.returncode == 1
    assert "--force replaces it" in again.stderr
    assert aeroshell(tmp_path, *arguments, "--force").returncode == 0


def test_a_shorter_name_for_each_new_flight(tmp_path: Path) -> None:
    for _ in range(2):
        arguments = ("fly", "hyperion-1", "--bus", "memory", "--no-record")
        assert aeroshell(tmp_path, *arguments, "--set", "time_max_s=1").returncode == 0
    names = sorted(path.name for path in (tmp_path / "runs").iterdir())
    assert names == ["hyperion-1-lqy-001", "hyperion-1-lqy-002"]


def children_of(pid: int) -> list[int]:
    """Processes that a process has started and that still run."""
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(child) for child in found]


def test_ctrl_c_closes_the_files_and_ends_both_processes(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [*AEROSHELL, "fly", "hyperion-1", "--out", "a"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
    )
    recording = tmp_path / "a" / "flight.mcap"
    deadline_s = time.monotonic() + 200.0
    while not (recording.exists() and recording.stat().st_size > 300_000):
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    (computer,) = children_of(process.pid)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=10)
    assert process.returncode == 130
    assert "interrupted" in err
    assert not Path(f"/proc/{computer}").exists()
    assert open_recording(recording).is_complete
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["outcome"] == "interrupted"
    assert summary["minor_frames"] > 0
