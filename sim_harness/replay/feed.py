"""Feeds recorded frames to the flight software and compares its answers, compiled and in bulk.

The rows of a recording are walked in bus order. A frame that the computer heard goes through its
`receive`; the answers of each cycle that closes wait in a queue, and every answer in the recording
must be the one at its head. Where it is not, the feed stops in front of that row.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw import icd
from flight_sw.can.e2e import counter_of
from flight_sw.computer import (
    COMMAND,
    COUNTER_MODULUS,
    CYCLE_MODULUS,
    STATUS,
    seal_of,
    step,
)
from flight_sw.executive import COUNT_MAX
from flight_sw.reception.navigation_set import receive
from flight_sw.reception.receiver import HEARD_MODULUS, slot_of
from flight_sw.records.dictionary import FRAME, TX_CAPACITY
from flight_sw.records.types_ import Frames, Record
from sim_harness.jit import kernel

I8 = npt.NDArray[np.int64]
Rows = npt.NDArray[np.void]

HEARD, ANSWER, NEITHER, REPORT, TIMED = 0, 1, 2, 3, 4
"""Kinds of rows: to the computer; of its own; of neither; own, and tells of its hearing; an
FSW_TIMING, which its executive adds when its clock says so."""
COUNTER_BITS = np.uint64(0xF00)  # of an answer's data
OVER, STOPPED, SILENT, CERTAIN = 0, 1, 2, 3  # why a feed ended; an answer that is no other's
QUEUE_FRAMES = 1 << 14  # answers without a counterpart in the recording: 50 s of a dead computer
QUEUE_MASK = QUEUE_FRAMES - 1

RECEPTION = icd.slot("RX_HEALTH_C")


def _place(message: str, signal: str) -> tuple[np.uint64, np.uint64]:
    """Where a signal's raw value lies in the frame's word, and its mask."""
    found = next(s for s in icd.layout(message).signals if s.name == signal)
    return np.uint64(found.start_bit), np.uint64((1 << found.bits) - 1)


HEARD_AT, HEARD_MASK = _place("RX_HEALTH_C", "heard")
TICKED_AT, TICKED_MASK = _place("RX_HEALTH_C", "ticked")
TICKS_AT, TICKS_MASK = _place("FSW_TIMING", "ticks")
CYCLE_AT, CYCLE_MASK = _place("FSW_STATUS", "cycle")
SEAL_AT, SEAL_MASK = _place("FSW_STATUS", "command_seal")
REPORT_ROWS = 64  # within which a report's last message follows its first
CYCLES_BEHIND_MAX = 250  # without an answer, and frames out of sequence may be the computer's

FEEDER = np.dtype(
    [
        ("row", "i8"),  # the next to be looked at
        ("heard", "i8"),  # frames fed so far
        ("tick", "i8"),  # ticks given so far
        ("ticks_told", "i8"),  # by answers found
        ("timings", "i8"),  # FSW_TIMING found
        ("queued", "i8"),  # answers ever put into the queue
        ("matched", "i8"),  # answers ever found in the recording
        ("command", "u8"),  # word of the last frame that carries a command
        ("cycle", "i8"),  # named by the last status found
        ("false_frames", "i8"),  # that posed as the computer's, out of sequence
        ("reports", "i8"),  # of frames that count otherwise, the computer having heard others
        ("heard_ahead", "i8"),  # frames that it had heard beyond those fed, by its last report
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
    ticks: I8  # frames heard before each tick of the executive that closed a cycle, ascending
    queue: Frames
    hears_all: bool
    """The computer hears what poses as its own, too."""
    settles: bool
    """What turns out to pose as the computer's is marked as such."""


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
def heard_of(frame: Record) -> np.int64:
    """Frames heard by then, modulo HEARD_MODULUS, in an RX_HEALTH_C."""
    return np.int64((frame["data"] >> HEARD_AT) & HEARD_MASK)


@kernel
def ticked_of(frame: Record) -> np.int64:
    """1 if a tick closed the cycle, as an RX_HEALTH_C tells."""
    return np.int64((frame["data"] >> TICKED_AT) & TICKED_MASK)


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
def _heard_ahead(computers: Computers, script: Script, row: int) -> np.int64:
    """By how much the frames heard differ in the report at `row` and in the one at hand.

    0 where only one of them tells of a tick: then that is to be found first.
    """
    feeder = computers.feeders[0]
    reception = computers.load[0]["codec"]["can_id"][RECEPTION]
    for i in range(row, min(row + REPORT_ROWS, len(script.rows))):
        if script.kinds[i] != REPORT or script.rows[i]["frame"]["can_id"] != reception:
            continue
        theirs = script.rows[i]["frame"]
        for k in range(feeder["matched"], feeder["queued"]):
            given = script.queue[k & QUEUE_MASK]
            if given["can_id"] == reception:
                if ticked_of(theirs) != ticked_of(given):
                    return np.int64(0)
                return (heard_of(theirs) - heard_of(given)) % HEARD_MODULUS
        return np.int64(0)
    return np.int64(0)


@kernel
def _may_report(computers: Computers, script: Script, row: int, given: Record) -> bool:
    """Whether a report differs because the computer had heard other frames than were fed."""
    frame = script.rows[row]["frame"]
    if script.kinds[row] != REPORT or frame["can_id"] != given["can_id"]:
        return False
    if (frame["data"] ^ given["data"]) & COUNTER_BITS != 0:
        return False
    ahead = _heard_ahead(computers, script, row)
    if ahead == 0:
        return False
    computers.feeders[0]["heard_ahead"] = ahead
    computers.feeders[0]["reports"] += 1
    return True


