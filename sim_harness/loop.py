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
from sim_harness.jit import kernel
from sim_harness.metrics import METRICS, judge_frame
from sim_harness.navigation import NAV_STATE, measure
from sim_harness.port import PORT, put_navigation, take
from sim_harness.vehicle import advance, ended
from sim_harness.world.records import FLYING, TRUTH, WORLD

BUS_LOST = 101
COMPUTER_SILENT = 102
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
        ("n_commands", "i8"),  # rows in use of each log
        ("n_bus", "i8"),
        ("n_truth", "i8"),
        ("bus_rows_lost", "i8"),  # frames that found the log full
    ],
    align=True,
)
"""Everything of one flight on the harness's side."""


class Logs(NamedTuple):
    """Caller-owned arrays that a call fills from their start; an empty one is not filled."""

    commands: npt.NDArray[np.void]  # dictionary.FRAME, every command frame
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
def _log_frame(harness: Record, logs: Logs, frame: Record) -> None:
    """Keep one frame of the bus, and once more if it is a command."""
    if len(logs.bus) > 0 and harness["n_bus"] >= len(logs.bus):
        harness["bus_rows_lost"] += 1
    elif len(logs.bus) > 0:
        row = logs.bus[harness["n_bus"]]
        row["t_s"] = harness["truth"]["t_s"]
        _copy_frame(row["frame"], frame)
        harness["n_bus"] += 1
    if frame["can_id"] == harness["codec"]["can_id"][COMMAND] and harness["n_commands"] < len(
        logs.commands
    ):
        _copy_frame(logs.commands[harness["n_commands"]], frame)
        harness["n_commands"] += 1


@kernel
def _has_room(harness: Record, logs: Logs) -> bool:
    """Whether the logs take one more cycle, at its most frames."""
    return (
        harness["n_commands"] + RX_CAPACITY <= len(logs.commands)
        and (len(logs.bus) == 0 or harness["n_bus"] + 4 * RX_CAPACITY <= len(logs.bus))
        and (len(logs.truth) == 0 or harness["n_truth"] < len(logs.truth))
    )


@kernel
def _log_truth(harness: Record, logs: Logs) -> None:
    truth = harness["truth"]
    if len(logs.truth) > 0 and truth["minor_frames"] % harness["truth_divider"] == 0:
        logs.truth[harness["n_truth"]] = truth
        harness["n_truth"] += 1


@kernel
def _open_cycle(harness: Record, logs: Logs, tx: Frames) -> int:
    """Measure and put the cycle's navigation set into `tx`."""
    truth = harness["truth"]
    port = harness["port"]
    _log_truth(harness, logs)
    measure(harness["world"], truth, harness["navigation"], port["values"])
    n_tx = put_navigation(harness["codec"], port, truth["minor_frames"], tx)
    if len(logs.bus) > 0:
        for i in range(n_tx):
            _log_frame(harness, logs, tx[i])
    return n_tx


@kernel
def _take_answer(harness: Record, logs: Logs, frames: Frames, n: int) -> bool:
    """Judge and log received frames; True once the cycle's command is complete."""
    port = harness["port"]
    cycle = harness["truth"]["minor_frames"]
    for i in range(n):
        _log_frame(harness, logs, frames[i])
        take(harness["codec"], port, frames[i], cycle)
    return port["answered"] == 1


@kernel
def _close_cycle(harness: Record) -> int:
    """Judge the frame, fly it, and say how the flight stands."""
    world = harness["world"]
    truth = harness["truth"]
    port = harness["port"]
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
    """Fly up to `cycles` minor frames with the computer's minor frame called directly."""
    harness = harnesses[0]
    load = loads[0]
    state = states[0]
    step_time = step_times[0]
    for _ in range(cycles):
        if not _has_room(harness, logs):
            return FLYING
        n_rx = _open_cycle(harness, logs, rx)
        start_ns = monotonic_ns()
        n_tx = minor_frame(load, state, rx, n_rx, tx)
        add(step_time, monotonic_ns() - start_ns)
        if not _take_answer(harness, logs, tx, n_tx):
            return COMPUTER_SILENT
        outcome = _close_cycle(harness)
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
        if n_rx > 0 and _take_answer(harness, logs, wire.rx, n_rx):
            return FLYING
        if monotonic_ns() > deadline_ns:
            return COMPUTER_SILENT


@kernel
def fly_in_lockstep(harnesses: Frames, wire: Wire, logs: Logs, cycles: int, timeout_ns: int) -> int:
    """Fly up to `cycles` minor frames, each waiting for the computer's answer on the bus."""
    harness = harnesses[0]
    for _ in range(cycles):
        if not _has_room(harness, logs):
            return FLYING
        n_tx = _open_cycle(harness, logs, wire.tx)
        if send_frames(wire.fd, wire.io[0], wire.tx, n_tx) < 0:
            return BUS_LOST
        outcome = _await_answer(harness, logs, wire, timeout_ns)
        if outcome != FLYING:
            return outcome
        outcome = _close_cycle(harness)
        if outcome != FLYING:
            return outcome
    return FLYING
