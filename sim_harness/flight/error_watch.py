"""Tells in flight what the bus interface tells of itself: each kind of error once, and bus-off.

A bus that is off again and again is told at the first, second, fourth, eighth time, and so on.
"""

from flight_sw.can.error_frames import Account


class ErrorWatch:
    """Decides when a flight says that its interface reports errors."""

    def __init__(self) -> None:
        self._told = Account()
        self._next_bus_off = 1

    def look(self, found: Account) -> str:
        """A sentence if there is something new, otherwise empty."""
        is_new = found.frames > 0 and not self._told.frames
        is_new |= bool(found.classes & ~self._told.classes or found.states & ~self._told.states)
        if not is_new and found.bus_off < self._next_bus_off:
            return ""
        while self._next_bus_off <= found.bus_off:
            self._next_bus_off *= 2
        self._told = found
        return f"the bus interface reports {found.text}"
