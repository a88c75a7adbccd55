"""The two compiled loops of a flight: in memory, and over a bus in lockstep.

Both fly the same cycle: measure, send, be answered, judge, advance. They differ only in how the
frames reach the flight computer. A call flies at most the frames its logs have room for.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.can.bursts import recv_rest
from flight_sw.can.codec import CODEC
from flight_sw.can.libc import monotonic_ns
from flight_sw.can.sockets import recv_frames, send_frames
from flight_sw.computer import minor_frame
from flight_sw.modes import STANDBY
from flight_sw.reception.requests import ARM
from flight_sw.records.dictionary import RX_CAPACITY, TICK_ID
from flight_sw.records.types_ import Frames, Record
from flight_sw.runtime.histogram import add
from sim_harness.bus.bus_listener import BusListener, hear
from sim_harness.flight.metrics import METRICS, judge_frame
from sim_harness.flight.port import (
    FLYING_HERE,
    PORT,
    put_navigation,
    put_presence,
    put_request,
    take,
)
from sim_harness.jit import kernel
from sim_harness.telemetry.journal import JOURNAL, NONE, keep_bus, keep_truth
from sim_harness.telemetry.logs import (
    BUS,
    N_LOGS,
    TRUTHS,
    Logs,
    has_room,
    log_command,
    log_passing,
    log_truth,
)
from sim_harness.world.navigation import NAV_STATE, measure
from sim_harness.world.records import FLYING, TRUTH, WORLD
from sim_harness.world.vehicle import advance, ended

BUS_LOST = 101
COMPUTER_SILENT = 102
INTERRUPTED = 103
TRUTH_BYTES = TRUTH.itemsize
PRESENT_NS = 1_000_000_000  # from one word of the harness's presence to the next, by the clock
ARM_AGAIN_CYCLES = 25  # a request that was refused or lost is not told; the mode tells
BATCHES_PER_CYCLE = 2  # that a bus listener hears in lockstep: the log has room for them
POLL_MS = 20  # longest wait in one system call: the time-out is looked at this often

HARNESS = np.dtype(
    [
        ("world", WORLD),
        ("codec", CODEC),
        ("truth", TRUTH),
        ("navigation", NAV_STATE),
        ("port", PORT),
        ("metrics", METRICS),
        ("present_ns", "i8"),  # when the harness last said that it is here
        ("truth_divider", "i8"),  # minor frames per truth row in the log
        ("timed_every", "i8"),  # minor frames from one timed step to the next; 0: none is timed
        ("written", "i8", (N_LOGS,)),  # rows ever put into each log
        ("published", "i8", (N_LOGS,)),  # rows of whole cycles, for a reader beside the loop
        ("taken", "i8", (N_LOGS,)),  # rows ever taken out of it
        ("has_bus_listener", "i8"),  # 1: the bus is logged as a bus listener hears it
        ("bus_rows_lost", "i8"),  # frames that found the log full
        ("command_rows_lost", "i8"),
        ("truth_rows_lost", "i8"),
        ("asked_to_end", "i8"),  # set from outside
        ("journal", JOURNAL),
    ],
    align=True,
)
"""Everything of one flight on the harness's side."""


class Wire(NamedTuple):
    """An open bus and the buffers of its transfers."""

    fd: int
    io: npt.NDArray[np.void]
    rx: Frames
    tx: Frames
    bus_listener: BusListener


@kernel
def keep_in_journal(harness: Record, logs: Logs) -> None:
    """Append what is logged to the journal, where there is one and it is time."""
    journal = harness["journal"]
    if journal["fd"] == NONE or harness["truth"]["minor_frames"] % journal["every"] != 0:
        return
    if len(logs.bus) > 0:
        keep_bus(journal, logs.bus, harness["written"][BUS])
    if len(logs.truth) > 0:
        keep_truth(journal, logs.truth, harness["written"][TRUTHS], TRUTH_BYTES)


@kernel
def open_cycle(harness: Record, logs: Logs, tx: Frames) -> int:
    """Measure and put the cycle's navigation set into `tx`."""
    truth = harness["truth"]
    port = harness["port"]
    log_truth(harness, logs)
    measure(harness["world"], truth, harness["navigation"], port["values"])
    port["withheld"] = harness["navigation"]["withheld"]
    n_tx = put_navigation(harness["codec"], port, truth["minor_frames"], tx)
    for i in range(n_tx):
        log_passing(harness, logs, tx[i])
    return n_tx


@kernel
def request_over_bus(harness: Record, logs: Logs, request: int, tx: Frames) -> int:
    """Put one request to the computer into `tx`; returns its length."""
    n_tx = put_request(harness["codec"], harness["port"], request, tx)
    for i in range(n_tx):
        log_passing(harness, logs, tx[i])
    return n_tx


@kernel
def presence_over_bus(harness: Record, logs: Logs, tx: Frames) -> int:
    """Put a word of the harness's presence into `tx` once it is time; returns its length."""
    now_ns = monotonic_ns()
    if now_ns - harness["present_ns"] < PRESENT_NS:
        return 0
    harness["present_ns"] = now_ns
    n_tx = put_presence(harness["codec"], harness["port"], FLYING_HERE, tx)
    for i in range(n_tx):
        log_passing(harness, logs, tx[i])
    return n_tx


