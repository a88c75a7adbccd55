"""The air as it is: the mission's atmosphere times a disturbance, and the wind.

Logarithm of the density's disturbance and both winds are piecewise cubics over equal cells of
altitude, filled by sim_harness/world/profiles.py. Without a disturbance or a wind nothing is looked
up.

Limits: no vertical wind; the disturbances depend on altitude alone and hold their ends outside
their cells.
"""

import math

from flight_sw.model.atmosphere import density, sound_speed
from flight_sw.records.types_ import F8, Record
from sim_harness.jit import kernel
from sim_harness.world.aerodynamics import follows_mach, true_areas
from sim_harness.world.heating import heat_flux
from sim_harness.world.records import AIR_CELLS

SPEED_MIN_MPS = 1e-6  # floor on speeds that divide: no effect above it

Loads = tuple[float, float, float, float]


@kernel
def cell_at(air: Record, alt_m: float) -> tuple[int, float]:
    """Cell of an altitude and where in it, from 0 to 1; NaN is passed on."""
    position = (alt_m - air["low_m"]) * air["cells_pm"]
    if position <= 0.0:
        return 0, 0.0
    if position >= AIR_CELLS:
        return AIR_CELLS - 1, 1.0
    if not math.isfinite(position):
        return 0, position
    cell = int(position)
    return cell, position - cell


@kernel
def cubic(profile: F8, cell: int, u: float) -> float:
    """Value of a profile."""
    return profile[cell, 0] + u * (profile[cell, 1] + u * (profile[cell, 2] + u * profile[cell, 3]))


@kernel
def true_density(world: Record, alt_m: float) -> float:
    """Density in kg/m3."""
    air = world["air"]
    rho = density(world["atmosphere"], alt_m)
    if air["is_disturbed"] == 0:
        return rho
    cell, u = cell_at(air, alt_m)
    return rho * math.exp(cubic(air["ln_rho"], cell, u))


@kernel
def wind(air: Record, alt_m: float) -> tuple[float, float]:
    """Wind towards east and north over the rotating planet, m/s."""
    cell, u = cell_at(air, alt_m)
    return cubic(air["wind_east_mps"], cell, u), cubic(air["wind_north_mps"], cell, u)


@kernel
def airspeed(
    world: Record, alt_m: float, v_rel_mps: float, fpa_rad: float, head_rad: float
) -> float:
    """Speed through the air, m/s."""
    air = world["air"]
    if air["has_wind"] == 0:
        return v_rel_mps
    wind_east, wind_north = wind(air, alt_m)
    level = v_rel_mps * math.cos(fpa_rad)
    east = level * math.sin(head_rad) - wind_east
    north = level * math.cos(head_rad) - wind_north
    up = v_rel_mps * math.sin(fpa_rad)
    return math.sqrt(east * east + north * north + up * up)


@kernel
def aero_accelerations(
    world: Record, held: Record, alt_m: float, v_air_mps: float, rho_kgpm3: float
) -> tuple[float, float]:
    """Lift and drag per mass, m/s2."""
    aero = world["aerodynamics"]
    lift_area_m2 = held["lift_area_m2"]
    drag_area_m2 = held["drag_area_m2"]
    if follows_mach(aero):
        mach = v_air_mps / sound_speed(world["atmosphere"], alt_m)
        lift_area_m2, drag_area_m2 = true_areas(aero, held["alpha_rad"], mach)
    pressure_per_mass = 0.5 * rho_kgpm3 * v_air_mps * v_air_mps / aero["mass_kg"]
    return pressure_per_mass * lift_area_m2, pressure_per_mass * drag_area_m2


@kernel
def _loads_in_wind(
    world: Record, held: Record, alt_m: float, v: float,
    s_fpa: float, c_fpa: float, s_head: float, c_head: float,
) -> Loads:  # fmt: skip
    """As `air_loads`: drag against the motion through the air, lift across it, banked about it."""
    wind_east, wind_north = wind(world["air"], alt_m)
    east = v * c_fpa * s_head - wind_east
    north = v * c_fpa * c_head - wind_north
    up = v * s_fpa
    level = math.sqrt(east * east + north * north)
    v_air = math.sqrt(level * level + up * up)
    level_safe = max(level, SPEED_MIN_MPS)
    v_air_safe = max(v_air, SPEED_MIN_MPS)
    rho = true_density(world, alt_m)
    lift, drag = aero_accelerations(world, held, alt_m, v_air, rho)
    # Upward across the motion, in its vertical plane, and to its right.
    across = lift * held["cos_bank"]
    right = lift * held["sin_bank"]
    level_share = -drag * level / v_air_safe - across * up / v_air_safe
    to_east = level_share * east / level_safe + right * north / level_safe
    to_north = level_share * north / level_safe - right * east / level_safe
    to_up = -drag * up / v_air_safe + across * level / v_air_safe
    to_front = to_east * s_head + to_north * c_head
    return (
        to_front * c_fpa + to_up * s_fpa,
        to_up * c_fpa - to_front * s_fpa,
        to_east * c_head - to_north * s_head,
        heat_flux(world["heating"], rho, v_air),
    )


@kernel
def air_loads(
    world: Record, held: Record, alt_m: float, v: float,
    s_fpa: float, c_fpa: float, s_head: float, c_head: float,
) -> Loads:  # fmt: skip
    """Aerodynamic acceleration along the motion over the planet, upward across it and to its right,
    m/s2, and the heat flux in W/m2."""
    if world["air"]["has_wind"] == 1:
        return _loads_in_wind(world, held, alt_m, v, s_fpa, c_fpa, s_head, c_head)
    rho = true_density(world, alt_m)
    lift, drag = aero_accelerations(world, held, alt_m, v, rho)
    flux = heat_flux(world["heating"], rho, v)
    return -drag, lift * held["cos_bank"], lift * held["sin_bank"], flux
