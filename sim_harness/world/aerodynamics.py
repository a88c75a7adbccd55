"""Lift and drag coefficients times reference area, from the model the mission names.

Limits: tables are bilinear in angle of attack and Mach and hold their edge values outside.
"""

import math

from flight_sw.model.onboard import POWERS_ALPHA, POWERS_MACH
from flight_sw.model.tables import bracket
from flight_sw.records.types_ import F8, Record
from sim_harness.jit import kernel
from sim_harness.world.records import AERO_CONSTANT, AERO_NEWTONIAN, AERO_POLYNOMIAL, AERO_TABLE


@kernel
def share(x: float, grid: F8, i: int, n: int) -> float:
    """Where x lies in interval i of a grid, from 0 to 1; held outside, 0 on a grid of one value."""
    if n < 2 or x <= grid[i]:
        return 0.0
    if x >= grid[i + 1]:
        return 1.0
    return (x - grid[i]) / (grid[i + 1] - grid[i])


@kernel
def bilinear(table: F8, i: int, j: int, u: float, w: float) -> float:
    """Value in cell (i, j) at shares (u, w); a share of 0 does not touch the next row or column."""
    low = table[i, j]
    high = low
    if u != 0.0:
        high = table[i + 1, j]
    if w != 0.0:
        low = low + w * (table[i, j + 1] - low)
        if u != 0.0:
            high = high + w * (table[i + 1, j + 1] - high)
    return low + u * (high - low)


@kernel
def table_areas(aero: Record, alpha_rad: float, mach: float) -> tuple[float, float]:
    """C_L S and C_D S in m2 from the tables."""
    alphas = aero["alpha_rad"]
    machs = aero["mach"]
    i = bracket(alpha_rad, alphas, aero["n_alpha"])
    j = bracket(mach, machs, aero["n_mach"])
    u = share(alpha_rad, alphas, i, aero["n_alpha"])
    w = share(mach, machs, j, aero["n_mach"])
    area_m2 = aero["area_m2"]
    lift = area_m2 * bilinear(aero["lift_table"], i, j, u, w)
    drag = area_m2 * bilinear(aero["drag_table"], i, j, u, w)
    return lift, drag


@kernel
def powers_sum(powers: F8, alpha_rad: float, mach: float) -> float:
    """Sum of powers[i, j] alpha^i Mach^j."""
    total = 0.0
    for i in range(POWERS_ALPHA - 1, -1, -1):
        by_mach = 0.0
        for j in range(POWERS_MACH - 1, -1, -1):
            by_mach = by_mach * mach + powers[i, j]
        total = total * alpha_rad + by_mach
    return total


@kernel
def follows_mach(aero: Record) -> bool:
    """Whether the coefficients of the model change with the Mach number."""
    return aero["model"] == AERO_TABLE or aero["model"] == AERO_POLYNOMIAL


@kernel
def areas(aero: Record, alpha_rad: float, mach: float) -> tuple[float, float]:
    """C_L S and C_D S in m2 as the model has them; the lift coefficient may be negative."""
    area_m2 = aero["area_m2"]
    if aero["model"] == AERO_CONSTANT:
        return area_m2 * aero["lift_coefficient"], area_m2 * aero["drag_coefficient"]
    if aero["model"] == AERO_NEWTONIAN:
        s = math.sin(alpha_rad)
        c = math.cos(alpha_rad)
        normal = area_m2 * (aero["n1"] * s * s + aero["n2"] * s * c)
        axial = area_m2 * (aero["a1"] * c * c + aero["a2"] * s * s)
        return normal * c - axial * s, normal * s + axial * c
    if aero["model"] == AERO_POLYNOMIAL:
        lift = area_m2 * powers_sum(aero["lift_powers"], alpha_rad, mach)
        return lift, area_m2 * powers_sum(aero["drag_powers"], alpha_rad, mach)
    return table_areas(aero, alpha_rad, mach)


@kernel
def true_areas(aero: Record, alpha_rad: float, mach: float) -> tuple[float, float]:
    """C_L S and C_D S in m2 as they are: the model's, each times its ratio."""
    lift_m2, drag_m2 = areas(aero, alpha_rad, mach)
    return aero["lift_ratio"] * lift_m2, aero["drag_ratio"] * drag_m2