@kernel
def must_arm(harness: Record) -> bool:
    """Whether it is time to arm the computer once more: its answers say that it stands by."""
    cycle = harness["truth"]["minor_frames"]
    return cycle > 0 and cycle % ARM_AGAIN_CYCLES == 0 and harness["port"]["mode"] == STANDBY


@kernel
def take_answer(harness: Record, logs: Logs, frames: Frames, n: int) -> bool:
    """Judge and log received frames; True once the cycle's command is complete."""
    port = harness["port"]
    cycle = harness["truth"]["minor_frames"]
    for i in range(n):
        log_passing(harness, logs, frames[i])
        take(harness["codec"], port, frames[i], cycle)
    return port["answered"] == 1


@kernel
def close_cycle(harness: Record, logs: Logs) -> int:
    """Judge the frame, fly it, and say how the flight stands."""
    world = harness["world"]
    truth = harness["truth"]
    port = harness["port"]
    if port["answered"] == 1:
        log_command(harness, logs)
    judge_frame(harness["metrics"], truth, port, world["dt_s"])
    advance(world, truth, port["bank_cmd_rad"], port["alpha_cmd_rad"])
    return ended(world, truth)


@kernel
def fly_in_memory(
    harnesses: Frames,
    loads: Frames,
    states: Frames,
    step_times: Frames,
    rx: Frames,
    tx: Frames,
    logs: Logs,
    cycles: int,
) -> int:
    """Fly up to `cycles` minor frames with the computer's minor frame called directly.

    One step in `timed_every` goes into `step_times`.
    """
    harness = harnesses[0]
    load = loads[0]
    state = states[0]
    every = harness["timed_every"]
    for _ in range(cycles):
        if not has_room(harness, logs):
            return FLYING
        n_rx = open_cycle(harness, logs, rx)
        timed = every > 0 and harness["truth"]["minor_frames"] % every == 0
        start_ns = monotonic_ns() if timed else 0
        n_tx = minor_frame(load, state, rx, n_rx, tx)
        if n_tx == 0:  # the time message was refused, and nothing more is said in this cycle
            rx[0]["can_id"] = TICK_ID
            n_tx = minor_frame(load, state, rx, 1, tx)
        if timed:
            add(step_times[0], monotonic_ns() - start_ns)
        if not take_answer(harness, logs, tx, n_tx):
            return COMPUTER_SILENT
        outcome = close_cycle(harness, logs)
        keep_in_journal(harness, logs)
        if outcome != FLYING:
            return outcome
    return FLYING


@kernel
def _await_answer(harness: Record, logs: Logs, wire: Wire, timeout_ns: int) -> int:
    """Receive until the cycle's command is complete; FLYING, BUS_LOST or COMPUTER_SILENT."""
    deadline_ns = monotonic_ns() + timeout_ns
    in_burst = False
    while True:
        n_rx = 0
        if in_burst:
            n_rx = recv_rest(wire.fd, wire.io[0], wire.rx, RX_CAPACITY)
        if n_rx == 0:
            n_rx = recv_frames(wire.fd, wire.io[0], wire.rx, RX_CAPACITY, POLL_MS)
        in_burst = n_rx > 0
        if n_rx < 0:
            return BUS_LOST
        if n_rx > 0 and take_answer(harness, logs, wire.rx, n_rx):
            return FLYING
        if monotonic_ns() > deadline_ns:
            return COMPUTER_SILENT


@kernel
def fly_in_lockstep(harnesses: Frames, wire: Wire, logs: Logs, cycles: int, timeout_ns: int) -> int:
    """Fly up to `cycles` minor frames, each waiting for the computer's answer on the bus."""
    harness = harnesses[0]
    for _ in range(cycles):
        if not has_room(harness, logs):
            return FLYING
        if must_arm(harness):
            n_tx = request_over_bus(harness, logs, ARM, wire.tx)
            send_frames(wire.fd, wire.io[0], wire.tx, n_tx)
        n_tx = presence_over_bus(harness, logs, wire.tx)
        if n_tx > 0:
            send_frames(wire.fd, wire.io[0], wire.tx, n_tx)
        n_tx = open_cycle(harness, logs, wire.tx)
        if send_frames(wire.fd, wire.io[0], wire.tx, n_tx) < 0:
            return BUS_LOST
        outcome = _await_answer(harness, logs, wire, timeout_ns)
        hear(harness, logs, wire.bus_listener, BATCHES_PER_CYCLE)
        if outcome != FLYING:
            return outcome
        outcome = close_cycle(harness, logs)
        keep_in_journal(harness, logs)
        if outcome != FLYING:
            return outcome
    return FLYING


@kernel
def hear_outside(harnesses: Frames, logs: Logs, bus_listener: BusListener, batches: int) -> int:
    """Hear while no loop flies; how many frames there were."""
    harness = harnesses[0]
    n = hear(harness, logs, bus_listener, batches)
    if harness["journal"]["fd"] != NONE:
        keep_bus(harness["journal"], logs.bus, harness["written"][BUS])
    return n
