"""Real time: the loop that flies against the clock, and the account of its punctuality.

Frame k begins at start + k period, whatever happened before: lateness does not add up. A command
that is not complete when the next frame begins is late: the actuators stay on the one before. The
loop runs in a thread of its own and never waits for whoever takes its logs.
"""

import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from flight_sw.can.libc import monotonic_ns, sched_yield, sleep_until_ns
from flight_sw.can.sockets import recv_frames, send_frames
from flight_sw.reception.requests import ARM, STOP
from flight_sw.records.dictionary import RX_CAPACITY
from flight_sw.records.types_ import Frames, Record
from flight_sw.runtime.histogram import HISTOGRAM, add, filled_bins_us, percentiles_us
from sim_harness.bus.bus_listener import hear
from sim_harness.flight.loop import (
    BUS_LOST,
    COMPUTER_SILENT,
    INTERRUPTED,
    Wire,
    close_cycle,
    must_arm,
    open_cycle,
    presence_over_bus,
    request_over_bus,
    take_answer,
)
from sim_harness.jit import kernel
from sim_harness.telemetry.logs import Logs, publish
from sim_harness.world.records import FLYING

PACER = np.dtype(
    [
        ("period_ns", "i8"),  # a minor frame on the clock
        ("start_ns", "i8"),  # of frame 0; 0: not begun
        ("end_ns", "i8"),  # of the last frame; 0: not ended
        ("silence_max_ns", "i8"),  # of the flight computer
        ("answer_ns", "i8"),  # when it last answered, in time or late
        ("frames", "i8"),  # begun
        ("slips", "i8"),  # frames that began more than a period late
        ("late_commands", "i8"),
        ("late_max_ns", "i8"),  # the latest beginning of a frame
        ("wake_up", HISTOGRAM),  # lateness of each beginning
        ("round_trip", HISTOGRAM),  # from the navigation set sent to the command complete
    ],
    align=True,
)
"""How the flight keeps time, shape (1,)."""

SILENCE_S = 0.8  # mission time without an answer that ends a flight
SILENCE_MIN_S = 0.2  # on the clock: a fast flight lives through a stall of the machine
SILENCE_PERIODS = 3
HELD_RATIO = 0.999  # of the pace asked for
LOOKS_MAX = 1 << 30  # bounds the loop in words; the clock ends it first
SLEEP_ONLY_NS = 2_000_000  # nearer to the deadline the loop sleeps instead of listening
LATE_LOOKS = 4  # of a frame that began late: hub and computer on its processor run in between
NAP_NS = 100_000  # between two looks at the bus in the last millisecond of a frame
BATCHES_MAX = 64  # that a bus listener hears in one frame
NS_PER_MS = 1_000_000
PROCESSOR_TIMES, STOLEN_AT = Path("/proc/stat"), 8


def new_pacer(pace: float, dt_s: float) -> np.ndarray:
    """A pacer that has not begun, shape (1,); in lockstep, a pace of 0, it has no period."""
    pacer = np.zeros(1, PACER)
    if pace > 0.0:
        period_s = dt_s / pace
        pacer["period_ns"] = round(period_s * 1e9)
        silence_s = max(SILENCE_S / pace, SILENCE_MIN_S, SILENCE_PERIODS * period_s)
        pacer["silence_max_ns"] = round(silence_s * 1e9)
    return pacer


def pace_so_far(pacer: Record, t_s: float) -> float:
    """Mission seconds per second of the clock since the first frame, at mission time `t_s`."""
    start_ns = int(pacer["start_ns"])
    if start_ns == 0:
        return 0.0
    elapsed_ns = (int(pacer["end_ns"]) or time.monotonic_ns()) - start_ns
    return t_s / max(elapsed_ns, 1) * 1e9


def stolen_s(path: Path = PROCESSOR_TIMES) -> float:
    """Processor time that a hypervisor has given to others so far, over all processors.

    Most slips of a virtual machine are its doing; what it takes by a quota may be counted low.
    """
    try:
        first = path.read_text(encoding="ascii").partition("\n")[0].split()
    except OSError:
        return 0.0
    return int(first[STOLEN_AT]) / os.sysconf("SC_CLK_TCK") if len(first) > STOLEN_AT else 0.0


