"""Entry states between the inertial and the rotating frame, both in local axes up, north, east.

Angles as everywhere: flight-path angle positive up, heading from north, positive to the east.
"""

import math
from typing import NamedTuple


class Velocity(NamedTuple):
    """A velocity by size and direction in the local axes."""

    speed_mps: float
    flight_path_angle_rad: float
    heading_rad: float


def turned(velocity: Velocity, east_mps: float) -> Velocity:
    """The velocity with an eastward component added."""
    horizontal = velocity.speed_mps * math.cos(velocity.flight_path_angle_rad)
    up = velocity.speed_mps * math.sin(velocity.flight_path_angle_rad)
    north = horizontal * math.cos(velocity.heading_rad)
    east = horizontal * math.sin(velocity.heading_rad) + east_mps
    along = math.hypot(north, east)
    return Velocity(math.hypot(along, up), math.atan2(up, along), math.atan2(east, north))


def relative_from_inertial(
    inertial: Velocity, radius_m: float, lat_rad: float, rotation_radps: float
) -> Velocity:
    """Velocity over the rotating planet of an inertial one at the same place."""
    return turned(inertial, -rotation_radps * radius_m * math.cos(lat_rad))


def inertial_from_relative(
    relative: Velocity, radius_m: float, lat_rad: float, rotation_radps: float
) -> Velocity:
    """Inertial velocity of one over the rotating planet at the same place."""
    return turned(relative, rotation_radps * radius_m * math.cos(lat_rad))
