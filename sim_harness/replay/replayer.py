"""Replays a recording: the same answers to the same frames, or the first that differs.

What the rows of a recording do not show by themselves: from which of them on the computer heard,
where among them the executive's ticks closed cycles whose time message was overdue, and which
frames only posed as the computer's. Its reports say how many frames it had heard, and whether a
tick closed the cycle. Each reading of them is tried, and kept if the answers then agree to the bit:
a false report finds no such place.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.computer import new_state
from flight_sw.load_image import LoadImage, activate
from flight_sw.reception.receiver import HEARD_MODULUS
from flight_sw.records.types_ import Frames
from flight_sw.runtime.identity import ALONE
from sim_harness.replay.beginning import find_beginning
from sim_harness.replay.feed import (
    ANSWER,
    CERTAIN,
    HEARD,
    NEITHER,
    OVER,
    QUEUE_MASK,
    REPORT,
    SILENT,
    Computers,
    Script,
    copied,
    feed,
    new_computers,
    new_script,
)
from sim_harness.replay.script import (
    Heard,
    attached_load,
    check_dbc,
    computer_of,
    hears_all,
    is_paced,
    reports_of,
)
from sim_harness.telemetry.reader import Recording
from sim_harness.telemetry.records import BUS_LOG

I8 = npt.NDArray[np.int64]

LOOK_AHEAD = 400  # rows over which a guess must hold up
REPORTS_TRIED = 8  # of those that come next: false ones may stand before the computer's own
FALSE_IN_ROW_MAX = 64  # frames that pose as the computer's, in sequence, between two of its own
FALSE_IN_SEQUENCE = 1 / 8  # at most, of those at the end: two times what chance has of 16 counters
TRIALS_MIN, ROWS_PER_TRIAL = 20_000, 2  # that are made before a difference is told
STOPS_MAX = 64  # at one row: each tick found there is one
NO_ROWS = np.zeros(0, np.int64)
ANSWERED_MAX = 2  # cycles without an answer that the end of any flight may have


class Difference(NamedTuple):
    """The first answer that is not the recorded one."""

    t_s: float
    minor_frame: int
    message: str
    signal: str
    recorded: float | str
    replayed: float | str


@dataclass
class Replay:
    """How a replay went."""

    cycles: int = 0
    """Minor frames whose answers agree to the bit."""
    frames: int = 0
    """Answers that agree."""
    until_s: float = 0.0
    ticks: I8 = field(default_factory=lambda: np.zeros(0, np.int64))
    """Frames heard before each cycle that was closed without its time message."""
    false_frames: int = 0
    """Frames that looked like the computer's own and were not."""
    reports: int = 0
    """Reports that count otherwise, where the computer had not heard all that was recorded."""
    unanswered: int = 0
    """Minor frames at the end that the computer did not answer any more."""
    gap_s: float | None = None
    """Since when minor frames are missing in the recording."""
    difference: Difference | None = None

    @property
    def is_identical(self) -> bool:
        """Whether nothing differs."""
        return self.difference is None


def new_computer(image: LoadImage, number: int) -> Computers:
    """A computer that flies this load and obeys requests for the one with this number."""
    return new_computers(activate(image).copy(), new_state(image.law, number))


def warm_up(image: LoadImage) -> None:
    """Compile, or read from the cache, what a replay of this law takes."""
    rows = np.zeros(0, BUS_LOG)
    feed(new_computer(image, ALONE), new_script(rows, NO_ROWS, NO_ROWS), 0)


