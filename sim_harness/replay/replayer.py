"""Replays a recording: the same answers to the same frames, or the first that differs.

What a recording does not show are the executive's ticks, with which it closed cycles whose time
message was overdue. They are found from their answers: where one turns up that no time message
accounts for, a tick is tried before each frame heard since, and kept if the answers then agree.
A tick can so be found only where it leads to the very bits that were recorded.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.computer import new_state
from flight_sw.load_image import LoadImage, activate
from flight_sw.types_ import Frames
from sim_harness.replay.feed import (
    HEARD,
    OVER,
    QUEUE_MASK,
    SILENT,
    STOPPED,
    Computers,
    feed,
    new_computers,
    new_script,
)
from sim_harness.replay.script import attached_load, check_dbc, is_paced, kinds_of
from sim_harness.telemetry.reader import Recording
from sim_harness.telemetry.records import BUS_LOG

I8 = npt.NDArray[np.int64]

LOOK_AHEAD = 400  # rows over which a guess must hold up
TRIES_MAX = 4000  # guesses for one answer that was not expected
TICKS_MAX = 250  # in a row
FALSE_IN_ROW_MAX = 64  # frames that pose as the computer's between two of its answers
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
    """Rows before which a cycle was closed without its time message."""
    false_frames: int = 0
    """Frames that looked like the computer's own and were not."""
    reports: int = 0
    """Reports of refused frames that count otherwise, where a third sender is on the bus."""
    unanswered: int = 0
    """Minor frames at the end that the computer did not answer any more."""
    gap_s: float | None = None
    """Since when minor frames are missing in the recording."""
    difference: Difference | None = None

    @property
    def is_identical(self) -> bool:
        """Whether nothing differs."""
        return self.difference is None


def new_computer(image: LoadImage, crc32: int) -> Computers:
    """A computer that flies this load and obeys requests for the one with this CRC."""
    load = activate(image).copy()
    load["crc32"] = crc32
    return new_computers(load, new_state(image.law))


def warm_up(image: LoadImage) -> None:
    """Compile, or read from the cache, what a replay of this law takes."""
    rows = np.zeros(0, BUS_LOG)
    feed(new_computer(image, 0), new_script(rows, np.zeros(0, np.int64)), 0)


