"""The great circle from a mission's entry to its target, as world and flight computer take it."""

import math

import numpy as np

from flight_sw.errors import MissionError
from flight_sw.records.types_ import Record
from sim_harness.mission.mission import Mission

APART_MIN_RATIO = 1e-6  # of the radius: a target nearer to the entry gives no direction


def direction(lon_deg: float, lat_deg: float) -> np.ndarray:
    """Unit vector of a place: x to longitude 0, z to the north pole."""
    lon, lat = math.radians(lon_deg), math.radians(lat_deg)
    return np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])


def fill_ground_track(track: Record, mission: Mission) -> None:
    """Writes the track; refuses a mission without target, or one at the entry or opposite to it."""
    target, entry = mission.target, mission.entry
    if target is None:
        raise MissionError(
            f"{mission.path.name}: has no table [target], which a ground track needs"
        )
    start = direction(entry.longitude_deg, entry.latitude_deg)
    there = direction(target.longitude_deg, target.latitude_deg)
    along = float(start @ there)
    across = there - start * along
    length = float(np.linalg.norm(across))
    if length < APART_MIN_RATIO:
        raise MissionError(
            f"{mission.path.name}: target lies at the entry or opposite to it, allowed elsewhere"
        )
    ahead = across / length
    for axis, s, a in zip("xyz", start, ahead, strict=True):
        track[f"cos_start_{axis}"], track[f"cos_ahead_{axis}"] = s, a
    track["target_m"] = mission.planet.radius_km * 1e3 * math.atan2(length, along)
