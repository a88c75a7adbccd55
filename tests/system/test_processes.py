"""Two processes and a bus, and what happens when one of the three goes away in flight."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from flight_sw import modes
from flight_sw.errors import AeroshellError, FlightError
from sim_harness.bus.hub import Hub
from sim_harness.flight import bus_flight
from sim_harness.flight.bus_flight import BusFlight, fly_bus
from sim_harness.flight.computer_process import ComputerProcess
from sim_harness.flight.flight import FlightRun
from tests.system.flights import ROOT, built, run_of
from tests.system.paced import piece

pytestmark = pytest.mark.jit_only

WITHIN_S = 1.0  # from the mishap to the end of the harness's flight, everything closed
START_TIMEOUT_S = 60.0  # of a computer that may have to compile first
GONE_TIMEOUT_S = 3.0


class Saboteur:
    """Does something once the flight has begun, and notes when."""

    def __init__(self, action: Callable[[], None]) -> None:
        self.action, self.at_s = action, 0.0

    def progress(self, harness: Any) -> None:
        """After the first chunk."""
        if not self.at_s:
            self.at_s = time.monotonic()
            self.action()

    def rows(self, bus: Any, truth: Any) -> None:
        """Takes nothing."""

    def waiting(self, text: str) -> None:
        """Waits in silence."""


def is_gone(pid: int) -> bool:
    """Whether a process has ended, reaped or not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def wait_gone(pid: int, timeout_s: float = GONE_TIMEOUT_S) -> bool:
    """Whether a process ends in time."""
    end_s = time.monotonic() + timeout_s
    while not is_gone(pid) and time.monotonic() < end_s:
        time.sleep(0.02)
    return is_gone(pid)


def open_files() -> int:
    """File descriptors of this process."""
    return len(os.listdir("/proc/self/fd"))


@pytest.fixture
def nothing_left() -> Iterator[None]:
    """No thread, descriptor or child outlives a flight."""
    before = open_files(), threading.active_count()
    yield
    assert (open_files(), threading.active_count()) == before
    with contextlib.suppress(ChildProcessError):
        assert os.waitpid(-1, os.WNOHANG) == (0, 0)


class WatchedFlight(BusFlight):
    """A bus flight that the test can reach from outside."""

    latest: "WatchedFlight"

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        WatchedFlight.latest = self
        self.pid = self.computer.pid if self.computer is not None else 0


class Mishap:
    """A flight over a bus during which something happens; what came of it."""

    def __init__(self, run: FlightRun, action: Callable[[WatchedFlight], None]) -> None:
        saboteur = Saboteur(lambda: action(WatchedFlight.latest))
        run.listeners.append(saboteur)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(bus_flight, "BusFlight", WatchedFlight)
            self.sentence = fly_bus(run)
        self.took_s = time.monotonic() - saboteur.at_s
        self.pid = WatchedFlight.latest.pid


@pytest.fixture
def run(tmp_path: Path) -> FlightRun:
    """A flight of a minute over a hub of its own."""
    return run_of(built("lqy", "minute"), tmp_path / "lqy.load", "unix", recorded=False)


@pytest.mark.alone
def test_a_killed_computer_ends_the_flight(run: FlightRun, nothing_left: None) -> None:
    mishap = Mishap(run, lambda flight: os.kill(flight.pid, signal.SIGKILL))
    assert mishap.sentence.startswith("flight computer was killed by signal 9, at ")
    assert mishap.sentence.endswith(" s of flight")
    assert run.outcome_text == "flight computer silent"
    assert mishap.took_s < WITHIN_S
    assert is_gone(mishap.pid)


@pytest.mark.alone
def test_a_stopped_computer_ends_the_flight(run: FlightRun, nothing_left: None) -> None:
    mishap = Mishap(run, lambda flight: os.kill(flight.pid, signal.SIGSTOP))
    assert mishap.sentence.startswith("flight computer did not answer for 0.8 s, at ")
    assert mishap.took_s < WITHIN_S
    assert is_gone(mishap.pid)


@pytest.mark.alone
def test_a_computer_asked_to_end_ends_the_flight(run: FlightRun, nothing_left: None) -> None:
    mishap = Mishap(run, lambda flight: os.kill(flight.pid, signal.SIGTERM))
    assert mishap.sentence.startswith("flight computer ended with status 0, at ")
    assert mishap.took_s < WITHIN_S


@pytest.mark.alone
def test_a_bus_that_goes_away_ends_the_flight(tmp_path: Path, nothing_left: None) -> None:
    hub = Hub(tmp_path / "bus")
    hub.start()
    address = f"unix:{tmp_path / 'bus'}"
    run = run_of(built("lqy", "minute"), tmp_path / "lqy.load", address, recorded=False)
    mishap = Mishap(run, lambda _: hub.stop())
    assert mishap.sentence.startswith(f"bus {address} was lost at ")
    assert run.outcome_text == "bus lost"
    assert mishap.took_s < WITHIN_S
    assert is_gone(mishap.pid)