class Replayer:
    """Feeds one recording to the load that came with it."""

    def __init__(self, recording: Recording, image: LoadImage | None = None) -> None:
        check_dbc(recording)
        self.recording = recording
        self.image = image or attached_load(recording)
        self.kinds = kinds_of(recording)
        self.script = new_script(recording.bus, self.kinds)
        self.computers = new_computer(self.image, self.image.crc32)
        self._end = recording.rows_before_gap
        self._may_tick = is_paced(recording)
        self._false_frames = 0

    def run(self) -> Replay:
        """Replay to the end, or to the first difference."""
        while True:
            ended = int(feed(self.computers, self.script, self._end))
            if ended in (OVER, SILENT):
                return self._told(None)
            if not self._resolve():
                return self._told(self._difference())

    def _told(self, difference: Difference | None) -> Replay:
        feeder, rows = self.computers.feeders[0], self.recording.bus
        last = int(feeder["row"]) - 1
        behind = int(feeder["cycles"] - feeder["cycles_matched"])
        has_gap = self._end < len(rows) and difference is None
        return Replay(
            cycles=int(feeder["cycles_matched"]),
            frames=int(feeder["matched"]),
            until_s=float(rows["t_s"][last]) if last >= 0 else 0.0,
            ticks=self.script.ticks,
            false_frames=self._false_frames,
            reports=int(feeder["reports"]),
            unanswered=behind if behind > ANSWERED_MAX and difference is None else 0,
            gap_s=float(rows["t_s"][self._end - 1]) if has_gap and self._end else None,
            difference=difference,
        )

    # --- what may stand behind an answer that was not expected ---------------------------------

    def _resolve(self) -> bool:
        """Find ticks, or a false frame, that account for the row at which the feed stopped."""
        feeder, before = self.computers.feeders[0], self.computers.feeders[2]
        row, matched = int(feeder["row"]), int(feeder["matched"])
        if self._may_tick:
            known = self.script.ticks[: int(feeder["tick"])]
            search = _Search(self, TRIES_MAX, (matched, known))
            search.ticks_from(known, int(before["row"]), row, matched)
            if search.best[0] > matched:
                self._restore()
                self.script = self.script._replace(ticks=search.best[1])
                return True
        return self._take_as_false(matched)

    def _take_as_false(self, matched: int) -> bool:
        """Try whether the answers go on behind frames that the computer has heard, not sent."""
        row, taken = int(self.computers.feeders["row"][0]), []
        before = self.kinds.copy()
        for _ in range(FALSE_IN_ROW_MAX):
            self.kinds[row] = HEARD
            taken.append(row)
            holds, found, row = self.tried(self.script.ticks, self._end)
            if found > matched:
                self._false_frames += len(taken)
                self._restore()
                return True
            if holds:
                break
        self.kinds[taken] = before[taken]
        return False

    def places_for_a_tick(self, floor: int, row: int) -> list[int]:
        """Before each of the frames heard since, then before the row itself."""
        heard = np.arange(floor, row)
        return [*heard[self.kinds[heard] == HEARD].tolist(), row]

    def _restore(self) -> None:
        self.computers.states[:2] = self.computers.states[2]
        self.computers.feeders[:2] = self.computers.feeders[2]

    def tried(self, ticks: I8, row: int) -> tuple[bool, int, int]:
        """Whether a guess holds up over the look-ahead; answers found, and the row reached."""
        states, feeders = self.computers.states[[2, 2, 2]], self.computers.feeders[[2, 2, 2]]
        trial = self.computers._replace(states=states, feeders=feeders)
        script = self.script._replace(ticks=ticks)
        ended = int(feed(trial, script, min(row + LOOK_AHEAD, self._end)))
        return ended != STOPPED, int(feeders["matched"][0]), int(feeders["row"][0])

    # --- telling a difference ------------------------------------------------------------------

    def _difference(self) -> Difference:
        feeder, recording = self.computers.feeders[0], self.recording
        row = recording.bus[int(feeder["row"])]
        where = float(row["t_s"]), int(feeder["cycles_matched"])
        message = _name(recording, row["frame"])
        if feeder["matched"] == feeder["queued"]:
            return Difference(*where, message, "", "sent", "not sent")
        given = self.script.queue[int(feeder["matched"]) & QUEUE_MASK]
        if given["can_id"] != row["frame"]["can_id"]:
            return Difference(*where, "answer", "", message, _name(recording, given))
        ours, theirs = (_values(recording, frame) for frame in (given, row["frame"]))
        for name, value in theirs.items():
            if value != ours[name]:
                return Difference(*where, message, name, value, ours[name])
        return Difference(*where, message, "e2e_counter", *_counters(row["frame"], given))


class _Search:
    """Where ticks fell, found by trying; the best guess is kept even if none holds up."""

    def __init__(self, replayer: Replayer, tries: int, start: tuple[int, I8]) -> None:
        self._replayer = replayer
        self._tries = tries
        self.best = start

    def ticks_from(self, ticks: I8, floor: int, row: int, matched: int) -> bool:
        """Add ticks from row `floor` on until the answers agree; True once they do."""
        if len(ticks) - len(self.best[1]) > TICKS_MAX:
            return False
        for place in self._replayer.places_for_a_tick(floor, row):
            self._tries -= 1
            if self._tries < 0:
                return False
            guess = np.append(ticks, place)
            holds, found, reached = self._replayer.tried(guess, row)
            if found <= matched:
                continue
            if found > self.best[0]:
                self.best = found, guess
            if holds or self.ticks_from(guess, place, reached, found):
                return True
        return False


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
