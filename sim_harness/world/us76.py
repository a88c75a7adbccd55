"""U.S. Standard Atmosphere 1976 [US76]: exact layers to 86 km, the published table above.

Above 86 km the temperature is the standard's own formula. The mean molecular mass is read off the
published pressures and densities; hydrostatic equilibrium with it gives the density between them,
and the small rest at the published points (rounding of four digits) is splined away, so that the
published densities are met. The speed of sound is not defined above 86 km: the value there is held.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline

from flight_sw.records.types_ import F8

EARTH_RADIUS_M = 6_356_766.0  # [US76], of the geopotential
G0_MPS2 = 9.80665
GAS_CONSTANT_JPKMOLK = 8314.32
MOLAR_MASS_KGPKMOL = 28.9644  # to 86 km
GAS_CONSTANT_JPKGK = GAS_CONSTANT_JPKMOLK / MOLAR_MASS_KGPKMOL
HEAT_CAPACITY_RATIO = 1.4

LOWEST_M = -5_000.0
TURBOPAUSE_M = 86_000.0
HIGHEST_M = 1_000_000.0


class Layer(NamedTuple):
    """A layer of constant lapse rate; altitudes are geopotential."""

    base_m: float
    lapse_kpm: float
    base_k: float
    base_pa: float


LAYERS = (
    Layer(0.0, -6.5e-3, 288.15, 101_325.0),
    Layer(11_000.0, 0.0, 216.65, 22_632.1),
    Layer(20_000.0, 1.0e-3, 216.65, 5_474.89),
    Layer(32_000.0, 2.8e-3, 228.65, 868.019),
    Layer(47_000.0, 0.0, 270.65, 110.906),
    Layer(51_000.0, -2.8e-3, 270.65, 66.9389),
    Layer(71_000.0, -2.0e-3, 214.65, 3.95642),
)

# altitude km, pressure Pa, density kg/m3, as published in [US76]
PUBLISHED_ABOVE_86_KM = (
    (86.0, 3.7338e-1, 6.958e-6),
    (90.0, 1.8359e-1, 3.416e-6),
    (95.0, 7.5966e-2, 1.393e-6),
    (100.0, 3.2011e-2, 5.604e-7),
    (105.0, 1.4477e-2, 2.325e-7),
    (110.0, 7.1042e-3, 9.708e-8),
    (115.0, 4.0096e-3, 4.289e-8),
    (120.0, 2.5382e-3, 2.222e-8),
    (130.0, 1.2505e-3, 8.152e-9),
    (140.0, 7.2028e-4, 3.831e-9),
    (150.0, 4.5422e-4, 2.076e-9),
    (200.0, 8.4736e-5, 2.541e-10),
    (250.0, 2.4767e-5, 6.073e-11),
    (300.0, 8.7704e-6, 1.916e-11),
    (400.0, 1.4518e-6, 2.803e-12),
    (500.0, 3.0236e-7, 5.215e-13),
    (600.0, 8.2130e-8, 1.137e-13),
    (700.0, 3.1908e-8, 3.070e-14),
    (800.0, 1.7036e-8, 1.136e-14),
    (900.0, 1.0873e-8, 5.759e-15),
    (1000.0, 7.5138e-9, 3.561e-15),
)


def geopotential_m(alt_m: float) -> float:
    """Geopotential altitude of a geometric one."""
    return EARTH_RADIUS_M * alt_m / (EARTH_RADIUS_M + alt_m)


def geometric_m(geopotential: float) -> float:
    """Geometric altitude of a geopotential one."""
    return EARTH_RADIUS_M * geopotential / (EARTH_RADIUS_M - geopotential)


def layer_state(layer: Layer, alt_m: float) -> tuple[float, float, float]:
    """Density, d ln(density)/d altitude and molecular-scale temperature by one layer's formula."""
    above_m = geopotential_m(alt_m) - layer.base_m
    temperature_k = layer.base_k + layer.lapse_kpm * above_m
    hydrostatic_kpm = G0_MPS2 / GAS_CONSTANT_JPKGK
    if layer.lapse_kpm == 0.0:
        pressure_pa = layer.base_pa * math.exp(-hydrostatic_kpm * above_m / layer.base_k)
    else:
        power = hydrostatic_kpm / layer.lapse_kpm
        pressure_pa = layer.base_pa * (layer.base_k / temperature_k) ** power
    stretch = (EARTH_RADIUS_M / (EARTH_RADIUS_M + alt_m)) ** 2  # d geopotential / d geometric
    slope_perm = -(hydrostatic_kpm + layer.lapse_kpm) / temperature_k * stretch
    return pressure_pa / (GAS_CONSTANT_JPKGK * temperature_k), slope_perm, temperature_k


def layer_at(alt_m: float) -> Layer:
    """The layer that holds a geometric altitude; the lowest one reaches down to -5 km."""
    height_m = geopotential_m(alt_m)
    return next((layer for layer in reversed(LAYERS) if layer.base_m <= height_m), LAYERS[0])


def temperature_above_86_km(alt_m: F8) -> F8:
    """Kinetic temperature in K, 86 to 1000 km ([US76] Eqs 25, 27, 29, 31)."""
    z = np.asarray(alt_m) / 1000.0
    radius_km = EARTH_RADIUS_M / 1000.0
    ellipse = np.clip((z - 91.0) / 19.9429, -1.0, 1.0)
    xi = (z - 120.0) * (radius_km + 120.0) / (radius_km + z)
    regions = [z <= 91.0, z <= 110.0, z <= 120.0]
    values = [
        np.full_like(z, 186.8673),
        263.1905 - 76.3232 * np.sqrt(1.0 - ellipse * ellipse),
        240.0 + 12.0 * (z - 110.0),
    ]
    return np.select(regions, values, 1000.0 - 640.0 * np.exp(-0.01875 * xi))


def ln_density_above_86_km(
    published: tuple[tuple[float, float, float], ...] = PUBLISHED_ABOVE_86_KM,
) -> CubicSpline:
    """Spline of ln(density) against geometric altitude in m that meets the published densities."""
    alts_m, pressures_pa, densities = np.array(published).T * np.array([[1e3], [1.0], [1.0]])
    grid_m = np.arange(alts_m[0], alts_m[-1] + 1.0, 100.0)
    molar_mass = CubicSpline(
        alts_m,
        densities * GAS_CONSTANT_JPKMOLK * temperature_above_86_km(alts_m) / pressures_pa,
    )(grid_m)
    gravity = G0_MPS2 * (EARTH_RADIUS_M / (EARTH_RADIUS_M + grid_m)) ** 2
    mass_per_kt = molar_mass / (GAS_CONSTANT_JPKMOLK * temperature_above_86_km(grid_m))
    ln_pressure = cumulative_simpson(-gravity * mass_per_kt, x=grid_m, initial=0.0)
    hydrostatic = CubicSpline(grid_m, ln_pressure + np.log(mass_per_kt))
    rest = CubicSpline(alts_m, np.log(densities) - hydrostatic(alts_m))
    return CubicSpline(grid_m, hydrostatic(grid_m) + rest(grid_m))
