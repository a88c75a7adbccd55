"""Warns of slips while a flight goes on: at once, then ever more rarely, and promptly again later.

Each warning doubles the silence after it, up to a minute; each silence that passes without a slip
halves the next. A flight that slips all the time says so a few times, one that slips once says so
at once.
"""

from typing import NamedTuple

from flight_sw import icd
from flight_sw.records.types_ import Record

SILENCE_MIN_S, SILENCE_MAX_S = 1.0, 64.0
COMPUTER_SLIPS = icd.value_index("FSW_TIMING", "slips")


class Slips(NamedTuple):
    """What was late so far."""

    harness: int = 0
    """Frames that began more than a period late."""
    computer: int = 0
    """Cycles of the flight computer that were not over when the next was due."""
    commands: int = 0
    """Frames that ended before their command had come."""

    def minus(self, other: "Slips") -> "Slips":
        """What has come since then; counters on the bus saturate, they never go back."""
        return Slips(*(max(a - b, 0) for a, b in zip(self, other, strict=True)))


def slips_so_far(pacer: Record, port: Record) -> Slips:
    """As the harness counts, and as the flight computer last told."""
    computer = int(port["received"][COMPUTER_SLIPS])
    return Slips(int(pacer["slips"]), computer, int(pacer["late_commands"]))


class SlipWatch:
    """Decides when a flight says that it slips; `look` is called many times a second."""

    def __init__(self) -> None:
        self._told = Slips()
        self._silence_s = SILENCE_MIN_S
        self._next_s = 0.0

    def look(self, now_s: float, slips: Slips) -> str:
        """A sentence if there is something new and it is time to say so, otherwise empty."""
        if now_s < self._next_s:
            return ""
        new = slips.minus(self._told)
        if not any(new):
            if self._silence_s > SILENCE_MIN_S:
                self._silence_s /= 2.0
                self._next_s = now_s + self._silence_s
            return ""
        self._told = slips
        said_s = self._silence_s
        self._next_s = now_s + said_s
        self._silence_s = min(2.0 * said_s, SILENCE_MAX_S)
        return (
            f"late: {new.harness} frames of the harness, {new.computer} cycles of the flight "
            f"computer, {new.commands} commands; the next warning not before {said_s:g} s"
        )
