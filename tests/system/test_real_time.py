"""Flights against the clock: the commands of a lockstep flight, whoever keeps the time."""

import itertools
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from flight_sw import icd
from sim_harness.flight.bus_flight import BusFlight
from sim_harness.flight.flight import FlightRun
from sim_harness.flight.loop import COMPUTER_SILENT
from sim_harness.flight.pacing import HELD_RATIO
from sim_harness.telemetry.logs import COMMANDS
from sim_harness.world.records import END_CONDITION, TIME_OUT
from tests.rules.sources import ROOT
from tests.system.flights import built, run_of
from tests.system.paced import flown, flown_without_slip, piece
from tools.cli import main

pytestmark = [pytest.mark.jit_only, pytest.mark.alone]

PIECE_S = 4.0
STOPPED_S = 0.2
KILL_AT_S = 1.0
END_WITHIN_S = 1.0
TIMEOUT_S = 120


@pytest.fixture(scope="module")
def quiet_sha256(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Identity of the piece's commands, flown in memory."""
    return flown(piece(PIECE_S), tmp_path_factory.mktemp("memory"), "memory").command_sha256


@pytest.mark.parametrize(
    "plan",
    [
        {},
        {"pace": 1.0},
        {"pace": 10.0},
        {"pace": 0.5},
        {"pace": 5.0, "synchronisation": "clock"},
        {"pace": 1.0, "synchronisation": "clock"},
    ],
    ids=lambda plan: "-".join(f"{value}" for value in plan.values()) or "lockstep",
)
def test_commands_are_those_of_a_flight_in_memory(
    plan: dict[str, float | str], quiet_sha256: str, tmp_path: Path
) -> None:
    run = flown_without_slip(piece(PIECE_S), tmp_path, **plan)
    assert run.outcome == TIME_OUT
    assert run.command_sha256 == quiet_sha256


ANNOUNCEMENTS = [icd.layout(name).can_id for name in ("FSW_BOOT", "FSW_LOAD", "HARNESS_PRESENT")]


def test_a_recorded_flight_loses_no_frame_and_no_cycle(tmp_path: Path) -> None:
    sizes: list[int] = []

    class Listener:
        def rows(self, bus, truth) -> None:  # type: ignore[no-untyped-def]
            if len(bus):
                early = np.isin(bus["frame"]["can_id"], ANNOUNCEMENTS) & (bus["t_s"] == 0.0)
                sizes.append(int(np.sum(~early)))
                cycles.append((float(bus["t_s"][0]), float(bus["t_s"][-1])))

        def progress(self, run: FlightRun) -> None: ...

        def waiting(self, text: str) -> None: ...

        def warn(self, t_s: float, text: str) -> None: ...

    cycles: list[tuple[float, float]] = []
    run = run_of(piece(PIECE_S), tmp_path / "piece.load", "unix", pace=4.0)
    run.listeners.append(Listener())
    with ExitStack() as resources:
        BusFlight(run, resources).fly()
    port = run.harness["port"][0]
    logged = int(port["frames_sent"]) + int(port["frames_received"])
    assert int(run.harness["bus_rows_lost"][0]) == 0
    assert abs(sum(sizes) - logged) <= 20  # beside them: what was said before the flight
    in_flight = [span for span in cycles if span[1] > 0.0]
    shared = [a for a, b in itertools.pairwise(in_flight) if b[0] <= a[1]]
    assert len(in_flight) > 5
    assert len(shared) <= 1  # the end of the flight has the time of its last frame


class Interfered:
    """A flight in real time, and what is done to its flight computer while it flies."""

    def __init__(self, run: FlightRun) -> None:
        self.run = run
        self.done_s = 0.0
        self.failure = ""

    def _signal(self, pid: int, at_s: float, signals: list[tuple[int, float]]) -> None:
        while float(self.run.harness["truth"]["t_s"][0]) < at_s:
            time.sleep(0.001)
        for number, pause_s in signals:
            os.kill(pid, number)
            self.done_s = time.monotonic()
            time.sleep(pause_s)

    def fly(self, at_s: float, signals: list[tuple[int, float]]) -> float:
        """Fly to the end; seconds from the last signal to it."""
        with ExitStack() as resources:
            flight = BusFlight(self.run, resources)
            assert flight.computer is not None
            arguments = (flight.computer.pid, at_s, signals)
            thread = threading.Thread(target=self._signal, args=arguments, daemon=True)
            thread.start()
            flight.fly()
            ended_s = time.monotonic()
            self.failure = flight.failure()
            thread.join(1.0)
        return ended_s - self.done_s


def test_late_commands_are_counted_and_the_last_one_is_flown(tmp_path: Path) -> None:
    run = run_of(piece(PIECE_S), tmp_path / "piece.load", "unix", pace=1.0, recorded=False)
    flight = Interfered(run)
    flight.fly(1.0, [(signal.SIGSTOP, STOPPED_S), (signal.SIGCONT, 0.0)])
    assert run.outcome == TIME_OUT
    assert not flight.failure
    late, frames = int(run.pacer["late_commands"][0]), int(run.pacer["frames"][0])
    assert frames == PIECE_S * 50
    assert late >= STOPPED_S * 50 - 1
    assert int(run.harness["written"][0][COMMANDS]) == frames - late
    assert run.computer["slips"] >= STOPPED_S * 50 - 2
    assert int(run.harness["port"]["stale_answers"][0]) >= late - run.computer["ticks"] - 1


@pytest.mark.parametrize("pace", [1.0, 4.0])
def test_a_killed_flight_computer_ends_the_flight_within_a_second(
    pace: float, tmp_path: Path
) -> None:
    run = run_of(piece(30.0), tmp_path / "piece.load", "unix", pace=pace, recorded=False)
    flight = Interfered(run)
    took_s = flight.fly(KILL_AT_S, [(signal.SIGKILL, 0.0)])
    assert run.outcome == COMPUTER_SILENT
    assert took_s < END_WITHIN_S
    assert "was killed by signal 9" in flight.failure


def test_a_pace_that_cannot_be_held_says_what_was_reached(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    settings = ["--set", "guidance.rate_hz=500", "--set", "time_max_s=10"]
    status = main(["fly", "hyperion-1", "--pace", "1000x", *settings, "--out", str(tmp_path)])
    told = capfd.readouterr()
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert status == 0
    assert summary["pace_held"] is False
    assert 0.0 < summary["pace_reached"] < 1000.0 * HELD_RATIO  # 2 us a frame: none can
    assert summary["timing"]["harness"]["harness_slips"] > 0
    assert "pace 1000x not held" in told.out
    assert "late: " in told.err


@pytest.mark.parametrize(
    "pace", ["fast", "0x", "-1x", "nan", "nanx", "infx", "1001x", "10", "x", "1e9x", "", "0.001x"]
)
def test_a_pace_that_makes_no_sense_is_refused(
    pace: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["fly", "hyperion-1", "--pace", pace, "--out", str(tmp_path / "x")]) == 1
    told = capfd.readouterr()
    assert told.err.count("\n") == 1
    assert f"--pace {pace}: allowed are lockstep, realtime, or 0.01x to 1000x" in told.err
    assert not (tmp_path / "x").exists()


def without_privileges() -> None:
    """Take from a process to be what would let it be punctual."""
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))


