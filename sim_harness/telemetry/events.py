"""Turns what the flight computer reports on the bus into events: mode, tracking, fix, doubt."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.icd import Message, Signal
from sim_harness.telemetry.decode import Decoder
from sim_harness.telemetry.records import LogLevel, LogLine

F8 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int64]
Rows = npt.NDArray[np.void]

MODE = ("FSW_STATUS", "mode")
WATCHED = {
    MODE: "mode",
    ("FSW_STATUS", "phase"): "guidance phase",
    ("FSW_STATUS", "tracking"): "tracking",
    ("FSW_STATUS", "fix_valid"): "navigation fix",
    ("FSW_BOOT", "state"): "flight computer",
    ("GROUND_REQUEST", "request"): "ground request",
}
"""Signals whose changes are events, and what they are called."""

COUNTED = {("RX_HEALTH_A", "candidates_believed"): "doubted navigation believed"}
"""Counters whose rises are events of their own, and alarming; they begin at 0."""

ALARMING = {("mode", "SAFE"), ("navigation fix", "off")}
SWITCH = {0: "off", 1: "on"}


class Watch(NamedTuple):
    """One signal to look at."""

    slot: int
    column: int
    title: str
    names: dict[int, str]
    is_event: bool
    """Every frame is an event, not only a change."""
    is_count: bool


def value_names(signal: Signal) -> dict[int, str]:
    """What the values of a signal are called; switches are off and on."""
    return dict(signal.names) or (SWITCH if signal.bits == 1 else {})


def changes(values: I8, before: int | None = None) -> I8:
    """Where a value differs from the one before it; the first counts if there was none."""
    first = [True] if before is None else [int(values[0]) != before]
    return np.flatnonzero(np.concatenate([first, values[1:] != values[:-1]]))


class Events:
    """Remembers what was reported last, and makes a line of the log of each change."""

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder
        self._watches = [
            Watch(
                slot, column, title, value_names(signal), message.cycle_ms == 0,
                (message.name, signal.name) in COUNTED,
            )
            for slot, message in enumerate(decoder.messages)
            for column, signal, title in _watched_in(message)
        ]  # fmt: skip
        self._last = {watch.title: 0 for watch in self._watches if watch.is_count}

    def lines(self, rows: Rows, slots: I8) -> list[LogLine]:
        """The events in these frames, in order of time."""
        found: list[LogLine] = []
        for slot in {watch.slot for watch in self._watches}:
            mine = np.flatnonzero(slots == slot)
            if not mine.size:
                continue
            raw, _ = self._decoder.values(slots[mine], rows["frame"]["data"][mine])
            t_s = rows["t_s"][mine]
            for watch in self._watches:
                if watch.slot == slot:
                    found += self._lines_of(watch, t_s, raw[:, watch.column])
        return sorted(found, key=lambda line: line.t_s)

    def _lines_of(self, watch: Watch, t_s: F8, values: I8) -> list[LogLine]:
        last = None if watch.is_event else self._last.get(watch.title)
        places = np.arange(len(values)) if watch.is_event else changes(values, last)
        self._last[watch.title] = int(values[-1])
        lines = []
        for place in places.tolist():
            value = int(values[place])
            name = watch.names.get(value, str(value))
            was = "" if last is None else f", was {watch.names.get(last, str(last))}"
            alarming = watch.is_count or (watch.title, name) in ALARMING
            level = LogLevel.WARNING if alarming else LogLevel.INFO
            lines.append(LogLine(float(t_s[place]), level, f"{watch.title} {name}{was}"))
            last = None if watch.is_event else value
        return lines


def _watched_in(message: Message) -> list[tuple[int, Signal, str]]:
    titles = WATCHED | COUNTED
    return [
        (column, signal, titles[message.name, signal.name])
        for column, signal in enumerate(message.signals)
        if (message.name, signal.name) in titles
    ]
