"""What `aeroshell fly` does when computer, bus or the harness itself goes away in flight."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from sim_harness.bus.hub import Hub
from sim_harness.telemetry.reader import open_recording

pytestmark = [pytest.mark.jit_only, pytest.mark.alone]

ROOT = Path(__file__).parents[2]
WITHIN_S = 1.0  # from the mishap until the program has ended, its files closed
EXIT_S = 0.7  # what the interpreter takes to leave on a busy machine
IN_FLIGHT_BYTES = 300_000  # of the recording: some seconds of flight
START_TIMEOUT_S = 200.0  # of a first run that has to compile


class Flight:
    """`aeroshell fly` as a process, in flight."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.out = folder / "a"
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tools.cli", "fly", "hyperion-1", "--out", "a", *arguments],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        deadline_s = time.monotonic() + START_TIMEOUT_S
        recording = self.out / "flight.mcap"
        while not (recording.exists() and recording.stat().st_size > IN_FLIGHT_BYTES):
            assert self.process.poll() is None, self.process.communicate()
            assert time.monotonic() < deadline_s
            time.sleep(0.01)
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text()
        (self.computer,) = (int(child) for child in children.split())
        self.mishap_s = time.monotonic()

    def end(self) -> str:
        """Wait for its end, which comes in time with status 1; its one sentence."""
        out, err = self.process.communicate(timeout=10.0)
        assert time.monotonic() - self.mishap_s < WITHIN_S + EXIT_S
        assert self.process.returncode == 1
        assert out == ""
        lines = [line for line in err.splitlines() if line.startswith("aeroshell: ")]
        assert lines == err.splitlines()[-1:]
        return lines[0]

    def check_files(self, outcome: str) -> None:
        """The recording is closed and readable, the summary tells the outcome."""
        assert open_recording(self.out / "flight.mcap").is_complete
        summary = json.loads((self.out / "summary.json").read_text())
        assert summary["outcome"] == outcome
        assert summary["minor_frames"] > 0

    def computer_is_gone(self) -> bool:
        """Whether the flight computer has ended, at most a moment later."""
        end_s = time.monotonic() + 3.0
        status = Path(f"/proc/{self.computer}/stat")
        while time.monotonic() < end_s:
            try:
                if status.read_text().rsplit(")", 1)[1].split()[0] == "Z":
                    return True
            except OSError:
                return True
            time.sleep(0.02)
        return False


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Hub]:
    """A bus of its own beside the flight."""
    hub = Hub(tmp_path / "bus")
    hub.start()
    yield hub
    hub.stop()


def test_a_killed_computer_is_told_in_a_sentence(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    os.kill(flight.computer, signal.SIGKILL)
    assert flight.end().startswith("aeroshell: flight computer was killed by signal 9, at ")
    flight.check_files("flight computer silent")


def test_a_computer_that_stops_answering_is_ended(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    os.kill(flight.computer, signal.SIGSTOP)
    assert flight.end().startswith("aeroshell: flight computer did not answer for 0.8 s, at ")
    flight.check_files("flight computer silent")
    assert flight.computer_is_gone()


def test_a_bus_that_vanishes_is_told_in_a_sentence(tmp_path: Path, hub: Hub) -> None:
    address = f"unix:{tmp_path / 'bus'}"
    flight = Flight(tmp_path, "--bus", address)
    hub.stop()
    assert flight.end().startswith(f"aeroshell: bus {address} was lost at ")
    flight.check_files("bus lost")
    assert flight.computer_is_gone()


def test_a_killed_harness_leaves_a_recording_that_says_so_and_no_computer(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    flight.process.kill()
    flight.process.communicate(timeout=10.0)
    assert flight.computer_is_gone()
    recording = open_recording(flight.out / "flight.mcap")
    assert not recording.is_complete
    assert not (flight.out / "summary.json").exists()
