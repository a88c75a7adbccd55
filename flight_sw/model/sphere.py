"""Places on a sphere seen from another: offsets and directions that hold at poles and date line.

An offset is a distance along the great circle in radians, taken apart into north and east where the
other place lies: the azimuthal equidistant projection about it. Near that place it is the
difference of latitudes, and that of longitudes times the cosine of the latitude.

Limits: of the antipode there is no direction; what is found there is finite and means nothing.
"""

import math

from flight_sw.model.angles import wrapped
from flight_sw.runtime.jit import kernel

NEAR_RAD = 1e-3  # nearer, the slope of the stretch is that of its series


@kernel
def offset(
    lat_rad: float, lon_rad: float, from_lat_rad: float, from_lon_rad: float
) -> tuple[float, float]:
    """North and east of a place, from another, rad of distance."""
    sin_lat, cos_lat = math.sin(lat_rad), math.cos(lat_rad)
    sin_from, cos_from = math.sin(from_lat_rad), math.cos(from_lat_rad)
    sin_lon, cos_lon = math.sin(lon_rad - from_lon_rad), math.cos(lon_rad - from_lon_rad)
    east = cos_lat * sin_lon
    north = sin_lat * cos_from - cos_lat * sin_from * cos_lon
    up = sin_lat * sin_from + cos_lat * cos_from * cos_lon
    stretch, _ = _stretch(math.hypot(north, east), up)
    return stretch * north, stretch * east


@kernel
def offset_slopes(
    lat_rad: float, lon_rad: float, from_lat_rad: float, from_lon_rad: float
) -> tuple[float, float, float, float]:
    """Derivatives of `offset`: of north by latitude and longitude, of east by both."""
    sin_lat, cos_lat = math.sin(lat_rad), math.cos(lat_rad)
    sin_from, cos_from = math.sin(from_lat_rad), math.cos(from_lat_rad)
    sin_lon, cos_lon = math.sin(lon_rad - from_lon_rad), math.cos(lon_rad - from_lon_rad)
    east = cos_lat * sin_lon
    north = sin_lat * cos_from - cos_lat * sin_from * cos_lon
    up = sin_lat * sin_from + cos_lat * cos_from * cos_lon
    stretch, by_up = _stretch(math.hypot(north, east), up)
    up_by_lat = cos_lat * sin_from - sin_lat * cos_from * cos_lon
    up_by_lon = -cos_lat * cos_from * sin_lon
    north_by_lat = cos_lat * cos_from + sin_lat * sin_from * cos_lon
    north_by_lon = cos_lat * sin_from * sin_lon
    east_by_lat = -sin_lat * sin_lon
    east_by_lon = cos_lat * cos_lon
    return (
        stretch * north_by_lat + by_up * up_by_lat * north,
        stretch * north_by_lon + by_up * up_by_lon * north,
        stretch * east_by_lat + by_up * up_by_lat * east,
        stretch * east_by_lon + by_up * up_by_lon * east,
    )


@kernel
def _stretch(sin_distance: float, cos_distance: float) -> tuple[float, float]:
    """An arc over its sine, and the derivative of that by the arc's cosine."""
    arc = math.atan2(sin_distance, cos_distance)
    if arc < NEAR_RAD:
        return 1.0 + arc * arc / 6.0, -1.0 / 3.0
    sine = max(sin_distance, NEAR_RAD * NEAR_RAD)
    stretch = arc / sine
    return stretch, (cos_distance * stretch - 1.0) / (sine * sine)


@kernel
def turned_by(lat_rad: float, lon_rad: float, to_lat_rad: float, to_lon_rad: float) -> float:
    """What a heading gains on the great circle to another place, rad: meridians converge.

    Napier's analogy; a heading at the first place is the same direction as the heading plus this at
    the other.
    """
    half_lon = 0.5 * wrapped(to_lon_rad - lon_rad)
    mean, half = 0.5 * (to_lat_rad + lat_rad), 0.5 * (to_lat_rad - lat_rad)
    return 2.0 * math.atan2(
        math.sin(half_lon) * math.sin(mean), math.cos(half_lon) * math.cos(half)
    )
