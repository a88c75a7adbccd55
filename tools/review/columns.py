"""The columns behind the lines: truth and what follows from it, signals at a sensible rate."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw import modes
from flight_sw.errors import AeroshellError
from flight_sw.icd import FRAME_BYTES
from flight_sw.records import status
from sim_harness.bus.load_model import BITRATE_BPS, worst_frame_bits
from sim_harness.telemetry.events import changes, value_names
from sim_harness.telemetry.wire import groups_of
from tools.flight_facts import law_of, phases_of
from tools.review.geometry import to_go
from tools.review.palette import PHASES, STATES, Rgba
from tools.review.panels import TELEMETRY_PREFIX, is_state
from tools.review.signals import shown
from tools.review.source import FlightData

F8 = npt.NDArray[np.float64]

RATE_HZ = 10.0  # of a line; commands are shown at every minor frame
FULL_RATE = ("FSW_COMMAND",)
RATES = {"drag_rate_mps3": "drag_mps2", "heat_flux_rate_wpm2ps": "heat_flux_wpm2"}
"""Rates of change that are compared with what guidance estimates, and what of."""
TO_GO = ("range_to_go_m", "crossrange_to_go_m")
ROUND = ("heading_rad", "bank_rad")  # shown without their jumps from 180 to -180 deg
BUS_COLUMNS = {
    "frames": 1.0,
    "bus_load": 100.0 * worst_frame_bits(FRAME_BYTES) / BITRATE_BPS,
}
"""What is told of the bus, per frame a second; the load with the most stuff bits, in percent."""
STATUS = "FSW_STATUS"
LANES = {
    "mode": "mode",
    "phase": "guidance phase",
    "tracking": "tracking",
    "fix_valid": "navigation fix",
    "bank_saturated": "bank command",
    "alpha_saturated": "angle-of-attack command",
    "law_status": "law status",
}
STATUS_WORDS = {
    code: name for name, code in vars(status).items() if name.isupper() and isinstance(code, int)
}
ONLY_IF_EVER = ("law_status", "bank_saturated", "alpha_saturated")
SWITCHES = {
    "fix_valid": {0: "lost", 1: "on"},
    "bank_saturated": {0: "free", 1: "saturated"},
    "alpha_saturated": {0: "free", 1: "saturated"},
}


def thinned(t_s: F8, rate_hz: float = RATE_HZ) -> npt.NDArray[np.int64]:
    """Indexes of the first value in every interval."""
    if not len(t_s):
        return np.zeros(0, np.int64)
    ticks = np.floor(t_s * rate_hz + 1e-6)
    return np.flatnonzero(np.append(True, np.diff(ticks) > 0.0))


def while_formed(flight: FlightData, name: str, t_s: F8, values: F8) -> tuple[F8, F8]:
    """Telemetry where its law ran and had come to the phase that forms it; a value that only stood
    there is not a number where it begins to, so that a line ends, and left out before and after."""
    reported_s, signals = flight.message(STATUS)
    if not len(t_s) or not len(reported_s) or not {"mode", "phase"} <= set(signals):
        return t_s, values
    at = np.clip(np.searchsorted(reported_s, t_s), 0, len(reported_s) - 1)
    first: dict[str, int] = getattr(law_of(flight.recording.manifest), "FIRST_PHASE", {})
    is_formed = (signals["mode"][at] == modes.ENTRY) & (signals["phase"][at] >= first.get(name, 0))
    if name in getattr(law_of(flight.recording.manifest), "COAST_TELEMETRY", ()):
        is_formed |= signals["mode"][at] == modes.COAST
    ends = np.append(False, is_formed[:-1] & ~is_formed[1:])
    kept = is_formed | ends
    return t_s[kept], np.where(ends, np.nan, values)[kept]


def truth_fields(flight: FlightData) -> list[str]:
    """Fields of the truth, and what can be derived from it."""
    names = list(flight.truth.dtype.names or ())
    return names + [rate for rate, of in RATES.items() if of in names]


def truth_column(flight: FlightData, name: str) -> tuple[F8, F8]:
    """A field of the truth, or a quantity derived from it; empty where there is none."""
    if flight.has(name):
        values = flight.truth[name].astype(float)
        return flight.truth["t_s"], np.unwrap(values) if name in ROUND else values
    if name in RATES and flight.has(RATES[name]):
        t_s = flight.truth["t_s"]
        rate: F8 = np.gradient(flight.truth[RATES[name]].astype(float), t_s.astype(float))
        return t_s, rate
    if name in TO_GO:
        found = target_of(flight)
        if found is not None and flight.has("lon_rad", "lat_rad"):
            here = flight.truth["lon_rad"], flight.truth["lat_rad"]
            both = to_go(*here, found, float(flight.planet_radius_m or 0.0))
            return flight.truth["t_s"], both[TO_GO.index(name)]
    return np.zeros(0), np.zeros(0)


class Planned(NamedTuple):
    """What was to be flown, of one quantity."""

    name: str
    t_s: F8
    values: F8


def planned(flight: FlightData, name: str) -> list[Planned]:
    """What each planned track has of a field of the truth, over the time at which it was to be."""
    found = []
    for track in flight.planned.tracks:
        t_s = track.reference.get("t_s", np.zeros(0))
        values = track.reference.get(name)
        if name in TO_GO:
            values = _planned_to_go(flight, name, track.reference)
        if values is None or not len(t_s):
            continue
        if name in ROUND and flight.has(name):  # on the turn that is drawn of the flight
            turns = (float(flight.truth[name][0]) - values[0]) / math.tau
            values = values + math.tau * round(turns)
        found.append(Planned(track.name, t_s, values))
    return found


def _planned_to_go(flight: FlightData, name: str, reference: Mapping[str, F8]) -> F8 | None:
    """Range and crossrange to go as the flown ones: about the great circle of the flight."""
    target = target_of(flight)
    if target is None or not flight.has("lon_rad", "lat_rad") or "lon_rad" not in reference:
        return None
    here = [np.append(flight.truth[axis][0], reference[axis]) for axis in ("lon_rad", "lat_rad")]
    both = to_go(here[0], here[1], target, float(flight.planet_radius_m or 0.0))
    return both[TO_GO.index(name)][1:]


def target_of(flight: FlightData) -> tuple[float, float] | None:
    """Longitude and latitude of the mission's target in radians."""
    target = flight.tables.get("target")
    if not isinstance(target, dict) or flight.planet_radius_m is None:
        return None
    lon, lat = target.get("longitude_deg"), target.get("latitude_deg")
    if not isinstance(lon, int | float) or not isinstance(lat, int | float):
        return None
    return math.radians(lon), math.radians(lat)