def test_missing_privileges_are_said_in_one_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tools.cli", "fly", "hyperion-1", "--pace", "10x"]
    if os.geteuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("root keeps its privileges where setpriv is not installed")
        taken = "-sys_nice,-ipc_lock,-sys_resource"
        command = ["setpriv", f"--bounding-set={taken}", f"--inh-caps={taken}", *command]
    done = subprocess.run(
        [*command, "--set", "time_max_s=5", "--out", str(tmp_path / "flight")],
        cwd=ROOT, preexec_fn=without_privileges, capture_output=True, text=True,
        timeout=TIMEOUT_S, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if "not as punctual" in line]
    assert len(lines) == 1
    assert "ulimit -l unlimited" in lines[0]
    assert "ulimit -r 50" in lines[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "synchronisation", [pytest.param("frame", marks=pytest.mark.share), "clock"]
)
def test_a_minute_in_real_time_misses_no_deadline(synchronisation: str, tmp_path: Path) -> None:
    made = piece(60.0)
    run = flown_without_slip(made, tmp_path, pace=1.0, synchronisation=synchronisation)
    assert run.punctuality["pace_held"]
    assert run.command_sha256 == flown(made, tmp_path, "memory").command_sha256


@pytest.mark.slow
def test_a_whole_entry_in_real_time_misses_no_deadline(tmp_path: Path) -> None:
    made = built("lqy")
    run = flown_without_slip(made, tmp_path, pace=1.0)
    assert run.outcome == END_CONDITION
    assert run.punctuality["pace_held"]
    assert run.command_sha256 == flown(made, tmp_path, "memory").command_sha256
