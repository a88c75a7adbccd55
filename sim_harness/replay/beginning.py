"""From which frame of a recording on the flight computer heard.

It listens before it says so: between its opening of the bus and the harness's first frame it hears
what a third sender puts there. Its first report tells how many frames that were; from which one on
is found by trying, where the frame in which it says that it is ready is not the right one.
"""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from flight_sw.reception.receiver import HEARD_MODULUS
from sim_harness.replay.feed import (
    ANSWER,
    HEARD,
    NEITHER,
    REPORT,
    TIMED,
    Computers,
    Script,
    copied,
    feed,
    new_script,
)
from sim_harness.replay.script import (
    COMMAND_NAME,
    Heard,
    Reports,
    asked_at,
    heard_by_computer,
    hears_all,
    kinds_of,
)
from sim_harness.telemetry.reader import Recording

I8 = npt.NDArray[np.int64]

REPORTS_TRIED = 8  # false ones may stand before the first of the computer's own
ROWS_FED_MAX = 10_000_000  # in all guesses together: a second of trying
ROWS_A_GUESS = 2_000  # that could be fed while one is prepared
ROWS_BEHIND = 64  # over which answers must agree behind the report


def find_beginning(recording: Recording, computers: Computers, reports: Reports) -> Heard:
    """What the computer heard, as its first report tells; the default where none explains it.

    It answers nobody before it was asked for something: what stands before that is not its own.
    """
    default = heard_by_computer(recording)
    script = new_script(recording.bus, *default, hears_all(recording))
    budget = ROWS_FED_MAX
    may_be_first = (reports.counters == 0) & (reports.heard <= reports.rows)
    may_be_first &= reports.rows > asked_at(recording)
    for i in np.flatnonzero(may_be_first)[:REPORTS_TRIED].tolist():
        row = int(reports.rows[i])
        if default.kinds[row] != NEITHER and _is_explained(recording, computers, script, row, 0):
            return default
        for kinds, n_heard, first in _guesses(recording, row, int(reports.heard[i])):
            budget -= n_heard + ROWS_A_GUESS
            if budget < 0:
                return default
            ticks = np.array([n_heard] if reports.ticked[i] else [], np.int64)
            guess = script._replace(kinds=kinds, ticks=ticks)
            if _is_explained(recording, computers, guess, row, first):
                begun = kinds_of(recording)
                begun[: len(kinds)] = kinds
                begun[:first] = NEITHER
                return Heard(begun, ticks)
    return default


def _is_explained(
    recording: Recording, computers: Computers, script: Script, row: int, first: int
) -> bool:
    """Whether every answer agrees up to the report in this row, and what it counts."""
    trial = copied(computers)
    trial.feeders["row"] = first
    feed(trial, script, min(row + ROWS_BEHIND, recording.rows_before_gap, len(script.kinds)))
    feeder = trial.feeders[0]
    return bool(feeder["row"] > row and feeder["reports"] == 0)


def _readings(recording: Recording, row: int) -> list[I8]:
    """The rows up to behind a report: as they look, and with all before its answer as false."""
    kinds = kinds_of(recording)[: row + ROWS_BEHIND]
    if not hears_all(recording):
        return [kinds]
    commands = recording.slots[:row] == recording.decoder.slot(COMMAND_NAME)
    answer = int(np.flatnonzero(commands)[-1]) if commands.any() else row
    false = np.isin(kinds, (ANSWER, REPORT, TIMED)) & (np.arange(len(kinds)) < answer)
    return [np.where(false, HEARD, kinds), kinds]


def _guesses(recording: Recording, row: int, told: int) -> Iterator[tuple[I8, int, int]]:
    """Kinds, how many frames were heard before a report, and from which row on, the latest first.

    The readings take turns: neither uses up what the other has of trials.
    """
    readings = _readings(recording, row)
    heard_rows = [np.flatnonzero(kinds == HEARD) for kinds in readings]
    most = [int(np.searchsorted(rows, row)) for rows in heard_rows]
    for n_heard in range(told, max(most) + 1, HEARD_MODULUS):
        for back in range(max(most) - n_heard + 1):
            for kinds, rows, before in zip(readings, heard_rows, most, strict=True):
                first = before - n_heard - back
                if first >= 0:
                    yield kinds, n_heard, int(rows[first]) if first < len(rows) else row
