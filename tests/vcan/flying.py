"""Flights on vcan0 for the tests here: the harness in this process, the flight computer beside it.

A piece starts near Hyperion-1's heat-flux peak, so that the law is at work from the first second.
"""

import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sim_harness.flight import bus_flight
from sim_harness.flight.bus_flight import fly_bus
from sim_harness.flight.flight import FlightPlan, FlightRun, fly_memory
from sim_harness.flight.summary import summary_of
from tools.overrides import Prepared, prepare

INTERFACE = "vcan0"
BUS = f"socketcan:{INTERFACE}"
PEAK = (
    "entry.altitude_km=68.85",
    "entry.speed_mps=7500",
    "entry.flight_path_angle_deg=-0.225",
    "entry.angle_of_attack_deg=45",
)
END_S = 60.0
bus_flight.SIGN_OF_LIFE_S = bus_flight.START_UP_S  # a computer started here imports in the box


class Trigger:
    """A listener that calls once: when the flight computer is ready, or at a time of flight."""

    def __init__(self, action: Callable[[], Any], at_s: float = -1.0) -> None:
        self.action, self.at_s, self.done = action, at_s, False
        self.awaits_computer = False

    def rows(self, bus: npt.NDArray[np.void], truth: npt.NDArray[np.void]) -> None:
        """Nothing is kept here."""

    def waiting(self, text: str) -> None:
        """An empty text after one of the flight computer: it is ready."""
        self.awaits_computer |= text.startswith("flight computer")
        if not text and self.awaits_computer and self.at_s < 0.0:
            self._call()

    def progress(self, run: FlightRun) -> None:
        """Called about every 50 ms of a flight in real time."""
        if 0.0 <= self.at_s <= float(run.harness["truth"]["t_s"][0]):
            self._call()

    def warn(self, t_s: float, text: str) -> None:
        """Slips are counted by the summary."""

    def _call(self) -> None:
        if not self.done:
            self.done = True
            self.action()


def piece(time_max_s: float) -> Prepared:
    """The piece, ready to fly."""
    return prepare("hyperion-1", "lqy", [*PEAK, f"time_max_s={time_max_s:g}"], None)


def fly(
    bus: str = BUS,
    time_max_s: float = 10.0,
    pace: float = 0.0,
    trigger: Trigger | None = None,
    *,
    own_computer: bool = True,
    also: Sequence[Trigger] = (),
) -> dict[str, Any]:
    """Fly the piece; the summary, with `failure` for a flight that ended early."""
    prepared = piece(time_max_s)
    plan = FlightPlan(
        mission=prepared.mission,
        law=prepared.law,
        load_image=prepared.load_image,
        load_path=prepared.load_path,
        bus=bus,
        recorded=False,
        pace=pace,
        own_computer=own_computer,
    )
    run = FlightRun(plan, [*([trigger] if trigger else []), *also])
    failure = ""
    if bus == "memory":
        fly_memory(run)
    else:
        failure = fly_bus(run)
    return {**summary_of(run), "failure": failure, "computer": run.computer}


def program(name: str) -> str:
    """Where one of can-utils' programs is; they are installed where these tests run."""
    path = shutil.which(name)
    assert path, f"{name} is not installed (package can-utils)"
    return path


def start(*command: str, output: Path | None = None) -> subprocess.Popen[bytes]:
    """Start one of can-utils' programs."""
    with (output or Path("/dev/null")).open("wb") as file:
        return subprocess.Popen(
            [program(command[0]), *command[1:]],
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.DEVNULL,
        )


def end(*processes: subprocess.Popen[bytes]) -> None:
    """End processes that were started here."""
    for process in processes:
        process.terminate()
    for process in processes:
        process.wait(END_S)


@contextmanager
def running(*commands: tuple[str, ...]) -> Iterator[None]:
    """The programs run while the block does."""
    processes = [start(*command) for command in commands]
    try:
        yield
    finally:
        end(*processes)


def set_interface(state: str) -> None:
    """Raise or drop vcan0."""
    subprocess.run(["ip", "link", "set", INTERFACE, state], check=True)


def frames_through() -> int:
    """Frames that the interface has carried so far."""
    return int(Path(f"/sys/class/net/{INTERFACE}/statistics/tx_packets").read_text("ascii"))
