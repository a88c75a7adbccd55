"""Angles and floors that several modules share."""

import math

from flight_sw.runtime.jit import kernel


@kernel
def wrapped(angle_rad: float) -> float:
    """The same direction between -pi and pi; untouched when it is there already, or not finite."""
    if abs(angle_rad) <= math.pi or not math.isfinite(angle_rad):
        return angle_rad
    return angle_rad - 2.0 * math.pi * math.floor((angle_rad + math.pi) / (2.0 * math.pi))


@kernel
def away_from_zero(x: float, floor: float) -> float:
    """x, or the floor with the sign of x where x is smaller."""
    if x >= 0.0:
        return max(x, floor)
    return min(x, -floor)
