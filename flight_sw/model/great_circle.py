"""Range flown along the great circle from the entry to the target.

Limits: within half the planet's circumference of the entry.
"""

import math

from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

UNIT_TOLERANCE = 1e-9


def _is_a_frame(track: Record) -> str:
    """Two unit vectors at right angles."""
    start = [float(track[f"cos_start_{axis}"]) for axis in "xyz"]
    ahead = [float(track[f"cos_ahead_{axis}"]) for axis in "xyz"]
    lengths = sum(a * a for a in start), sum(a * a for a in ahead)
    across = sum(a * b for a, b in zip(start, ahead, strict=True))
    if max(abs(lengths[0] - 1.0), abs(lengths[1] - 1.0), abs(across)) <= UNIT_TOLERANCE:
        return ""
    return f"cos_start, cos_ahead have lengths {lengths} and product {across:g}, allowed 1, 1 and 0"


GROUND_TRACK = RecordSpec(
    "ground_track",
    Field("cos_start_x", -1.0, 1.0, "direction of the entry, x to longitude 0"),
    Field("cos_start_y", -1.0, 1.0),
    Field("cos_start_z", -1.0, 1.0, "to the north pole"),
    Field("cos_ahead_x", -1.0, 1.0, "a right angle further on"),
    Field("cos_ahead_y", -1.0, 1.0),
    Field("cos_ahead_z", -1.0, 1.0),
    Field("target_m", 0.0, 1e9, "range of the target"),
    rules=(_is_a_frame,),
)


@kernel
def range_flown(track: Record, radius_m: float, lon_rad: float, lat_rad: float) -> float:
    """Metres along the track, on the sphere of the reference radius."""
    cos_lat = math.cos(lat_rad)
    x = cos_lat * math.cos(lon_rad)
    y = cos_lat * math.sin(lon_rad)
    z = math.sin(lat_rad)
    ahead = x * track["cos_ahead_x"] + y * track["cos_ahead_y"] + z * track["cos_ahead_z"]
    start = x * track["cos_start_x"] + y * track["cos_start_y"] + z * track["cos_start_z"]
    return radius_m * math.atan2(ahead, start)
