"""Density and speed of sound against altitude: a piecewise cubic of ln(density) in one record.

The same record serves the flight load and the world; what fills it is chosen on the ground. Knots
may be spaced unevenly (a layer boundary is a knot); a table over equal buckets of altitude gives
the interval at once, so that a look-up costs no search.

Limits: outside the knots the edge values are held. A NaN altitude gives NaN.
"""

import math

import numpy as np

from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

KNOTS_MAX = 512
BUCKETS = 1024

ATMOSPHERE = np.dtype(
    [
        ("n", "i8"),  # knots in use, at least 2
        ("buckets_pm", "f8"),  # buckets per metre above the first knot
        ("alt_m", "f8", (KNOTS_MAX,)),  # knots, strictly ascending
        ("ln_rho", "f8", (KNOTS_MAX, 4)),  # ln(kg/m3) from a knot upwards, powers 0..3 of metres
        ("sound_speed_sq_m2ps2", "f8", (KNOTS_MAX,)),  # at the knots, linear between them
        ("bucket", "i4", (BUCKETS,)),  # interval that holds a bucket's lower edge
    ],
    align=True,
)
"""An atmosphere at rest, 29 kB."""


@kernel
def held_altitude(atmosphere: Record, alt_m: float) -> float:
    """`alt_m`, or the nearest end of the knots outside them."""
    alts = atmosphere["alt_m"]
    if alt_m < alts[0]:
        return alts[0]
    top_m = alts[atmosphere["n"] - 1]
    if alt_m > top_m:
        return top_m
    return alt_m


@kernel
def interval(atmosphere: Record, alt_m: float) -> int:
    """Index of the knot at or below `alt_m`, at most the last but one."""
    alts = atmosphere["alt_m"]
    last = atmosphere["n"] - 2
    position = (alt_m - alts[0]) * atmosphere["buckets_pm"]
    if not position > 0.0:
        return 0
    if position >= BUCKETS:
        return last
    i = atmosphere["bucket"][int(position)]
    for _ in range(last):
        if i >= last or alt_m < alts[i + 1]:
            break
        i += 1
    return i


@kernel
def density(atmosphere: Record, alt_m: float) -> float:
    """Density in kg/m3."""
    alt = held_altitude(atmosphere, alt_m)
    i = interval(atmosphere, alt)
    c = atmosphere["ln_rho"]
    x = alt - atmosphere["alt_m"][i]
    return math.exp(c[i, 0] + x * (c[i, 1] + x * (c[i, 2] + x * c[i, 3])))


@kernel
def log_density_slopes(atmosphere: Record, alt_m: float) -> tuple[float, float]:
    """First and second derivative of ln(density) over altitude, 1/m and 1/m2.

    Held altitudes keep the slopes of the nearest end: a law that divides by them stays finite.
    """
    alt = held_altitude(atmosphere, alt_m)
    i = interval(atmosphere, alt)
    c = atmosphere["ln_rho"]
    x = alt - atmosphere["alt_m"][i]
    return c[i, 1] + x * (2.0 * c[i, 2] + x * 3.0 * c[i, 3]), 2.0 * c[i, 2] + 6.0 * x * c[i, 3]


@kernel
def sound_speed(atmosphere: Record, alt_m: float) -> float:
    """Speed of sound in m/s."""
    alt = held_altitude(atmosphere, alt_m)
    i = interval(atmosphere, alt)
    alts = atmosphere["alt_m"]
    squares = atmosphere["sound_speed_sq_m2ps2"]
    fraction = (alt - alts[i]) / (alts[i + 1] - alts[i])
    return math.sqrt(squares[i] + fraction * (squares[i + 1] - squares[i]))


@kernel
def sound_speed_slope(atmosphere: Record, alt_m: float) -> tuple[float, float]:
    """Speed of sound in m/s and its slope over altitude in 1/s; held ends have no slope."""
    speed_mps = sound_speed(atmosphere, alt_m)
    if held_altitude(atmosphere, alt_m) != alt_m:
        return speed_mps, 0.0
    i = interval(atmosphere, alt_m)
    alts = atmosphere["alt_m"]
    squares = atmosphere["sound_speed_sq_m2ps2"]
    return speed_mps, (squares[i + 1] - squares[i]) / (alts[i + 1] - alts[i]) / (2.0 * speed_mps)
