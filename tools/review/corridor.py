"""The entry corridor: the drag that each path limit allows at a speed, and the altitude it means.

What the vehicle can do at a speed (drag per dynamic pressure, lift over drag) is taken from the
flight itself, so that the corridor is that of the angle of attack, Mach number and mass flown.
Beyond the flown speeds the nearest flown value is held.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

F8 = npt.NDArray[np.float64]
Rows = npt.NDArray[np.void]
Record = np.void

HEAT_FLUX, LOAD_FACTOR = "heat flux", "load factor"
DYNAMIC_PRESSURE, EQUILIBRIUM = "dynamic pressure", "equilibrium glide"
UPPER = (HEAT_FLUX, LOAD_FACTOR, DYNAMIC_PRESSURE)
"""Limits that drag must stay below; equilibrium glide is one it has to stay above."""

FIELDS = (
    "v_rel_mps", "drag_mps2", "lift_mps2", "dynamic_pressure_pa", "lat_rad", "heading_rad",
)  # fmt: skip
POINTS = 400
ALTITUDE_ROUNDS = 4  # of gravity and radius at the altitude of equilibrium glide; 2 would do


class Flown(NamedTuple):
    """What the vehicle was able to do, by speed, ascending."""

    v_rel_mps: F8
    drag_per_pressure_m2pkg: F8  # C_D S / m
    lift_to_drag_ratio: F8
    lat_rad: F8
    heading_rad: F8


class PathLimits(NamedTuple):
    """The mission's limits; infinite where there is none."""

    heat_flux_wpm2: float
    load_factor_g: float
    dynamic_pressure_pa: float


class Corridor(NamedTuple):
    """Lines over speed; NaN where a limit does not exist."""

    v_rel_mps: F8
    drag_mps2: Mapping[str, F8]
    alt_m: Mapping[str, F8]


def flown_by_speed(truth: Rows) -> Flown | None:
    """The last state at each speed, on the way down from the highest; None without air."""
    if not set(FIELDS) <= set(truth.dtype.names or ()) or len(truth) < 2:
        return None
    rows = truth[int(truth["v_rel_mps"].argmax()) :]
    lowest = np.minimum.accumulate(rows["v_rel_mps"])
    is_new = np.append(True, lowest[1:] < lowest[:-1])
    rows = rows[is_new & (rows["dynamic_pressure_pa"] > 0.0) & (rows["drag_mps2"] > 0.0)][::-1]
    if len(rows) < 2:
        return None
    return Flown(
        rows["v_rel_mps"].copy(),
        rows["drag_mps2"] / rows["dynamic_pressure_pa"],
        rows["lift_mps2"] / rows["drag_mps2"],
        rows["lat_rad"].copy(),
        np.unwrap(rows["heading_rad"]),
    )


def density_altitude(atmosphere: Record) -> tuple[F8, F8]:
    """Altitudes and ln(density), finely sampled from the ATMOSPHERE record's piecewise cubics."""
    n = int(atmosphere["n"])
    knots, cubics = atmosphere["alt_m"][:n], atmosphere["ln_rho"][: n - 1]
    share = np.linspace(0.0, 1.0, 16, endpoint=False)
    x = share[None, :] * np.diff(knots)[:, None]
    powers = x[..., None] ** np.arange(4)
    ln_rho = (powers * cubics[:, None, :]).sum(axis=-1)
    return (knots[:-1, None] + x).ravel(), ln_rho.ravel()


def altitude_of_density(atmosphere: Record, rho_kgpm3: F8) -> F8:
    """The altitude with a density; NaN outside the atmosphere's table."""
    alt, ln_rho = density_altitude(atmosphere)
    falling = np.minimum.accumulate(ln_rho)
    with np.errstate(divide="ignore", invalid="ignore"):
        wanted = np.log(rho_kgpm3)
    return np.interp(wanted, falling[::-1], alt[::-1], left=np.nan, right=np.nan)


def corridor(world: Record, limits: PathLimits, flown: Flown, v_low_mps: float) -> Corridor:
    """The corridor from the highest speed flown down to `v_low_mps`, or to the lowest flown."""
    low = min(v_low_mps, flown.v_rel_mps[0]) if v_low_mps > 0.0 else flown.v_rel_mps[0]
    v = np.linspace(max(low, 1.0), flown.v_rel_mps[-1], POINTS)
    area = np.interp(v, flown.v_rel_mps, flown.drag_per_pressure_m2pkg)
    ratio = np.interp(v, flown.v_rel_mps, flown.lift_to_drag_ratio)
    per_density = 0.5 * v * v * area  # drag per density
    heating, planet = world["heating"], world["planet"]
    rho_of_flux = limits.heat_flux_wpm2 / heating["factor_si"] / v ** heating["velocity_exponent"]
    rho_of_flux = rho_of_flux ** (1.0 / heating["density_exponent"])
    acceleration = limits.load_factor_g * planet["g0_mps2"]
    drag = {
        HEAT_FLUX: rho_of_flux * per_density,
        LOAD_FACTOR: acceleration / np.sqrt(1.0 + ratio * ratio),
        DYNAMIC_PRESSURE: limits.dynamic_pressure_pa * area,
        EQUILIBRIUM: _equilibrium_drag(world, flown, v, per_density, ratio),
    }
    drag = {name: np.where(np.isfinite(line), line, np.nan) for name, line in drag.items()}
    drag = {name: line for name, line in drag.items() if np.isfinite(line).any()}
    alt = {
        name: altitude_of_density(world["atmosphere"], line / per_density)
        for name, line in drag.items()
    }
    return Corridor(v, drag, alt)


def _equilibrium_drag(world: Record, flown: Flown, v: F8, per_density: F8, ratio: F8) -> F8:
    """Drag where full lift up just holds the flight-path angle level; NaN where none is needed.

    [MOOIJ18] Eq. 2 with flight-path angle, bank and their rates at zero, over a round planet that
    turns: lift = g - V^2/r - 2 w V cos(lat) sin(heading) - w^2 r cos^2(lat).
    """
    planet = world["planet"]
    spin, c_lat = planet["rotation_radps"], np.cos(np.interp(v, flown.v_rel_mps, flown.lat_rad))
    s_head = np.sin(np.interp(v, flown.v_rel_mps, flown.heading_rad))
    alt = np.zeros_like(v)
    drag = np.full_like(v, np.nan)
    for _ in range(ALTITUDE_ROUNDS):
        r = planet["radius_m"] + alt
        lift = planet["mu_m3ps2"] / r**2 - v * v / r
        lift = lift - 2.0 * spin * v * c_lat * s_head - spin**2 * r * c_lat**2
        possible = (lift > 0.0) & (ratio > 0.0)
        drag = np.where(possible, lift / np.where(ratio > 0.0, ratio, np.nan), np.nan)
        found = altitude_of_density(world["atmosphere"], drag / per_density)
        alt = np.where(np.isfinite(found), found, alt)
    return drag
