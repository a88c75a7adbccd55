"""The ring logs of a flight: the loop writes them, the caller takes from them.

A frame of the bus is logged by the loop that moves it, in memory and where nothing but the two
sides is on the bus. Elsewhere the harness's bus listener logs what it hears: see
sim_harness/bus/bus_listener.py.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.can.sockets import copy_frame
from flight_sw.computer import COMMAND
from flight_sw.records.dictionary import RX_CAPACITY
from flight_sw.records.types_ import Record
from sim_harness.fence import memory_fence
from sim_harness.jit import kernel

COMMANDS, BUS, TRUTHS, N_LOGS = 0, 1, 2, 3  # the ring logs
ROOM_FOR_A_CYCLE = 4 * RX_CAPACITY  # frames


class Logs(NamedTuple):
    """Caller-owned ring buffers: the loop writes, the caller takes; an empty one is not filled."""

    commands: npt.NDArray[np.void]  # dictionary.FRAME, every command flown
    bus: npt.NDArray[np.void]  # telemetry.records.BUS_LOG, every frame
    truth: npt.NDArray[np.void]  # TRUTH, every truth_divider-th minor frame


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
    copy_frame(frame, row["frame"])
    harness["written"][BUS] += 1


@kernel
def log_passing(harness: Record, logs: Logs, frame: Record) -> None:
    """Keep a frame that the loop itself moves, unless a bus listener hears it."""
    if harness["has_bus_listener"] == 0:
        log_frame(harness, logs, frame)


@kernel
def log_command(harness: Record, logs: Logs) -> None:
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
def log_truth(harness: Record, logs: Logs) -> None:
    """Keep the truth of every truth_divider-th minor frame."""
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