def test_an_undisturbed_flight_leaves_nothing_behind(run: FlightRun, nothing_left: None) -> None:
    assert fly_bus(run) == ""
    assert run.outcome_text == "time out"
    assert run.computer["tx_refused"] == 0


def test_a_computer_that_refuses_its_load_is_quoted(run: FlightRun, nothing_left: None) -> None:
    raw = bytearray(run.plan.load_path.read_bytes())
    raw[-1] ^= 1
    run.plan.load_path.write_bytes(raw)
    with pytest.raises(FlightError, match=r"^flight computer ended with status 1: .*crc32 is 0x"):
        fly_bus(run)


def own_hub_run(tmp_path: Path, law: str = "lqy") -> FlightRun:
    """A flight that expects its computer on a bus that is there already."""
    address = f"unix:{tmp_path / 'bus'}"
    made = built(law, "minute")
    return run_of(made, tmp_path / f"{law}.load", address, recorded=False, own_computer=False)


def test_a_bus_without_a_computer_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, nothing_left: None
) -> None:
    monkeypatch.setattr(bus_flight, "SIGN_OF_LIFE_S", 0.5)
    with Hub(tmp_path / "bus"):
        run = own_hub_run(tmp_path)
        words = f"no flight computer with load 0x{run.image.crc32:08x} announced itself on unix:"
        with pytest.raises(FlightError, match=words):
            fly_bus(run)


def test_a_computer_with_another_load_is_not_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, nothing_left: None
) -> None:
    monkeypatch.setattr(bus_flight, "SIGN_OF_LIFE_S", 3.0)
    other = tmp_path / "nominal.load"
    other.write_bytes(built("nominal", "minute").raw)
    address = f"unix:{tmp_path / 'bus'}"
    with Hub(tmp_path / "bus"), ComputerProcess(other, address, [], print):
        with pytest.raises(FlightError, match="no flight computer with load 0x"):
            fly_bus(own_hub_run(tmp_path))


def test_a_computer_started_by_hand_is_flown(tmp_path: Path, nothing_left: None) -> None:
    address = f"unix:{tmp_path / 'bus'}"
    with Hub(tmp_path / "bus"):
        run = own_hub_run(tmp_path)
        with ComputerProcess(run.plan.load_path, address, [], print) as computer:
            assert fly_bus(run) == ""
            assert run.outcome_text == "time out"
            assert wait_gone(computer.pid)  # by the stop request
            assert computer.status == 0
            assert computer.report()["cycles"] == run.harness["truth"]["minor_frames"][0]


@pytest.mark.parametrize("pace", [0.0, 2.0])
def test_a_computer_that_missed_its_arming_is_armed_again(
    pace: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, nothing_left: None
) -> None:
    run = run_of(piece(2.0), tmp_path / "x.load", "unix", pace=pace)
    kept: list[bytes] = []
    monkeypatch.setattr(BusFlight, "_send", lambda _, frames: kept.append(frames.tobytes()))
    monkeypatch.setattr(BusFlight, "_see_it_end", lambda *_: None)
    assert fly_bus(run) == ""
    assert len(kept) >= 1  # the request that was lost
    assert run.harness["port"]["mode"][0] == modes.ENTRY


@pytest.mark.parametrize("how", ["vanished", "no socket", "too long"])
def test_a_bus_that_is_not_there_is_named(how: str, tmp_path: Path, nothing_left: None) -> None:
    path = tmp_path / ("x" * 120 if how == "too long" else "bus")
    if how == "no socket":
        path.write_text("")
    run = run_of(built("lqy", "minute"), tmp_path / "lqy.load", f"unix:{path}", recorded=False)
    with pytest.raises(AeroshellError, match=f"^unix:{path}: "):
        fly_bus(run)


HARNESS = """
import sys, time
from contextlib import ExitStack
from pathlib import Path
from sim_harness.flight.bus_flight import BusFlight
from tests.system.flights import built, run_of
from tests.system.test_processes import Saboteur
run = run_of(built("lqy"), Path(sys.argv[1]), "unix", recorded=False)
with ExitStack() as resources:
    flight = BusFlight(run, resources)
    run.listeners.append(Saboteur(lambda: print(flight.computer.pid, flush=True)))
    flight.fly()
"""


def test_a_computer_whose_harness_is_killed_ends_by_itself(tmp_path: Path) -> None:
    harness = subprocess.Popen(
        [sys.executable, "-c", HARNESS, str(tmp_path / "lqy.load")],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert harness.stdout is not None
    computer = int(harness.stdout.readline())
    assert not is_gone(computer)
    harness.kill()
    harness.communicate()
    assert wait_gone(computer)
