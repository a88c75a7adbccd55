"""Planned tracks: what a law meant to fly, from the recording of what it flew.

A module here of the name of a law's family has `tracks_of(recording) -> Tracks`; a family without
one plans nothing that could be shown. A track is named columns and no more: who draws it knows the
names, those of the truth's fields, and nothing of the law.
"""

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.guidance import FAMILIES
from sim_harness.telemetry.reader import Recording

F8 = npt.NDArray[np.float64]


class Track(NamedTuple):
    """One trajectory that was meant."""

    name: str
    """Beside its lines: `planned`. The tracks of a flight have names of their own."""
    path: Mapping[str, F8]
    """From its beginning to its end, a row a point; columns named as the truth's, in SI."""
    reference: Mapping[str, F8]
    """What was to be held at each `t_s` of the flight; other columns named as the truth's. Empty
    where none of it was flown."""
    facts: tuple[tuple[str, str], ...] = ()
    """What is known of it: title and value."""


class Tracks(NamedTuple):
    """All of a flight."""

    tracks: tuple[Track, ...] = ()
    gaps: tuple[str, ...] = ()
    """What could not be found out, and why, a sentence each."""


def _finders() -> dict[str, Callable[[Recording], Tracks]]:
    """What finds the tracks of each law, by the law's name."""
    here = {found.name for found in pkgutil.iter_modules(__path__)}
    return {
        law: importlib.import_module(f"{__name__}.{name}").tracks_of
        for name, family in FAMILIES.items()
        if name in here
        for law in family.LAWS
    }


def tracks_of(recording: Recording) -> Tracks:
    """The planned tracks of a recorded flight; none of a law that plans none."""
    finder = _finders().get(recording.manifest.get("law", ""))
    return finder(recording) if finder else Tracks()
