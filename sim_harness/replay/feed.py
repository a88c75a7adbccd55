"""Feeds recorded frames to the flight software and compares its answers, compiled and in bulk.

The rows of a recording are walked in bus order. A frame that the computer heard goes through its
`receive`; the answers of each cycle that closes wait in a queue, and every answer in the recording
must be the one at its head. Where it is not, the feed stops in front of that row.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.computer import STATUS, receive, step
from flight_sw.dictionary import FRAME, TX_CAPACITY
from flight_sw.types_ import Frames, Record
from sim_harness.jit import kernel

I8 = npt.NDArray[np.int64]
Rows = npt.NDArray[np.void]

HEARD, ANSWER, NEITHER, REPORT = 0, 1, 2, 3  # kinds of rows
COUNTER_BITS = np.uint64(0xF00)  # of an answer's data
OVER, STOPPED, SILENT = 0, 1, 2  # why a feed ended
QUEUE_FRAMES = 1 << 14  # answers without a counterpart in the recording: 50 s of a dead computer
QUEUE_MASK = QUEUE_FRAMES - 1

FEEDER = np.dtype(
    [
        ("row", "i8"),  # the next to be looked at
        ("tick", "i8"),  # ticks given so far
        ("queued", "i8"),  # answers ever put into the queue
        ("matched", "i8"),  # answers ever found in the recording
        ("reports", "i8"),  # of refused frames that count otherwise
        ("cycles", "i8"),  # closed
        ("cycles_matched", "i8"),  # whose last answer was found
    ],
    align=True,
)
"""Where the feed stands."""


class Script(NamedTuple):
    """What is fed, in which order."""

    rows: Rows  # BUS_LOG
    kinds: I8
    ticks: I8  # rows before which the executive closed a cycle by a tick, ascending
    queue: Frames


class Computers(NamedTuple):
    """The computer that is fed, and as it was after each of the last two cycles.

    Row 0 is now. Row 1 is after the last cycle that closed with all answers before it found, row 2
    after the one before that: a tick whose answer has just turned up came after row 2.
    """

    load: Frames
    states: Frames  # (3,)
    feeders: Frames  # (3,)
    tx: Frames


@kernel
def _same(frame: Record, other: Record) -> bool:
    return (
        frame["data"] == other["data"]
        and frame["can_id"] == other["can_id"]
        and frame["dlc"] == other["dlc"]
    )


@kernel
def _close(computers: Computers, script: Script) -> None:
    """Run the cycle that has just closed and queue its answers."""
    feeder = computers.feeders[0]
    keep = feeder["matched"] == feeder["queued"]
    n_tx = step(computers.load[0], computers.states[0], computers.tx, 0)
    for i in range(n_tx):
        frame = script.queue[feeder["queued"] & QUEUE_MASK]
        frame["can_id"] = computers.tx[i]["can_id"]
        frame["dlc"] = computers.tx[i]["dlc"]
        frame["data"] = computers.tx[i]["data"]
        feeder["queued"] += 1
    feeder["cycles"] += 1
    if keep:
        for older in range(2, 0, -1):
            computers.states[older] = computers.states[older - 1]
            computers.feeders[older] = computers.feeders[older - 1]


@kernel
def _match(computers: Computers, script: Script, row: int) -> bool:
    """Whether a recorded answer is the next that was given."""
    feeder = computers.feeders[0]
    if feeder["matched"] == feeder["queued"]:
        return False
    frame = script.rows[row]["frame"]
    given = script.queue[feeder["matched"] & QUEUE_MASK]
    if not _same(frame, given):
        if script.kinds[row] != REPORT or frame["can_id"] != given["can_id"]:
            return False
        if (frame["data"] ^ given["data"]) & COUNTER_BITS != 0:
            return False
        feeder["reports"] += 1
    feeder["matched"] += 1
    if frame["can_id"] == computers.load[0]["codec"]["can_id"][STATUS]:
        feeder["cycles_matched"] += 1
    return True


@kernel
def feed(computers: Computers, script: Script, until: int) -> int:
    """Go on to row `until`: OVER, STOPPED at an answer that differs, or SILENT."""
    feeder = computers.feeders[0]
    for row in range(feeder["row"], until):
        feeder["row"] = row
        while feeder["tick"] < len(script.ticks) and script.ticks[feeder["tick"]] <= row:
            feeder["tick"] += 1
            _close(computers, script)
        feeder["row"] = row + 1  # where to go on, unless this row is a stop
        if feeder["queued"] - feeder["matched"] > QUEUE_FRAMES - TX_CAPACITY:
            return SILENT
        kind = script.kinds[row]
        if kind == HEARD:
            if receive(computers.load[0], computers.states[0], script.rows[row]["frame"]):
                _close(computers, script)
        elif kind != NEITHER and not _match(computers, script, row):
            feeder["row"] = row
            return STOPPED
    return OVER


def new_computers(load: Frames, state: Frames) -> Computers:
    """A computer before its first frame."""
    return Computers(load, np.repeat(state, 3), np.zeros(3, FEEDER), np.zeros(TX_CAPACITY, FRAME))


def new_script(rows: Rows, kinds: I8) -> Script:
    """A script without ticks; its queue is to be zero, for the bytes that no frame uses."""
    return Script(rows, kinds, np.zeros(0, np.int64), np.zeros(QUEUE_FRAMES, FRAME))
