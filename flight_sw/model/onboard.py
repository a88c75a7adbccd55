"""What the flight computer believes of planet, vehicle and heating, and the forces that follow.

The truth may differ: these numbers come from the load image, the world's from the mission file.
"""

import math

from flight_sw.model.atmosphere import (
    density,
    held_altitude,
    log_density_slopes,
    sound_speed,
    sound_speed_slope,
)
from flight_sw.model.tables import bracket
from flight_sw.records.fields import UNBOUNDED, Field, RecordSpec
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel, seldom_kernel

ALPHA_ROWS = 80
MACH_ROWS = 16

PLANET = RecordSpec(
    "planet",
    Field("radius_m", 1e5, 1e8, "reference sphere"),
    Field("mu_m3ps2", 1e9, 1e18, "gravity"),
    Field("rotation_radps", -1e-2, 1e-2, "about the north pole"),
    Field("g0_mps2", 0.1, 100.0, "unit of load factor"),
    Field("j2", 0.0, 0.1, "oblateness, for what integrates the motion; 0: none"),
)

POWERS_ALPHA, POWERS_MACH = 4, 3

AERO_TABLE = RecordSpec(
    "aero_table",
    Field("n_alpha", 2, ALPHA_ROWS, "rows in use", kind="u4"),
    Field("n_mach", 1, MACH_ROWS, "columns in use", kind="u4"),
    Field("alpha_rad", -math.pi, math.pi, "grid", shape=(ALPHA_ROWS,), rows="n_alpha"),
    Field("mach", 0.0, 1000.0, "grid", shape=(MACH_ROWS,), rows="n_mach"),
    Field("cl", -300.0, 300.0, "lift", shape=(ALPHA_ROWS * MACH_ROWS,)),
    Field("cd", 0.0, 300.0, "drag", shape=(ALPHA_ROWS * MACH_ROWS,)),
    Field("is_polynomial", 0, 1, "1: polynomials in place of the table", kind="u4"),
    Field("cl_powers", -1e6, 1e6, "of alpha^i Mach^j", shape=(POWERS_ALPHA * POWERS_MACH,)),
    Field("cd_powers", -1e6, 1e6, "of alpha^i Mach^j", shape=(POWERS_ALPHA * POWERS_MACH,)),
)

HEATING = RecordSpec(
    "heating",
    Field("coefficient", 0.0, 1e15, "k in q = k rho^m V^n, W/m2 with SI inputs; 0: no heating"),
    Field("rho_exponent", 0.1, 2.0, "m"),
    Field("v_exponent", 1.0, 10.0, "n"),
)

VEHICLE = RecordSpec(
    "vehicle",
    Field("mass_kg", 1e-3, 1e7, "nominal"),
    Field("reference_area_m2", 1e-6, 1e5, "of cl and cd"),
    Field("aero", record=AERO_TABLE),
)

ONBOARD = RecordSpec(
    "onboard",
    Field("planet", record=PLANET),
    Field("vehicle", record=VEHICLE),
    Field("heating", record=HEATING),
)

FORCES = RecordSpec(
    "forces",
    Field("rho_kgpm3", 0.0, UNBOUNDED, "modelled density"),
    Field("drag_mps2", 0.0, UNBOUNDED, "modelled, at the angle of attack asked for"),
    Field("lift_mps2", -UNBOUNDED, UNBOUNDED, "modelled"),
    Field("drag_area_m2", 0.0, UNBOUNDED, "CD S"),
    Field("gravity_mps2", 0.0, UNBOUNDED, "at this altitude"),
)


FORCE_SLOPES = RecordSpec(
    "force_slopes",
    Field("rho_kgpm3", 0.0, UNBOUNDED, "modelled density"),
    Field("drag_mps2", -UNBOUNDED, UNBOUNDED),
    Field("drag_by_v_1ps", why="1/s"),
    Field("drag_by_alt_1ps2", why="1/s2"),
    Field("drag_by_alpha_mps2prad", why="m/s2"),
    Field("lift_mps2", -UNBOUNDED, UNBOUNDED),
    Field("lift_by_v_1ps", why="1/s"),
    Field("lift_by_alt_1ps2", why="1/s2"),
    Field("lift_by_alpha_mps2prad", why="m/s2"),
    Field("rho_slope_1pm", why="of ln rho over altitude"),
)


@kernel
def polynomial(powers: F8, alpha_rad: float, mach: float) -> tuple[float, float, float]:
    """A coefficient and its slopes over angle of attack and Mach number."""
    value = 0.0
    by_alpha = 0.0
    by_mach = 0.0
    for i in range(POWERS_ALPHA - 1, -1, -1):
        first = powers[i * POWERS_MACH]
        second = powers[i * POWERS_MACH + 1]
        third = powers[i * POWERS_MACH + 2]
        by_alpha = by_alpha * alpha_rad + value
        value = value * alpha_rad + first + mach * (second + mach * third)
        by_mach = by_mach * alpha_rad + second + 2.0 * mach * third
    return value, by_alpha, by_mach


