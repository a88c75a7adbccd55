"""Pieces of flight against the clock that tests share.

Whether a flight slips is the machine's doing. What is claimed of a flight without slips is asked of
one: it is flown up to ATTEMPTS times until it has none, and if none is had the test is skipped with
the counts, so that a busy machine shows as a skip and never as a pass. A flight without slips that
breaks the claim fails at once.
"""

import functools
from pathlib import Path
from typing import Any

import pytest

from flight_sw.load_image import activate, image_bytes, parse_image
from sim_harness.bus_flight import fly_bus
from sim_harness.flight import FlightRun, fly_memory
from sim_harness.mission import load_mission
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
    return run


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
    pytest.skip(f"this machine slipped in each of {ATTEMPTS} flights: {met}")