class Replayer:
    """Feeds one recording to the load that came with it."""

    def __init__(self, recording: Recording, image: LoadImage | None = None) -> None:
        check_dbc(recording)
        self.recording = recording
        self.image = image or attached_load(recording)
        self._computers = new_computer(self.image, computer_of(recording))
        self._end = recording.rows_before_gap
        self._may_tick = is_paced(recording)
        self._false_kind = HEARD if hears_all(recording) else NEITHER
        self._reports = reports_of(recording)
        heard = find_beginning(recording, self._computers, self._reports)
        self._script = new_script(recording.bus, *heard, hears_all(recording))
        self._script = self._script._replace(settles=True)
        self._stopped_at = self._stops_here = 0
        self._trials_left = TRIALS_MIN + len(recording.bus) // ROWS_PER_TRIAL
        self._answers = np.isin(heard.kinds, (ANSWER, REPORT))

    @property
    def heard(self) -> Heard:
        """What the computer heard, as far as the replay has found it out."""
        return Heard(self._script.kinds, self._script.ticks)

    def run(self) -> Replay:
        """Replay to the end, or to the first difference."""
        while True:
            ended = int(feed(self._computers, self._script, self._end))
            if ended in (OVER, SILENT):
                return self._told(None)
            row = int(self._computers.feeders["row"][0])
            if not self._find_tick(row) and (ended == CERTAIN or not self._take_as_false(row)):
                return self._told(self._difference())
            if not self._goes_on(row):
                return self._told(self._difference())

    def state_at(self, t_s: float) -> Frames:
        """The computer's memory, shape (1,), after what was recorded before a mission time, as far
        as the answers agree; a replayer is used for this or for `run`, once."""
        self._end = min(self._end, int(np.searchsorted(self.recording.bus["t_s"], t_s)))
        self.run()
        return self._computers.states[:1]

    def _goes_on(self, row: int) -> bool:
        """Whether the stops come ever later, and not too many trials were made for them.

        A reading that was kept leads beyond the row at which it was looked for, or it is none.
        """
        self._stops_here = self._stops_here + 1 if row <= self._stopped_at else 0
        self._stopped_at = max(self._stopped_at, row)
        return self._stops_here < STOPS_MAX and self._trials_left > 0

    def _told(self, difference: Difference | None) -> Replay:
        feeder, rows = self._computers.feeders[0], self.recording.bus
        last = int(feeder["row"]) - 1
        behind = int(feeder["cycles"] - feeder["cycles_matched"])
        has_gap = self._end < len(rows) and difference is None
        return Replay(
            cycles=int(feeder["cycles_matched"]),
            frames=int(feeder["matched"]),
            until_s=float(rows["t_s"][last]) if last >= 0 else 0.0,
            ticks=self._script.ticks,
            false_frames=int(np.count_nonzero(self._answers & ~self._is_answer())),
            reports=int(feeder["reports"]),
            unanswered=behind if behind > ANSWERED_MAX and difference is None else 0,
            gap_s=float(rows["t_s"][self._end - 1]) if has_gap and self._end else None,
            difference=difference,
        )

    def _is_answer(self) -> npt.NDArray[np.bool_]:
        return np.isin(self._script.kinds, (ANSWER, REPORT))

    # --- what may stand behind an answer that was not expected ---------------------------------

    def _find_tick(self, row: int) -> bool:
        """Take a report that comes next as that of a cycle closed by a tick, if all then agrees."""
        known = int(self._computers.feeders["tick"][0])
        reports = self._reports
        first = int(np.searchsorted(reports.rows, row)) if self._may_tick else len(reports.rows)
        for i in range(first, min(first + REPORTS_TRIED, len(reports.rows))):
            if not reports.ticked[i] or reports.rows[i] > row + LOOK_AHEAD:
                continue
            guess = np.append(self._script.ticks[:known], self._heard_before(int(reports.heard[i])))
            _, trial = self._tried(self._script._replace(ticks=guess), row)
            if trial["row"] > reports.rows[i]:
                self._script = self._script._replace(ticks=guess)
                self._restore()
                return True
        return False

    def _heard_before(self, told: int) -> int:
        """How many frames were fed when the computer had heard as many as it told."""
        before = self._computers.feeders[2]
        fed, ahead = int(before["heard"]), int(self._computers.feeders["heard_ahead"][0])
        return fed + (told - ahead - fed) % HEARD_MODULUS

    def _take_as_false(self, row: int) -> bool:
        """Try whether the answers go on behind frames that the computer has not sent.

        With a tick, or without. Behind its last answer of all only those are taken that many others
        out of sequence go with, which cannot be its own.
        """
        feeder, kinds = self._computers.feeders[0], self._script.kinds
        matched, taken = int(feeder["matched"]), dict[int, int]()
        others, before = 0, int(self._computers.feeders["false_frames"][2])
        while self._trials_left > 0 and len(taken) < max(
            FALSE_IN_ROW_MAX, FALSE_IN_SEQUENCE * others
        ):
            taken[row], kinds[row] = int(kinds[row]), self._false_kind
            ended, trial = self._tried(self._script, self._end)
            row, others = int(trial["row"]), int(trial["false_frames"]) - before
            is_over = row >= self._end
            if trial["matched"] > matched or (is_over and len(taken) < FALSE_IN_SEQUENCE * others):
                self._restore()
                return True
            if not is_over and self._find_tick(row):
                return True
            if is_over or ended == CERTAIN:
                break
        for row, kind in taken.items():
            kinds[row] = kind
        return False

    def _restore(self) -> None:
        self._computers.states[:2] = self._computers.states[2]
        self._computers.feeders[:2] = self._computers.feeders[2]

    def _tried(self, script: Script, row: int) -> tuple[int, Frames]:
        """Where another script leads, up to the look-ahead behind a row, and why it ends there."""
        self._trials_left -= 1
        trial = copied(self._computers)
        ended = feed(trial, script._replace(settles=False), min(row + LOOK_AHEAD, self._end))
        return int(ended), trial.feeders[0]

    # --- telling a difference ------------------------------------------------------------------

    def _difference(self) -> Difference:
        feeder, recording = self._computers.feeders[0], self.recording
        row = recording.bus[int(feeder["row"])]
        where = float(row["t_s"]), int(feeder["cycles_matched"])
        message = _name(recording, row["frame"])
        if feeder["matched"] == feeder["queued"]:
            return Difference(*where, message, "", "sent", "not sent")
        given = self._script.queue[int(feeder["matched"]) & QUEUE_MASK]
        if given["can_id"] != row["frame"]["can_id"]:
            return Difference(*where, "answer", "", message, _name(recording, given))
        ours, theirs = (_values(recording, frame) for frame in (given, row["frame"]))
        for name, value in theirs.items():
            if value != ours[name]:
                return Difference(*where, message, name, value, ours[name])
        return Difference(*where, message, "e2e_counter", *_counters(row["frame"], given))


def _name(recording: Recording, frame: Frames) -> str:
    names = {m.can_id: m.name for m in recording.decoder.messages}
    return names.get(int(frame["can_id"]), f"identifier {int(frame['can_id'])}")


def _values(recording: Recording, frame: Frames) -> dict[str, float]:
    decoder = recording.decoder
    slot = decoder.slot(_name(recording, frame))
    columns = decoder.columns(slot, np.array([frame["data"]], np.uint64))
    return {name: column[0].item() for name, column in columns.items()}


def _counters(*frames: Frames) -> tuple[float, float]:
    first, second = (float(int(frame["data"]) >> 8 & 0xF) for frame in frames)
    return first, second