@kernel
def _coefficient(aero: Record, column: Record, row: int, col: int, wa: float, wm: float) -> float:
    """Bilinear value of one coefficient; `wa`, `wm` are the weights of the next row and column."""
    low = column[row * MACH_ROWS + col]
    high = column[(row + 1) * MACH_ROWS + col]
    if wm == 0.0:
        return low + wa * (high - low)
    low_next = column[row * MACH_ROWS + col + 1]
    high_next = column[(row + 1) * MACH_ROWS + col + 1]
    here = low + wa * (high - low)
    there = low_next + wa * (high_next - low_next)
    return here + wm * (there - here)


@kernel
def coefficients(
    aero: Record, atmosphere: Record, alt_m: float, v_rel_mps: float, alpha_rad: float
) -> tuple[float, float]:
    """C_L and C_D; angle of attack and Mach number outside the table take its edge value."""
    if aero["is_polynomial"] == 1:
        mach = v_rel_mps / sound_speed(atmosphere, alt_m)
        cl, _, _ = polynomial(aero["cl_powers"], alpha_rad, mach)
        cd, _, _ = polynomial(aero["cd_powers"], alpha_rad, mach)
        return cl, cd
    n_alpha = int(aero["n_alpha"])
    n_mach = int(aero["n_mach"])
    alpha_grid = aero["alpha_rad"]
    row = bracket(alpha_rad, alpha_grid, n_alpha)
    wa = (alpha_rad - alpha_grid[row]) / (alpha_grid[row + 1] - alpha_grid[row])
    wa = min(max(wa, 0.0), 1.0)
    col = 0
    wm = 0.0
    if n_mach > 1:
        mach_grid = aero["mach"]
        mach = v_rel_mps / sound_speed(atmosphere, alt_m)
        col = bracket(mach, mach_grid, n_mach)
        wm = (mach - mach_grid[col]) / (mach_grid[col + 1] - mach_grid[col])
        wm = min(max(wm, 0.0), 1.0)
    cl = _coefficient(aero, aero["cl"], row, col, wa, wm)
    cd = _coefficient(aero, aero["cd"], row, col, wa, wm)
    return cl, cd


@kernel
def _cell_slope(low: float, high: float, x: float, grid: F8, i: int) -> float:
    """Slope between two knots; 0 outside the grid's ends, where the edge value is held."""
    if x < grid[i] or x > grid[i + 1]:
        return 0.0
    return (high - low) / (grid[i + 1] - grid[i])


@kernel
def _coefficient_slopes(
    aero: Record, atmosphere: Record, alt_m: float, v_rel_mps: float, alpha_rad: float
) -> tuple[float, float, float, float]:
    """Slopes of C_L and C_D: over angle of attack and Mach number of each."""
    mach = v_rel_mps / sound_speed(atmosphere, alt_m)
    if aero["is_polynomial"] == 1:
        _, cl_alpha, cl_mach = polynomial(aero["cl_powers"], alpha_rad, mach)
        _, cd_alpha, cd_mach = polynomial(aero["cd_powers"], alpha_rad, mach)
        return cl_alpha, cl_mach, cd_alpha, cd_mach
    n_mach = int(aero["n_mach"])
    alphas = aero["alpha_rad"]
    row = bracket(alpha_rad, alphas, int(aero["n_alpha"]))
    wa = min(max((alpha_rad - alphas[row]) / (alphas[row + 1] - alphas[row]), 0.0), 1.0)
    col = 0
    wm = 0.0
    machs = aero["mach"]
    if n_mach > 1:
        col = bracket(mach, machs, n_mach)
        wm = min(max((mach - machs[col]) / (machs[col + 1] - machs[col]), 0.0), 1.0)
    cl_low = _coefficient(aero, aero["cl"], row, col, 0.0, wm)
    cl_high = _coefficient(aero, aero["cl"], row, col, 1.0, wm)
    cd_low = _coefficient(aero, aero["cd"], row, col, 0.0, wm)
    cd_high = _coefficient(aero, aero["cd"], row, col, 1.0, wm)
    cl_alpha = _cell_slope(cl_low, cl_high, alpha_rad, alphas, row)
    cd_alpha = _cell_slope(cd_low, cd_high, alpha_rad, alphas, row)
    if n_mach < 2:
        return cl_alpha, 0.0, cd_alpha, 0.0
    cl_low = _coefficient(aero, aero["cl"], row, col, wa, 0.0)
    cl_high = _coefficient(aero, aero["cl"], row, col, wa, 1.0)
    cd_low = _coefficient(aero, aero["cd"], row, col, wa, 0.0)
    cd_high = _coefficient(aero, aero["cd"], row, col, wa, 1.0)
    cl_mach = _cell_slope(cl_low, cl_high, mach, machs, col)
    return cl_alpha, cl_mach, cd_alpha, _cell_slope(cd_low, cd_high, mach, machs, col)