def punctuality(pacer: Record, pace: float, t_s: float, stolen: float) -> dict[str, Any]:
    """What the summary tells on the harness's side of a flight with this pace until `t_s`.

    `stolen` is the processor time in seconds that a hypervisor gave to others meanwhile.
    """
    reached = pace_so_far(pacer, t_s)
    return {
        "harness_slips": int(pacer["slips"]),
        "late_commands": int(pacer["late_commands"]),
        "pace_reached": reached,
        "pace_held": bool(pacer["slips"] == 0 and reached >= HELD_RATIO * pace),
        "stolen_s": round(stolen, 2),
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
    """Receive until shortly before the deadline, then sleep; FLYING or BUS_LOST.

    A frame that began late still hears what has come, and what comes as soon as it steps aside.
    """
    for look in range(LOOKS_MAX):
        left_ns = deadline_ns - monotonic_ns()
        answered = harness["port"]["answered"] == 1
        if left_ns <= 0:
            if look > 0 and (answered or look >= LATE_LOOKS):
                return FLYING
            sched_yield()
        if answered and left_ns <= SLEEP_ONLY_NS:
            sleep_until_ns(deadline_ns)  # a signal may end it: look again
            continue
        wait_ms = max(left_ns // NS_PER_MS, 0)
        if answered:
            wait_ms -= SLEEP_ONLY_NS // NS_PER_MS - 1
        elif wait_ms == 0 and look > 0:  # nearer than poll can tell
            sleep_until_ns(min(deadline_ns, monotonic_ns() + NAP_NS))
        n_rx = recv_frames(wire.fd, wire.io[0], wire.rx, RX_CAPACITY, wait_ms)
        if n_rx < 0:
            return BUS_LOST
        if n_rx > 0 and take_answer(harness, logs, wire.rx, n_rx) and not answered:
            now_ns = monotonic_ns()
            add(pacer["round_trip"], now_ns - sent_ns)
            hear(harness, logs, wire.bus_listener, BATCHES_MAX)
    return FLYING


@kernel
def _begin(pacer: Record) -> int:
    """Note how late the frame begins; returns the deadline of its end."""
    begin_ns = pacer["start_ns"] + pacer["frames"] * pacer["period_ns"]
    late_ns = monotonic_ns() - begin_ns
    add(pacer["wake_up"], max(late_ns, 0))
    if late_ns > pacer["period_ns"]:
        pacer["slips"] += 1
    pacer["late_max_ns"] = max(pacer["late_max_ns"], late_ns)
    pacer["frames"] += 1
    return begin_ns + pacer["period_ns"]


@kernel
def _is_silent(harness: Record, pacer: Record, deadline_ns: int, answers: int) -> bool:
    """Account for the frame's answer; True once the flight computer has said nothing too long."""
    port = harness["port"]
    now_ns = monotonic_ns()
    if port["answered"] == 0:
        pacer["late_commands"] += 1
        # at least so long since the frame was due to begin: to leave it out would flatter
        add(pacer["round_trip"], max(now_ns - deadline_ns, 0) + pacer["period_ns"])
    if port["answered"] == 1 or port["stale_answers"] != answers:
        pacer["answer_ns"] = now_ns
    return now_ns - pacer["answer_ns"] > pacer["silence_max_ns"]


@kernel
def _fly_frame(harness: Record, pacer: Record, wire: Wire, logs: Logs) -> int:
    """One minor frame, from its beginning on the clock to that of the next."""
    deadline_ns = _begin(pacer)
    publish(harness)
    answers = int(harness["port"]["stale_answers"])
    if must_arm(harness):
        n_tx = request_over_bus(harness, logs, ARM, wire.tx)
        send_frames(wire.fd, wire.io[0], wire.tx, n_tx)
    n_tx = presence_over_bus(harness, logs, wire.tx)
    if n_tx > 0:
        send_frames(wire.fd, wire.io[0], wire.tx, n_tx)
    n_tx = open_cycle(harness, logs, wire.tx)
    sent_ns = monotonic_ns()
    if send_frames(wire.fd, wire.io[0], wire.tx, n_tx) < 0:
        return BUS_LOST
    outcome = _listen_until(harness, pacer, logs, wire, sent_ns, deadline_ns)
    if outcome != FLYING:
        return outcome
    if harness["port"]["answered"] == 0:
        hear(harness, logs, wire.bus_listener, BATCHES_MAX)
    if _is_silent(harness, pacer, deadline_ns, answers):
        return COMPUTER_SILENT
    return close_cycle(harness, logs)


@kernel
def _stop_computer(harness: Record, wire: Wire, logs: Logs) -> None:
    """Ask the flight computer to end before it misses the frames that will not come."""
    n_tx = request_over_bus(harness, logs, STOP, wire.tx)
    send_frames(wire.fd, wire.io[0], wire.tx, n_tx)


@kernel
def fly_in_real_time(harnesses: Frames, pacers: Frames, wire: Wire, logs: Logs, cycles: int) -> int:
    """Fly up to `cycles` minor frames, each of them a period long on the clock."""
    harness = harnesses[0]
    pacer = pacers[0]
    if cycles > 0 and pacer["start_ns"] == 0:
        pacer["start_ns"] = monotonic_ns()
        pacer["answer_ns"] = pacer["start_ns"]
    outcome = FLYING
    for _ in range(cycles):
        outcome = INTERRUPTED if harness["asked_to_end"] == 1 else FLYING
        if outcome == FLYING:
            outcome = _fly_frame(harness, pacer, wire, logs)
        if outcome != FLYING:
            break
    if outcome != FLYING:
        pacer["end_ns"] = monotonic_ns()
        if outcome not in (BUS_LOST, COMPUTER_SILENT):
            _stop_computer(harness, wire, logs)
    return outcome
