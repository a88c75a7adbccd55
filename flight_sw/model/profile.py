"""Angle of attack and bank along a flight: straight lines between knots over time or energy.

The index is either the time, or the speed that the Jacobi energy has lost (so that the knots of a
flight lie evenly): index = (speed_ref - sqrt(2 (e - e_ref))) / speed_unit. Energy falls by drag
alone, so the index never turns back.

Whoever integrates along a profile lands on each break: a knot inside a step would spoil its order.
The segments are therefore state, moved on at a break, and not looked up.
"""

import math

import numpy as np

from flight_sw.model.motion import PHI, RADIUS, V, jacobi_energy
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel, seldom_kernel

KNOTS_MAX = 12
BREAKS_MAX = 2 * KNOTS_MAX
BY_TIME, BY_ENERGY = 0, 1
W_MIN_MPS = 1e-3  # floor on the speed of the energy left, which divides

PROFILE = np.dtype(
    [
        ("index_by", "u4"),
        ("n_bank", "u4"),
        ("n_alpha", "u4"),
        ("n_breaks", "u4"),
        ("energy_ref_jpkg", "f8"),
        ("index_speed_mps", "f8"),
        ("index_unit_mps", "f8"),
        ("time_unit_s", "f8"),
        ("bank_index", "f8", (KNOTS_MAX,)),
        ("bank_rad", "f8", (KNOTS_MAX,)),
        ("alpha_index", "f8", (KNOTS_MAX,)),
        ("alpha_rad", "f8", (KNOTS_MAX,)),
        ("breaks", "f8", (BREAKS_MAX,)),  # all knots of both, ascending
    ],
    align=True,
)
"""A control profile; before its first knot and behind its last the control is held."""


@seldom_kernel
def merge_breaks(profile: Record) -> None:
    """Writes `breaks` from the knots of bank and angle of attack, each once."""
    i = 0
    j = 0
    n = 0
    n_bank = np.int64(profile["n_bank"])
    n_alpha = np.int64(profile["n_alpha"])
    for _ in range(BREAKS_MAX):
        if i >= n_bank and j >= n_alpha:
            break
        if j >= n_alpha or (i < n_bank and profile["bank_index"][i] <= profile["alpha_index"][j]):
            at = profile["bank_index"][i]
            i += 1
        else:
            at = profile["alpha_index"][j]
            j += 1
        if n == 0 or at > profile["breaks"][n - 1]:
            profile["breaks"][n] = at
            n += 1
    profile["n_breaks"] = n


@seldom_kernel
def index_of(profile: Record, planet: Record, x: F8, t_s: float) -> float:
    """The index at a state of shape (6,) and a time."""
    if profile["index_by"] == BY_TIME:
        return t_s / profile["time_unit_s"]
    left = 2.0 * (jacobi_energy(planet, x) - profile["energy_ref_jpkg"])
    return (profile["index_speed_mps"] - math.sqrt(max(left, 0.0))) / profile["index_unit_mps"]


@seldom_kernel
def index_slopes(profile: Record, planet: Record, x: F8, motion: Record, out: F8) -> None:
    """Writes the index's partial derivatives by the state, shape (6,), into `out`.

    The energy's are those of its definition: speed, and what `motion` has of the pull.
    """
    for i in range(len(out)):
        out[i] = 0.0
    if profile["index_by"] == BY_TIME:
        return
    left = 2.0 * (jacobi_energy(planet, x) - profile["energy_ref_jpkg"])
    per_energy = -1.0 / (profile["index_unit_mps"] * max(math.sqrt(max(left, 0.0)), W_MIN_MPS))
    out[V] = per_energy * x[V]
    out[RADIUS] = -per_energy * motion["up_mps2"]
    out[PHI] = -per_energy * x[RADIUS] * motion["north_mps2"]


@kernel
def segment_at(knots: F8, n: int, index: float) -> int:
    """Number of the last knot at or below an index; -1 before the first."""
    found = -1
    for i in range(n):
        if knots[i] <= index:
            found = i
    return found


@kernel
def on_line(knots: F8, values: F8, n: int, segment: int, index: float) -> tuple[float, float]:
    """Value and slope of a segment's line at an index, also a little beyond its ends."""
    if segment < 0:
        return values[0], 0.0
    if segment >= n - 1:
        return values[n - 1], 0.0
    slope = (values[segment + 1] - values[segment]) / (knots[segment + 1] - knots[segment])
    return values[segment] + slope * (index - knots[segment]), slope


@kernel
def weight_of(knots: F8, n: int, segment: int, index: float, knot: int) -> float:
    """What a segment's line changes by with the value at a knot: its hat function."""
    if segment < 0:
        return 1.0 if knot == 0 else 0.0
    if segment >= n - 1:
        return 1.0 if knot == n - 1 else 0.0
    share = (index - knots[segment]) / (knots[segment + 1] - knots[segment])
    if knot == segment:
        return 1.0 - share
    return share if knot == segment + 1 else 0.0
