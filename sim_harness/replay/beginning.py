"""From which frame of a recording on the flight computer heard.

It listens before it says so: between its opening of the bus and the harness's first frame it hears
what a third sender puts there. Its first report tells how many frames that were; from which one on
is found by trying, where the frame in which it says that it is ready is not the right one.
"""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from sim_harness.replay.feed import (
    ANSWER,
    HEARD,
    NEITHER,
    REPORT,
    TIMED,
    Computers,
    copied,
    feed,
    new_script,
)
from sim_harness.replay.script import (
    COMMAND_NAME,
    Heard,
    Reports,
    heard_by_computer,
    hears_all,
    kinds_of,
)
from sim_harness.telemetry.reader import Recording

I8 = npt.NDArray[np.int64]

REPORTS_TRIED = 8  # false ones may stand before the first of the computer's own
ROWS_FED_MAX = 10_000_000  # fed or copied in all guesses together: a second of trying
ROWS_BEHIND = 64  # over which answers must agree behind the report


def find_beginning(recording: Recording, computers: Computers, reports: Reports) -> Heard:
    """What the computer heard, as its first report tells; the default where none explains it."""
    default = heard_by_computer(recording)
    budget = ROWS_FED_MAX
    may_be_first = (reports.counters == 0) & (reports.heard <= reports.rows)
    for i in np.flatnonzero(may_be_first)[:REPORTS_TRIED].tolist():
        row = int(reports.rows[i])
        if default.kinds[row] != NEITHER and _is_explained(recording, computers, default, row):
            return default
        for kinds in _readings(recording, row):
            for guess in _beginnings(kinds, row, int(reports.heard[i]), bool(reports.ticked[i])):
                budget -= int(reports.heard[i]) + len(kinds) + ROWS_BEHIND
                if budget < 0:
                    return default
                if _is_explained(recording, computers, guess, row):
                    begun = kinds_of(recording)
                    begun[: len(guess.kinds)] = guess.kinds
                    return Heard(begun, guess.ticks)
    return default


def _is_explained(recording: Recording, computers: Computers, heard: Heard, row: int) -> bool:
    """Whether every answer agrees up to the report in this row, and what it counts."""
    script = new_script(recording.bus, *heard, hears_all(recording))
    trial = copied(computers)
    feed(trial, script, min(row + ROWS_BEHIND, recording.rows_before_gap, len(heard.kinds)))
    feeder = trial.feeders[0]
    return bool(feeder["row"] > row and feeder["reports"] == 0)


def _readings(recording: Recording, row: int) -> Iterator[I8]:
    """The rows up to behind a report: as they look, and with all before its answer as false."""
    kinds = kinds_of(recording)[: row + ROWS_BEHIND]
    yield kinds
    if hears_all(recording):
        commands = recording.slots[:row] == recording.decoder.slot(COMMAND_NAME)
        answer = int(np.flatnonzero(commands)[-1]) if commands.any() else row
        false = np.isin(kinds, (ANSWER, REPORT, TIMED)) & (np.arange(len(kinds)) < answer)
        yield np.where(false, HEARD, kinds)


def _beginnings(kinds: I8, row: int, n_heard: int, ticked: bool) -> Iterator[Heard]:
    """Guesses that have so many frames heard before the report in this row, the latest first."""
    rows = np.flatnonzero(kinds == HEARD)
    latest = int(np.searchsorted(rows, row)) - n_heard
    for first in range(latest, -1, -1):
        begun = kinds.copy()
        begun[: rows[first] if first < len(rows) else row] = NEITHER
        yield Heard(begun, np.array([n_heard] if ticked else [], np.int64))