def column(flight: FlightData, message: str, name: str) -> tuple[F8, F8]:
    """Times and values of a line, in SI; empty where it was not recorded."""
    if message:
        t_s, signals = flight.message(message)
        if name not in signals:
            return np.zeros(0), np.zeros(0)
        values = signals[name].astype(float)
        if message not in FULL_RATE:
            kept = thinned(t_s)
            t_s, values = t_s[kept], values[kept]
        if message.startswith(TELEMETRY_PREFIX):
            t_s, values = while_formed(flight, name, t_s, values)
    elif name in BUS_COLUMNS:
        t_s, frames = frames_per_second(flight)
        values = frames * BUS_COLUMNS[name]
    else:
        t_s, values = truth_column(flight, name)
    return t_s, values


def frames_per_second(flight: FlightData) -> tuple[F8, F8]:
    """How many frames were on the bus in each whole second of mission time but the first, in which
    the flight computer's announcements before the flight are counted."""
    t_s = flight.recording.bus["t_s"]
    if len(t_s) < 2:
        return np.zeros(0), np.zeros(0)
    seconds, counts = np.unique(t_s.astype(np.int64), return_counts=True)
    whole = (seconds > 0) & (seconds < seconds[-1])
    return seconds[whole] + 0.5, counts[whole].astype(float)


class Lane(NamedTuple):
    """A state over time: its changes alone."""

    title: str
    t_s: F8
    names: list[str]
    colours: dict[str, Rgba]


def lanes(flight: FlightData) -> list[Lane]:
    """What state the flight computer reported, by signal, and then its law."""
    return _status_lanes(flight) + _law_lanes(flight)


def _law_lanes(flight: FlightData) -> list[Lane]:
    """Telemetry whose values have names: states, and no lines."""
    found = []
    for message in flight.recording.decoder.messages:
        states = [s for s in message.signals if is_state(message, s)]
        t_s, signals = flight.message(message.name) if states else (np.zeros(0), {})
        if not len(t_s):
            continue
        for signal in states:
            words = {code: word.lower().replace("_", " ") for code, word in signal.names}
            values = signals[signal.name].astype(np.int64)
            places = changes(values)
            told = [words.get(int(v), str(int(v))) for v in values[places]]
            title = shown(signal.name).title
            found.append(Lane(title, t_s[places], told, _colours([*words.values(), *told])))
    return found


def _status_lanes(flight: FlightData) -> list[Lane]:
    t_s, signals = flight.message(STATUS)
    if not len(t_s):
        return []
    decoder = flight.recording.decoder
    described = {s.name: s for s in decoder.messages[decoder.slot(STATUS)].signals}
    found = []
    for name, title in LANES.items():
        if name not in signals:
            continue
        values = signals[name].astype(np.int64)
        if name in ONLY_IF_EVER and not values.any():
            continue
        words = SWITCHES.get(name) or value_names(described[name])
        words = phases_of(flight.recording.manifest) if name == "phase" else words
        words = STATUS_WORDS if name == "law_status" else words
        places = changes(values)
        states = [words.get(int(v), str(int(v))) for v in values[places]]
        colours = _colours([*words.values(), *states])
        found.append(Lane(title, t_s[places], states, colours))
    return found


def _colours(states: list[str]) -> dict[str, Rgba]:
    others = [name for name in dict.fromkeys(states) if name not in STATES]
    unnamed = {name: PHASES[i % len(PHASES)] for i, name in enumerate(others)}
    return {name: STATES.get(name) or unnamed[name] for name in dict.fromkeys(states)}


def saturated(flight: FlightData, flag: str, axis: str) -> tuple[F8, F8]:
    """Where the command of an axis met a limit: times and commands."""
    try:
        t_s, flags = flight.message(STATUS)
        command_s, commands = flight.message("FSW_COMMAND")
    except AeroshellError:
        return np.zeros(0), np.zeros(0)
    name = f"{axis}_cmd_rad"
    if flag not in flags or name not in commands or not len(command_s):
        return np.zeros(0), np.zeros(0)
    t_s = t_s[flags[flag] > 0]
    t_s = t_s[thinned(t_s)]
    at = np.clip(np.searchsorted(command_s, t_s), 0, len(command_s) - 1)
    return t_s, commands[name][at].astype(float)


def missing_frames(flight: FlightData) -> int:
    """Minor frames that are not in the recording."""
    return flight.recording.missing_minor_frames


def minor_frames(flight: FlightData) -> int:
    """Minor frames that are."""
    return len(groups_of(flight.recording.bus["t_s"]))
