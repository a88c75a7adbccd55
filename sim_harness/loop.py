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
from flight_sw.computer import COMMAND, minor_frame
from flight_sw.dictionary import RX_CAPACITY
from flight_sw.histogram import add
from flight_sw.types_ import Frames, Record
from sim_harness.fence import memory_fence
from sim_harness.jit import kernel
from sim_harness.journal import JOURNAL, NONE, keep_bus, keep_truth
from sim_harness.metrics import METRICS, judge_frame
from sim_harness.navigation import NAV_STATE, measure
from sim_harness.port import PORT, put_navigation, take
from sim_harness.vehicle import advance, ended
from sim_harness.world.records import FLYING, TRUTH, WORLD

BUS_LOST = 101
COMPUTER_SILENT = 102
INTERRUPTED = 103
COMMANDS, BUS, TRUTHS, N_LOGS = 0, 1, 2, 3  # the ring logs
ROOM_FOR_A_CYCLE = 4 * RX_CAPACITY  # frames
TRUTH_BYTES = TRUTH.itemsize
POLL_MS = 20  # longest wait in one system call: the time-out is looked at this often

HARNESS = np.dtype(
    [
        ("world", WORLD),
        ("codec", CODEC),
        ("truth", TRUTH),
        ("navigation", NAV_STATE),
        ("port", PORT),
        ("metrics", METRICS),
        ("truth_divider", "i8"),  # minor frames per truth row in the log
        ("timed_every", "i8"),  # minor frames from one timed step to the next; 0: none is timed
        ("written", "i8", (N_LOGS,)),  # rows ever put into each log
        ("published", "i8", (N_LOGS,)),  # rows of whole cycles, for a reader beside the loop
        ("taken", "i8", (N_LOGS,)),  # rows ever taken out of it
        ("bus_rows_lost", "i8"),  # frames that found the log full
        ("command_rows_lost", "i8"),
        ("truth_rows_lost", "i8"),
        ("asked_to_end", "i8"),  # set from outside
        ("journal", JOURNAL),
    ],
    align=True,
)
"""Everything of one flight on the harness's side."""


class Logs(NamedTuple):
    """Caller-owned ring buffers: the loop writes, the caller takes; an empty one is not filled."""

    commands: npt.NDArray[np.void]  # dictionary.FRAME, every command flown
    bus: npt.NDArray[np.void]  # telemetry.records.BUS_LOG, every frame
    truth: npt.NDArray[np.void]  # TRUTH, every truth_divider-th minor frame


class Wire(NamedTuple):
    """An open bus and the buffers of its transfers."""

    fd: int
    io: npt.NDArray[np.void]
    rx: Frames
    tx: Frames


@kernel
def _copy_frame(to: Record, frame: Record) -> None:
    to["can_id"] = frame["can_id"]
    to["dlc"] = frame["dlc"]
    to["pad"] = frame["pad"]
    to["res0"] = frame["res0"]
    to["len8_dlc"] = frame["len8_dlc"]
    to["data"] = frame["data"]


@kernel
def _room(harness: Record, log: int, length: int) -> int:
    """Free rows of a ring log."""
    return length - (harness["written"][log] - harness["taken"][log])


@kernel
def log_frame(harness: Record, logs: Logs, frame: Record) -> None:
    """Keep one frame of the bus; one that finds the log full is counted."""
    length = len(logs.bus)
    if length == 0:
        return
    if _room(harness, BUS, length) < 1:
        harness["bus_rows_lost"] += 1
        return
    row = logs.bus[harness["written"][BUS] % length]
    row["t_s"] = harness["truth"]["t_s"]
    _copy_frame(row["frame"], frame)
    harness["written"][BUS] += 1


@kernel
def _log_command(harness: Record, logs: Logs) -> None:
    """Keep the command that is flown, as it lay on the wire."""
    length = len(logs.commands)
    if _room(harness, COMMANDS, length) < 1:
        harness["command_rows_lost"] += 1
        return
    row = logs.commands[harness["written"][COMMANDS] % length]
    codec = harness["codec"]
    row["can_id"] = codec["can_id"][COMMAND]
    row["dlc"] = codec["dlc"][COMMAND]
    row["pad"] = 0
    row["res0"] = 0
    row["len8_dlc"] = 0
    row["data"] = harness["port"]["flown"]
    harness["written"][COMMANDS] += 1


@kernel
def _log_truth(harness: Record, logs: Logs) -> None:
    truth = harness["truth"]
    length = len(logs.truth)
    if length == 0 or truth["minor_frames"] % harness["truth_divider"] != 0:
        return
    if _room(harness, TRUTHS, length) < 1:
        harness["truth_rows_lost"] += 1
        return
    logs.truth[harness["written"][TRUTHS] % length] = truth
    harness["written"][TRUTHS] += 1


@kernel
def has_room(harness: Record, logs: Logs) -> bool:
    """Whether the logs take one more cycle on a bus as busy as it can be."""
    return (
        _room(harness, COMMANDS, len(logs.commands)) >= 1
        and (len(logs.bus) == 0 or _room(harness, BUS, len(logs.bus)) >= ROOM_FOR_A_CYCLE)
        and (len(logs.truth) == 0 or _room(harness, TRUTHS, len(logs.truth)) >= 1)
    )


@kernel
def publish(harness: Record) -> None:
    """Let a reader beside the loop take everything that is logged: between cycles alone."""
    memory_fence()
    for log in range(N_LOGS):
        harness["published"][log] = harness["written"][log]


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
    _log_truth(harness, logs)
    measure(harness["world"], truth, harness["navigation"], port["values"])
    port["withheld"] = harness["navigation"]["withheld"]
    n_tx = put_navigation(harness["codec"], port, truth["minor_frames"], tx)
    for i in range(n_tx):
        log_frame(harness, logs, tx[i])
    return n_tx


@kernel
def take_answer(harness: Record, logs: Logs, frames: Frames, n: int) -> bool:
    """Judge and log received frames; True once the cycle's command is complete."""
    port = harness["port"]
    cycle = harness["truth"]["minor_frames"]
    for i in range(n):
        log_frame(harness, logs, frames[i])
        take(harness["codec"], port, frames[i], cycle)
    return port["answered"] == 1


@kernel
def close_cycle(harness: Record, logs: Logs) -> int:
    """Judge the frame, fly it, and say how the flight stands."""
    world = harness["world"]
    truth = harness["truth"]
    port = harness["port"]
    if port["answered"] == 1:
        _log_command(harness, logs)
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
        n_tx = open_cycle(harness, logs, wire.tx)
        if send_frames(wire.fd, wire.io[0], wire.tx, n_tx) < 0:
            return BUS_LOST
        outcome = _await_answer(harness, logs, wire, timeout_ns)
        if outcome != FLYING:
            return outcome
        outcome = close_cycle(harness, logs)
        keep_in_journal(harness, logs)
        if outcome != FLYING:
            return outcome
    return FLYING
