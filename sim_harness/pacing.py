"""Real time: the loop that flies against the clock, and the account of its punctuality.

Frame k begins at start + k period, whatever happened before: lateness does not add up. A command
that is not complete when the next frame begins is late: the actuators stay on the one before. The
loop runs in a thread of its own and never waits for whoever takes its logs.
"""

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from flight_sw.can.libc import monotonic_ns, sleep_until_ns
from flight_sw.can.sockets import recv_frames, send_frames
from flight_sw.dictionary import RX_CAPACITY
from flight_sw.histogram import HISTOGRAM, add, filled_bins_us, percentiles_us
from flight_sw.types_ import Frames, Record
from sim_harness.jit import kernel
from sim_harness.loop import (
    BUS_LOST,
    COMPUTER_SILENT,
    INTERRUPTED,
    Logs,
    Wire,
    close_cycle,
    open_cycle,
    take_answer,
)
from sim_harness.world.records import FLYING

if TYPE_CHECKING:
    from sim_harness.flight import FlightPlan, FlightRun

PACER = np.dtype(
    [
        ("period_ns", "i8"),  # a minor frame on the clock
        ("start_ns", "i8"),  # of frame 0; 0: not begun
        ("silence_max_ns", "i8"),  # of the flight computer
        ("answer_ns", "i8"),  # when it last answered
        ("frames", "i8"),  # begun
        ("slips", "i8"),  # frames that began more than a period late
        ("late_commands", "i8"),
        ("late_max_ns", "i8"),  # the latest beginning of a frame
        ("wake_up", HISTOGRAM),  # lateness of each beginning
        ("round_trip", HISTOGRAM),  # from the first navigation frame sent to the command complete
    ],
    align=True,
)
"""How the flight keeps time, shape (1,)."""

SILENCE_S = 0.8  # of the flight computer, that ends a flight
SILENCE_PERIODS = 10  # at a slow pace rather these
HELD_RATIO = 0.999  # of the pace asked for
SLEEP_ONLY_NS = 2_000_000  # nearer to the deadline the loop sleeps instead of listening
NS_PER_MS = 1_000_000


def new_pacer(plan: "FlightPlan") -> np.ndarray:
    """A pacer that has not begun, shape (1,)."""
    pacer = np.zeros(1, PACER)
    if plan.pace > 0.0:
        period_s = plan.mission.dt_s / plan.pace
        pacer["period_ns"] = round(period_s * 1e9)
        pacer["silence_max_ns"] = round(max(SILENCE_S, SILENCE_PERIODS * period_s) * 1e9)
    return pacer


def pace_so_far(run: "FlightRun") -> float:
    """Mission seconds per second of the clock since the first frame."""
    elapsed_ns = time.monotonic_ns() - int(run.pacer["start_ns"][0])
    return float(run.harness["truth"]["t_s"][0]) / max(elapsed_ns, 1) * 1e9


def punctuality(run: "FlightRun") -> dict[str, Any]:
    """What the summary tells of a paced flight on the harness's side."""
    pacer = run.pacer[0]
    flown_s = float(run.harness["truth"]["t_s"][0])
    reached = flown_s / run.wall_s if run.wall_s > 0.0 else 0.0
    return {
        "harness_slips": int(pacer["slips"]),
        "late_commands": int(pacer["late_commands"]),
        "pace_reached": reached,
        "pace_held": bool(pacer["slips"] == 0 and reached >= HELD_RATIO * run.plan.pace),
        "harness_late_max_us": float(pacer["late_max_ns"]) / 1e3,
        "harness_wake_up_us": percentiles_us(pacer["wake_up"]),
        "round_trip_us": percentiles_us(pacer["round_trip"]),
        "harness_wake_up_bins_us": filled_bins_us(pacer["wake_up"]),
        "round_trip_bins_us": filled_bins_us(pacer["round_trip"]),
    }


@kernel
def _listen_until(
    harness: Record, pacer: Record, logs: Logs, wire: Wire, sent_ns: int, deadline_ns: int
) -> int:
    """Receive until shortly before the deadline, then sleep; FLYING or BUS_LOST."""
    while True:
        left_ns = deadline_ns - monotonic_ns()
        if left_ns <= 0:
            return FLYING
        answered = harness["port"]["answered"] == 1
        if answered and left_ns <= SLEEP_ONLY_NS:
            sleep_until_ns(deadline_ns)
            return FLYING
        wait_ms = left_ns // NS_PER_MS
        if answered:
            wait_ms -= SLEEP_ONLY_NS // NS_PER_MS - 1
        n_rx = recv_frames(wire.fd, wire.io[0], wire.rx, RX_CAPACITY, max(wait_ms, 1))
        if n_rx < 0:
            return BUS_LOST
        if n_rx > 0 and take_answer(harness, logs, wire.rx, n_rx) and not answered:
            now_ns = monotonic_ns()
            pacer["answer_ns"] = now_ns
            add(pacer["round_trip"], now_ns - sent_ns)


@kernel
def _begin(pacer: Record) -> int:
    """Note how late the frame begins; returns the deadline of its end."""
    begin_ns = pacer["start_ns"] + pacer["frames"] * pacer["period_ns"]
    late_ns = monotonic_ns() - begin_ns
    add(pacer["wake_up"], late_ns)
    if late_ns > pacer["period_ns"]:
        pacer["slips"] += 1
    pacer["late_max_ns"] = max(pacer["late_max_ns"], late_ns)
    pacer["frames"] += 1
    return begin_ns + pacer["period_ns"]


@kernel
def fly_in_real_time(harnesses: Frames, pacers: Frames, wire: Wire, logs: Logs, cycles: int) -> int:
    """Fly up to `cycles` minor frames, each of them a period long on the clock."""
    harness = harnesses[0]
    pacer = pacers[0]
    for _ in range(cycles):
        if harness["asked_to_end"] == 1:
            return INTERRUPTED
        if pacer["start_ns"] == 0:
            pacer["start_ns"] = monotonic_ns()
            pacer["answer_ns"] = pacer["start_ns"]
        deadline_ns = _begin(pacer)
        n_tx = open_cycle(harness, logs, wire.tx)
        sent_ns = monotonic_ns()
        if send_frames(wire.fd, wire.io[0], wire.tx, n_tx) < 0:
            return BUS_LOST
        outcome = _listen_until(harness, pacer, logs, wire, sent_ns, deadline_ns)
        if outcome != FLYING:
            return outcome
        if harness["port"]["answered"] == 0:
            pacer["late_commands"] += 1
            if monotonic_ns() - pacer["answer_ns"] > pacer["silence_max_ns"]:
                return COMPUTER_SILENT
        outcome = close_cycle(harness)
        if outcome != FLYING:
            return outcome
    return FLYING
