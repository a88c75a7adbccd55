"""Turns what the flight computer reports on the bus into events: mode, tracking, fix, doubt.

Of their telemetry the laws say themselves what is an event (EVENTS of their modules).
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.guidance import LAWS
from flight_sw.icd import Message, Signal
from flight_sw.records.events import Event
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


OF_LAWS: dict[str, Event] = {
    name: event for law in LAWS.values() for name, event in getattr(law, "EVENTS", {}).items()
}
"""Telemetry whose changes are events, by the name of its signal."""


class Watch(NamedTuple):
    """One signal to look at."""

    slot: int
    column: int
    title: str
    names: dict[int, str]
    is_event: bool
    """Every frame is an event, not only a change."""
    is_count: bool
    event: Event = Event("")
    """What a law says of it; empty where it is no law's."""
    beside: tuple[Signal, ...] = ()
    """The signals of its message, by column, for what is told besides."""

    def words(self, value: int) -> str:
        """What a value is called in the log."""
        return _words(self.names, value) if self.beside else self.names.get(value, str(value))

    def told_with(self, row: I8) -> str:
        """What is told besides of the state that this row of its message reports."""
        if int(row[self.column]) not in self.event.told_at:
            return ""
        values = row[: len(self.beside)].tolist()
        named = {
            signal.name: _words(value_names(signal), value)
            for signal, value in zip(self.beside, values, strict=True)
        }
        try:
            return f": {self.event.told.format_map(named)}"
        except KeyError:  # another version's message has not all that this one tells
            return ""


def _words(names: Mapping[int, str], value: int) -> str:
    """A value as a law's event has it: IN_FORCE is told as `in force`."""
    return names.get(value, str(value)).lower().replace("_", " ")


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
        self._watches += [
            Watch(
                slot, column, OF_LAWS[signal.name].title, value_names(signal), False, False,
                OF_LAWS[signal.name], message.signals,
            )
            for slot, message in enumerate(decoder.messages)
            for column, signal in enumerate(message.signals)
            if signal.name in OF_LAWS
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
                    found += self._lines_of(watch, t_s, raw)
        return sorted(found, key=lambda line: line.t_s)

    def _lines_of(self, watch: Watch, t_s: F8, raw: I8) -> list[LogLine]:
        values = raw[:, watch.column]
        last = None if watch.is_event else self._last.get(watch.title)
        places = np.arange(len(values)) if watch.is_event else changes(values, last)
        self._last[watch.title] = int(values[-1])
        lines = []
        for place in places.tolist():
            value = int(values[place])
            name = watch.words(value)
            was = "" if last is None else f", was {watch.words(last)}"
            was += watch.told_with(raw[place])
            alarming = watch.is_count or (watch.title, name) in ALARMING
            alarming |= value in watch.event.alarming
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
