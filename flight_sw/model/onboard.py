"""What the flight computer believes of planet, vehicle and heating, and the forces that follow.

The truth may differ: these numbers come from the load image, the world's from the mission file.
"""

import math

from flight_sw.model.atmosphere import density, sound_speed
from flight_sw.model.tables import bracket
from flight_sw.records.fields import UNBOUNDED, Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

ALPHA_ROWS = 80
MACH_ROWS = 16

PLANET = RecordSpec(
    "planet",
    Field("radius_m", 1e5, 1e8, "reference sphere"),
    Field("mu_m3ps2", 1e9, 1e18, "gravity"),
    Field("rotation_radps", -1e-2, 1e-2, "about the north pole"),
    Field("g0_mps2", 0.1, 100.0, "unit of load factor"),
)

AERO_TABLE = RecordSpec(
    "aero_table",
    Field("n_alpha", 2, ALPHA_ROWS, "rows in use", kind="u4"),
    Field("n_mach", 1, MACH_ROWS, "columns in use", kind="u4"),
    Field("alpha_rad", -math.pi, math.pi, "grid", shape=(ALPHA_ROWS,), rows="n_alpha"),
    Field("mach", 0.0, 1000.0, "grid", shape=(MACH_ROWS,), rows="n_mach"),
    Field("cl", -300.0, 300.0, "lift", shape=(ALPHA_ROWS * MACH_ROWS,)),
    Field("cd", 0.0, 300.0, "drag", shape=(ALPHA_ROWS * MACH_ROWS,)),
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
    pressure = 0.5 * rho_kgpm3 * v_rel_mps * v_rel_mps * vehicle["reference_area_m2"]
    radius_m = planet["radius_m"] + alt_m
    forces["rho_kgpm3"] = rho_kgpm3
    forces["drag_mps2"] = pressure * cd / vehicle["mass_kg"]
    forces["lift_mps2"] = pressure * cl / vehicle["mass_kg"]
    forces["drag_area_m2"] = cd * vehicle["reference_area_m2"]
    forces["gravity_mps2"] = planet["mu_m3ps2"] / (radius_m * radius_m)


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