@kernel
def _match(computers: Computers, script: Script, row: int) -> bool:
    """Whether a recorded answer is the next that was given."""
    feeder = computers.feeders[0]
    if feeder["matched"] == feeder["queued"]:
        return False
    frame = script.rows[row]["frame"]
    given = script.queue[feeder["matched"] & QUEUE_MASK]
    if not _same(frame, given) and not _may_report(computers, script, row, given):
        return False
    feeder["matched"] += 1
    if frame["can_id"] == computers.load[0]["codec"]["can_id"][RECEPTION]:
        feeder["ticks_told"] += ticked_of(frame)
    if frame["can_id"] == computers.load[0]["codec"]["can_id"][STATUS]:
        feeder["cycles_matched"] += 1
        feeder["cycle"] = (frame["data"] >> CYCLE_AT) & CYCLE_MASK
    return True


@kernel
def _is_timing(computers: Computers, frame: Record) -> bool:
    """Whether an FSW_TIMING is the computer's: next in its sequence, with its count of ticks."""
    feeder = computers.feeders[0]
    if np.int64(counter_of(frame["data"])) != feeder["timings"] % COUNTER_MODULUS:
        return False
    ticks = np.int64((frame["data"] >> TICKS_AT) & TICKS_MASK)
    return ticks == min(feeder["ticks_told"], COUNT_MAX)


@kernel
def _is_certain(computers: Computers, frame: Record) -> bool:
    """Whether a status seals the command before it and names a cycle to come: no other's does."""
    feeder = computers.feeders[0]
    if frame["can_id"] != computers.load[0]["codec"]["can_id"][STATUS]:
        return False
    cycle = np.int64((frame["data"] >> CYCLE_AT) & CYCLE_MASK)
    ahead = (cycle - feeder["cycle"]) % CYCLE_MODULUS
    seal = np.int64((frame["data"] >> SEAL_AT) & SEAL_MASK)
    return 0 < ahead < CYCLE_MODULUS // 2 and seal == seal_of(feeder["command"])


@kernel
def _is_false(computers: Computers, script: Script, frame: Record) -> bool:
    """Whether an answer that was not given is none of the computer's.

    It counts each of its messages on by one, and sends none once it was told to stop.
    """
    feeder = computers.feeders[0]
    if computers.states[0]["stop"] == 1 and feeder["matched"] == feeder["queued"]:
        return True
    if feeder["cycles"] - feeder["cycles_matched"] > CYCLES_BEHIND_MAX:
        return False
    state = computers.states[0]
    slot = slot_of(computers.load[0]["codec"], frame["can_id"])
    counter = np.int64(state["tx_counter"][slot])
    for k in range(feeder["matched"], feeder["queued"]):
        given = script.queue[k & QUEUE_MASK]
        if given["can_id"] == frame["can_id"]:
            counter = np.int64(counter_of(given["data"]))
            break
    return counter != np.int64(counter_of(frame["data"]))


@kernel
def _hear(computers: Computers, frame: Record) -> bool:
    """Hand a frame to the computer; True when it closed a cycle."""
    computers.feeders[0]["heard"] += 1
    return receive(computers.load[0], computers.states[0], frame)


@kernel
def _hear_false(computers: Computers, script: Script, row: int) -> None:
    """A frame that only poses as the computer's: on a hub it hears it."""
    computers.feeders[0]["false_frames"] += 1
    if script.settles:
        script.kinds[row] = HEARD if script.hears_all else NEITHER
    if script.hears_all:
        _hear(computers, script.rows[row]["frame"])


@kernel
def feed(computers: Computers, script: Script, until: int) -> int:
    """Go on to row `until`: OVER, STOPPED or CERTAIN at an answer that differs, or SILENT."""
    feeder = computers.feeders[0]
    for row in range(feeder["row"], until):
        feeder["row"] = row
        while (
            feeder["tick"] < len(script.ticks) and script.ticks[feeder["tick"]] <= feeder["heard"]
        ):
            feeder["tick"] += 1
            _close(computers, script)
        feeder["row"] = row + 1  # where to go on, unless this row is a stop
        if feeder["queued"] - feeder["matched"] > QUEUE_FRAMES - TX_CAPACITY:
            return SILENT
        kind = script.kinds[row]
        if kind == HEARD:
            if _hear(computers, script.rows[row]["frame"]):
                _close(computers, script)
        elif kind == TIMED and _is_timing(computers, script.rows[row]["frame"]):
            feeder["timings"] += 1
        elif kind == TIMED:
            _hear_false(computers, script, row)
        elif kind != NEITHER:
            frame = script.rows[row]["frame"]
            if frame["can_id"] == computers.load[0]["codec"]["can_id"][COMMAND]:
                feeder["command"] = frame["data"]
            if _match(computers, script, row):
                continue
            if _is_certain(computers, frame) or not _is_false(computers, script, frame):
                feeder["row"] = row
                return CERTAIN if _is_certain(computers, frame) else STOPPED
            _hear_false(computers, script, row)
    return OVER


def new_computers(load: Frames, state: Frames) -> Computers:
    """A computer before its first frame."""
    return Computers(load, np.repeat(state, 3), np.zeros(3, FEEDER), np.zeros(TX_CAPACITY, FRAME))


def new_script(rows: Rows, kinds: I8, ticks: I8, hears_all: bool = True) -> Script:
    """A script; its queue is to be zero, for the bytes that no frame uses."""
    return Script(rows, kinds, ticks, np.zeros(QUEUE_FRAMES, FRAME), hears_all, settles=False)


def copied(computers: Computers) -> Computers:
    """The computer as it was after the cycle before the last, for a trial."""
    states, feeders = computers.states[[2, 2, 2]], computers.feeders[[2, 2, 2]]
    return computers._replace(states=states, feeders=feeders)
