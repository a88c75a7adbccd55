"""Pieces of flight against the clock that tests share.

Whether a flight slips is the machine's doing. What is claimed of a flight without slips is asked of
one: it is flown up to ATTEMPTS times until it has none, and if none is had the test is skipped with
the counts, so that a busy machine shows as a skip and never as a pass. A flight without slips that
breaks the claim fails at once, and so does one whose slips are not those that its histograms show:
a skip is the machine's doing and never the account's. A session allows few such skips
(tests/allowances.py).
"""

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flight_sw.load_image import activate, image_bytes, parse_image
from flight_sw.records.types_ import Record
from flight_sw.runtime.histogram import upper_edge_ns
from sim_harness.flight.bus_flight import fly_bus
from sim_harness.flight.flight import FlightRun, fly_memory
from sim_harness.telemetry.logs import COMMANDS
from sim_harness.world.missions import load_mission
from tests.allowances import SLIPPED
from tests.system.flights import MISSION, PIECES, Built, design, run_of
from tools.gains.body import fill_body

ATTEMPTS = 3
LAW = "lqy"


@functools.cache
def piece(seconds: float, rate_hz: int = 50) -> Built:
    """So many seconds on the heat-flux limit."""
    settings = {"end.time_max_s": seconds, "guidance.rate_hz": rate_hz}
    mission = load_mission(MISSION, {**PIECES["tracking"], **settings})
    raw = image_bytes(LAW, MISSION, fill_body(LAW, design(), mission).body)
    image = parse_image(raw, LAW)
    return Built(mission, LAW, raw, image, activate(image))


def flown(made: Built, folder: Path, bus: str = "unix", **plan: Any) -> FlightRun:
    """A flight to its end that nothing ended early."""
    run = run_of(made, folder / "piece.load", bus, **{"recorded": False, **plan})
    if bus == "memory":
        fly_memory(run)
        return run
    failure = fly_bus(run)
    assert not failure
    if run.plan.pace > 0.0:
        check_account(run)
    return run


def longer_than(histogram: Record, limit_ns: int) -> tuple[int, int]:
    """How many durations were surely longer, and how many may have been: a bin has a width."""
    filled = [int(i) for i in np.flatnonzero(histogram["bins"])]
    counts = histogram["bins"]
    surely = sum(int(counts[i]) for i in filled if i > 0 and upper_edge_ns(i - 1) >= limit_ns)
    maybe = sum(int(counts[i]) for i in filled if upper_edge_ns(i) > limit_ns)
    return surely, maybe


def check_account(run: FlightRun) -> None:
    """The slips and late commands counted are those that the histograms show."""
    pacer = run.pacer[0]
    frames, period_ns = int(pacer["frames"]), int(pacer["period_ns"])
    late_commands = int(pacer["late_commands"])
    assert int(pacer["wake_up"]["n"]) == int(pacer["round_trip"]["n"]) == frames
    assert int(pacer["wake_up"]["max_ns"]) == max(int(pacer["late_max_ns"]), 0)
    surely, maybe = longer_than(pacer["wake_up"], period_ns)
    assert surely <= int(pacer["slips"]) <= maybe, "harness slips are not those of its wake-ups"
    assert late_commands <= longer_than(pacer["round_trip"], period_ns - 1)[1]
    assert int(run.harness["written"][0][COMMANDS]) == frames - late_commands
    computer = run.computer
    if computer and pacer["slips"] == 0:
        longest_us = computer["wake_up_us"]["max"] + computer["step_time_us"]["max"]
        if longest_us * 1e3 < period_ns / 2:
            assert computer["slips"] == 0, f"the computer was {longest_us} us late at most"


def lateness(run: FlightRun) -> dict[str, int]:
    """Everything that makes a flight's commands its machine's."""
    return {
        "harness_slips": int(run.pacer["slips"][0]),
        "late_commands": int(run.pacer["late_commands"][0]),
        "computer_slips": int(run.computer.get("slips", 0)),
        "ticks": int(run.computer.get("ticks", 0)),
    }


def flown_without_slip(made: Built, folder: Path, **plan: Any) -> FlightRun:
    """A flight against the clock that kept time; skips where the machine grants none."""
    met = []
    for _ in range(ATTEMPTS):
        run = flown(made, folder, **plan)
        late = lateness(run)
        if not any(late.values()):
            return run
        met.append(late)
    pytest.skip(f"{SLIPPED} {ATTEMPTS} flights: {met}")
