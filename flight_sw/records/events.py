"""What of a law's telemetry is an event: the computer sends values, the ground logs changes."""

from typing import NamedTuple


class Event(NamedTuple):
    """Changes of a telemetered state that go into the log, by the name of its signal."""

    title: str
    """What stands before the state's name."""
    told: str = ""
    """Said besides at the states `told_at`: a form with names of signals of the same message."""
    told_at: tuple[int, ...] = ()
    alarming: tuple[int, ...] = ()
    """States that are logged as warnings."""
