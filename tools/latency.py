"""Round-trip latency, from the navigation set sent to its command complete, bus by bus.

A real flight is flown against the clock, tracking the heat flux so that the law has work to do;
its own account of the round trip is the result. An answer that missed its frame counts as having
taken all of it.
"""

import json
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from flight_sw.errors import AeroshellError
from flight_sw.runtime.histogram import percentiles_us
from sim_harness.bus.hub import Hub
from sim_harness.flight.bus_flight import fly_bus
from sim_harness.flight.computer_process import own_environment, own_module
from sim_harness.flight.flight import FlightPlan, FlightRun, fly_memory
from sim_harness.world.records import TIME_OUT
from tools.can_interface import exists, is_up
from tools.overrides import Prepared, prepare

PACE = 5.0  # 250 sets a second: enough for a percentile, long enough not to hide a late one
BOX_PACE = (
    1.0  # 50 sets a second: a system call in a user-mode Linux takes a tenth of a millisecond
)
BOX, PROCESSORS = "User Mode Linux", Path("/proc/cpuinfo")
VCAN = "vcan0"
MISSION = "hyperion-1"
TRACKING = (
    "entry.altitude_km=58.48",
    "entry.speed_mps=6033",
    "entry.flight_path_angle_deg=-0.4",
    "entry.angle_of_attack_deg=45",
)
"""On the heat-flux limit."""
END_TIMEOUT_S = 5.0


class Latency(NamedTuple):
    """The round trip on one bus."""

    bus: str
    traffic: str
    sets: int
    late_commands: int
    foreign_rate_hz: float
    round_trip_us: dict[str, float]


@contextmanager
def foreign_traffic(address: str) -> Iterator[dict[str, Any]]:
    """A process that loads the bus fully; what it has sent is in the dictionary afterwards."""
    told: dict[str, Any] = {}
    with subprocess.Popen(
        [*own_module("tools.foreign_traffic"), address],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=own_environment(),
    ) as process:
        assert process.stdout is not None
        try:
            if process.stdout.readline().strip() != "sending":
                raise AeroshellError(f"{address}: the foreign traffic did not begin")
            yield told
            text, _ = process.communicate(timeout=END_TIMEOUT_S)
            told.update(json.loads(text.splitlines()[-1]))
        finally:
            process.kill()


def _plan(prepared: Prepared, folder: Path, bus: str, pace: float) -> FlightPlan:
    load_path = folder / "latency.load"
    load_path.write_bytes(prepared.load_image)
    return FlightPlan(
        mission=prepared.mission,
        law=prepared.law,
        load_image=prepared.load_image,
        load_path=load_path,
        bus=bus,
        recorded=False,
        pace=pace,
    )


def is_in_box() -> bool:
    """Whether this kernel is itself a program on another."""
    return BOX in PROCESSORS.read_text(encoding="utf-8", errors="replace")


def memory_latency(seconds: float, folder: Path, pace: float) -> Latency:
    """The minor frame called directly: what the flight computer itself takes."""
    flown_s = seconds * pace
    prepared = prepare(MISSION, None, [*TRACKING, f"end.time_max_s={flown_s}"], None)
    run = FlightRun(_plan(prepared, folder, "memory", 0.0), [])
    fly_memory(run, timed_every=1)
    frames = int(run.harness["truth"]["minor_frames"][0])
    return Latency("memory", "idle", frames, 0, 0.0, run.computer["step_time_us"])


def bus_latency(bus: str, seconds: float, folder: Path, pace: float, *, foreign: bool) -> Latency:
    """Two processes against the clock; foreign traffic begins before and ends after the flight."""
    settings = [*TRACKING, f"end.time_max_s={seconds * pace}"]
    prepared = prepare(MISSION, None, settings, None)
    told: dict[str, Any] = {}
    with ExitStack() as resources:
        address = bus
        if bus == "unix":
            address = f"unix:{folder / 'bus'}"
            resources.enter_context(Hub(folder / "bus", prompt=True))
        run = FlightRun(_plan(prepared, folder, address, pace), [])
        if foreign:
            told = resources.enter_context(foreign_traffic(address))
        if failure := fly_bus(run):
            raise AeroshellError(f"{bus}: {failure}")
    if run.outcome != TIME_OUT:
        raise AeroshellError(f"{bus}: the flight ended with outcome '{run.outcome_text}'")
    pacer = run.pacer[0]
    return Latency(
        f"{bus} ({BOX})" if is_in_box() else bus,
        "full rate" if foreign else "idle",
        int(pacer["frames"]),
        int(pacer["late_commands"]),
        float(told.get("rate_hz", 0.0)),
        percentiles_us(pacer["round_trip"]),
    )


def measure(seconds: float, buses: list[str] | None) -> Iterator[Latency]:
    """Each of these buses idle and busy, memory as it is; where none is named, all there are."""
    if not buses:
        buses = ["memory", "unix"]
        if exists(VCAN) and is_up(VCAN):
            buses.append(f"socketcan:{VCAN}")
    pace = BOX_PACE if is_in_box() else PACE
    with tempfile.TemporaryDirectory(prefix="aeroshell-") as name:
        for bus in buses:
            if bus == "memory":
                yield memory_latency(seconds, Path(name), pace)
                continue
            for foreign in (False, True):
                yield bus_latency(bus, seconds, Path(name), pace, foreign=foreign)
