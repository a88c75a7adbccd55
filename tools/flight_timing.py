"""A flight's timing, as its summary or its recording tells it."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from flight_sw.errors import AeroshellError
from flight_sw.runtime.echo import echoed
from sim_harness.flight.summary import TIMING_KEY
from sim_harness.mission.documents import DocumentError, json_of, read_json
from sim_harness.telemetry.reader import open_recording
from sim_harness.telemetry.records import RECORDING_NAME

SUMMARY_NAME = "summary.json"
NUMBER_MAX = 1e15
WORDS = ("pace", "bus", "synchronisation")  # the others are numbers
PACE = re.compile(r"lockstep|realtime|[0-9]{1,9}(\.[0-9]{1,9})?(e[+-]?[0-9]{1,2})?x")
COUNTS = ("pace", "pace_reached", "pace_held", "slips", "ticks", "late_commands")
FLOWN = ("bus", "synchronisation", "minor_frames", "period_s")

QUANTITIES = (
    ("wake-up of the harness", "harness", "harness_wake_up"),
    ("wake-up of the computer", "computer", "wake_up"),
    ("step of the computer", "computer", "step_time"),
    ("round trip", "harness", "round_trip"),
)
"""Title, side and name of everything that is measured in flight, in the order of a minor frame."""


class TimingError(AeroshellError):
    """A file that tells no flight's timing."""


class Measured(NamedTuple):
    """One quantity's distribution, in microseconds."""

    title: str
    percentiles_us: dict[str, float]
    """p50, p99, p999, max."""
    bins_us: list[tuple[float, int]]
    """Upper edge and count of every bin that holds something."""


class FlightTiming(NamedTuple):
    """What was measured of a flight's punctuality."""

    source: str
    flown: dict[str, Any]
    counts: dict[str, Any]
    measured: list[Measured]
    stolen_s: float | None = None
    """Processor time that the hypervisor gave to others meanwhile."""

    @property
    def is_lockstep(self) -> bool:
        """Whether it was flown without a clock."""
        return str(self.counts["pace"]) == "lockstep"

    def as_json(self) -> dict[str, Any]:
        """The object that `aeroshell timing --json` prints."""
        return {
            "source": self.source,
            **self.flown,
            **self.counts,
            "stolen_s": self.stolen_s,
            "measured": [quantity._asdict() for quantity in self.measured],
        }


def _from_summary(path: Path) -> Any:
    return read_json(path, TimingError)


def _from_recording(path: Path) -> Any:
    recording = open_recording(path)
    text = recording.outcome.get(TIMING_KEY)
    if text is None:
        recording.check_whole()
        why = "" if recording.is_complete else ", its recorder was cut off"
        raise TimingError(f"{path}: holds no timing{why}")
    try:
        return json_of(text.encode())
    except DocumentError as error:
        raise TimingError(f"{path}: its timing {error}") from error


def _file_of(flight: Path) -> Path:
    if not flight.is_dir():
        return flight
    for name in (SUMMARY_NAME, RECORDING_NAME):
        if (flight / name).is_file():
            return flight / name
    raise TimingError(f"{flight}: is no flight, holds neither {SUMMARY_NAME} nor {RECORDING_NAME}")


def _number(value: Any) -> float:
    """What was measured or counted: a number that is not negative and of a sensible size."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError
    if not 0.0 <= value <= NUMBER_MAX:
        raise ValueError
    return float(value)


def _check(key: str, value: Any) -> None:
    """Refuse what a summary never holds: another type, or a text that is no word."""
    if key not in WORDS:
        if value is not None and not isinstance(value, bool):
            _number(value)
    elif not isinstance(value, str) or echoed(value) != value:
        raise TypeError
    if key == "pace" and not PACE.fullmatch(value):
        raise ValueError


def _measured(timing: Mapping[str, Any]) -> list[Measured]:
    found = []
    for title, side, name in QUANTITIES:
        of_side = timing[side]
        told = of_side.get(f"{name}_bins_us", [])
        bins = [(_number(edge_us), int(_number(n))) for edge_us, n in told]
        if bins:
            percentiles = {key: _number(of_side[f"{name}_us"][key]) for key in PERCENTILES}
            found.append(Measured(title, percentiles, bins))
    return found


PERCENTILES = {"p50": "p50", "p99": "p99", "p999": "p99.9", "max": "max"}
"""Keys of a distribution, and how they are called."""


def read_timing(flight: Path) -> FlightTiming:
    """The timing of a run folder, a summary or a recording; one sentence where there is none."""
    path = _file_of(flight)
    told = _from_recording(path) if path.suffix == ".mcap" else _from_summary(path)
    if not isinstance(told, dict) or "pace" not in told:
        raise TimingError(f"{path}: is no summary of a flight")
    try:
        flown, counts = ({key: told[key] for key in keys} for keys in (FLOWN, COUNTS))
        for key, value in {**flown, **counts}.items():
            _check(key, value)
        measured = _measured(told["timing"])
        stolen_s = told["timing"]["harness"].get("stolen_s")
        stolen_s = None if stolen_s is None else _number(stolen_s)
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise TimingError(f"{path}: holds no timing, or one of another version") from error
    if not measured:
        raise TimingError(f"{path}: holds no timing, nothing of the flight was measured")
    return FlightTiming(str(path), flown, counts, measured, stolen_s)