@kernel
def modelled_forces(
    onboard: Record,
    atmosphere: Record,
    alt_m: float,
    v_rel_mps: float,
    alpha_rad: float,
    forces: Record,
) -> None:
    """Density, gravity, drag and lift accelerations as the load knows them; writes `forces`.

    Angle of attack and Mach number outside the table take its edge value.
    """
    vehicle = onboard["vehicle"]
    aero = vehicle["aero"]
    planet = onboard["planet"]
    rho_kgpm3 = density(atmosphere, alt_m)
    cl, cd = coefficients(aero, atmosphere, alt_m, v_rel_mps, alpha_rad)
    pressure = 0.5 * rho_kgpm3 * v_rel_mps * v_rel_mps * vehicle["reference_area_m2"]
    radius_m = planet["radius_m"] + alt_m
    forces["rho_kgpm3"] = rho_kgpm3
    forces["drag_mps2"] = pressure * cd / vehicle["mass_kg"]
    forces["lift_mps2"] = pressure * cl / vehicle["mass_kg"]
    forces["drag_area_m2"] = cd * vehicle["reference_area_m2"]
    forces["gravity_mps2"] = planet["mu_m3ps2"] / (radius_m * radius_m)


@seldom_kernel
def force_slopes(
    onboard: Record,
    atmosphere: Record,
    alt_m: float,
    v_rel_mps: float,
    alpha_rad: float,
    out: Record,
) -> None:
    """Drag and lift accelerations with their slopes over speed, altitude and angle of attack.

    The forces are those of `modelled_forces`; at a knot of a table the slopes are those above it.
    """
    vehicle = onboard["vehicle"]
    aero = vehicle["aero"]
    cl, cd = coefficients(aero, atmosphere, alt_m, v_rel_mps, alpha_rad)
    cl_alpha, cl_mach, cd_alpha, cd_mach = _coefficient_slopes(
        aero, atmosphere, alt_m, v_rel_mps, alpha_rad
    )
    rho = density(atmosphere, alt_m)
    slope_1pm, _ = log_density_slopes(atmosphere, alt_m)
    if held_altitude(atmosphere, alt_m) != alt_m:
        slope_1pm = 0.0
    sound_mps, sound_slope = sound_speed_slope(atmosphere, alt_m)
    mach = v_rel_mps / sound_mps
    mach_by_alt = -mach * sound_slope / sound_mps
    per_speed = 0.5 * rho * v_rel_mps * vehicle["reference_area_m2"] / vehicle["mass_kg"]
    pressure = per_speed * v_rel_mps
    out["rho_kgpm3"] = rho
    out["rho_slope_1pm"] = slope_1pm
    out["drag_mps2"] = pressure * cd
    out["drag_by_v_1ps"] = 2.0 * per_speed * cd + pressure * cd_mach / sound_mps
    out["drag_by_alt_1ps2"] = pressure * (cd * slope_1pm + cd_mach * mach_by_alt)
    out["drag_by_alpha_mps2prad"] = pressure * cd_alpha
    out["lift_mps2"] = pressure * cl
    out["lift_by_v_1ps"] = 2.0 * per_speed * cl + pressure * cl_mach / sound_mps
    out["lift_by_alt_1ps2"] = pressure * (cl * slope_1pm + cl_mach * mach_by_alt)
    out["lift_by_alpha_mps2prad"] = pressure * cl_alpha


@kernel
def heat_flux(onboard: Record, rho_kgpm3: float, v_rel_mps: float) -> float:
    """Stagnation-point heat flux, W/m2.  [MOOIJ18] Eq. 7, its constants folded into one."""
    heating = onboard["heating"]
    return (
        heating["coefficient"]
        * math.pow(rho_kgpm3, heating["rho_exponent"])
        * math.pow(v_rel_mps, heating["v_exponent"])
    )


@kernel
def specific_energy(planet: Record, alt_m: float, v_rel_mps: float) -> float:
    """Kinetic plus potential energy relative to the reference sphere at rest, J/kg."""
    radius_m = planet["radius_m"]
    return 0.5 * v_rel_mps * v_rel_mps + planet["mu_m3ps2"] * alt_m / (
        radius_m * (radius_m + alt_m)
    )
