"""Profiles of a flight's air over altitude: bias, table, and a random part drawn from the seed.

The random part is a Gauss-Markov process of second order in altitude: its correlation over a
distance x is (1 + a x) exp(-a x), so that it has a slope, and its standard deviation runs linearly
between two altitudes. It is drawn exactly at the edges of the cells; a cubic spline through them
makes the record, twice differentiable, so that it does not spoil the order of the integration.
"""

import math

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline, PchipInterpolator

from flight_sw.errors import MissionError
from sim_harness.jit import kernel
from sim_harness.mission.mission import Mission
from sim_harness.world import noise
from sim_harness.world.noise import gaussians
from sim_harness.world.records import AIR, AIR_CELLS

F8 = npt.NDArray[np.float64]

ONE_OVER_E = 2.1461932206205825  # root of (1 + x) exp(-x) = 1/e
STEP_MIN = 1e-4  # floor on a step over the length: below, its innovation drowns in round-off
CELLS_PER_LENGTH = 2.0  # at least: a shorter correlation is not told by the cells


@kernel
def fill_process(seed: int, stream: int, x: float, values: F8) -> None:
    """The process at steps of x = a times the distance; its state is (value, slope / a)."""
    fall = math.exp(-x)
    # What a step adds has the covariance 1 - transition transition^T; its Cholesky factor.
    added_11 = 1.0 - fall * fall * (1.0 + 2.0 * x + 2.0 * x * x)
    added_12 = 2.0 * fall * fall * x * x
    added_22 = 1.0 - fall * fall * (1.0 - 2.0 * x + 2.0 * x * x)
    root_11 = math.sqrt(added_11)
    root_12 = added_12 / root_11
    root_22 = math.sqrt(added_22 - root_12 * root_12)
    value, slope = gaussians(seed, stream, 0)
    values[0] = value
    for i in range(1, len(values)):
        first, second = gaussians(seed, stream, i)
        value_before = value
        value = fall * ((1.0 + x) * value + x * slope) + root_11 * first
        slope = fall * ((1.0 - x) * slope - x * value_before) + root_12 * first + root_22 * second
        values[i] = value


def unit_process(seed: int, stream: int, step_m: float, length_m: float, n: int) -> F8:
    """n values of a process of standard deviation 1, a step apart, with correlation 1/e over a
    length."""
    values = np.zeros(n)
    fill_process(seed, stream, max(ONE_OVER_E * step_m / length_m, STEP_MIN), values)
    return values


def sigma_at(alts_m: F8, ground: float, top: float, top_km: float) -> F8:
    """A standard deviation that runs linearly from the ground to an altitude, and is held above."""
    return np.interp(alts_m, [0.0, top_km * 1e3], [ground, top])


def cells(edges_m: F8, values: F8) -> F8:
    """Coefficients of the spline through the values, in powers of the share of a cell."""
    step_m = edges_m[1] - edges_m[0]
    spline = CubicSpline(edges_m, values)
    return np.asarray(spline.c[::-1].T * step_m ** np.arange(4.0))


def checked_length_m(mission: Mission, key: str, length_km: float, step_m: float) -> float:
    """A correlation length that the cells can tell."""
    shortest_km = CELLS_PER_LENGTH * step_m / 1e3
    if length_km < shortest_km:
        raise MissionError(
            f"{mission.path.name}: {key} is {length_km:.12g}, allowed from {shortest_km:.3g} km "
            f"for an entry at {mission.entry.altitude_km:.12g} km"
        )
    return length_km * 1e3


def density_profile(mission: Mission, seed: int, edges_m: F8) -> F8:
    """Logarithm of true over nominal density."""
    keys = mission.atmosphere
    values = np.full(edges_m.size, math.log(keys.density_factor))
    sigma = sigma_at(
        edges_m, keys.density_sigma_ground_ratio, keys.density_sigma_top_ratio,
        keys.density_sigma_top_km,
    )  # fmt: skip
    if sigma.any():
        step_m = float(edges_m[1])
        length_m = checked_length_m(
            mission, "atmosphere.density_correlation_km", keys.density_correlation_km, step_m
        )
        values += sigma * unit_process(seed, noise.AIR_DENSITY, step_m, length_m, edges_m.size)
    return values


def wind_profile(mission: Mission, seed: int, edges_m: F8, stream: int) -> F8:
    """Wind towards the east, or the north, by the stream of its random part."""
    keys = mission.wind
    is_east = stream == noise.WIND_EAST
    values = np.full(edges_m.size, keys.east_mps if is_east else keys.north_mps)
    table = keys.east_table_mps if is_east else keys.north_table_mps
    if keys.table_altitude_km is not None and table is not None:
        knots_m = np.array(keys.table_altitude_km) * 1e3
        held_m = np.clip(edges_m, knots_m[0], knots_m[-1])
        values += PchipInterpolator(knots_m, table)(held_m)
    sigma = sigma_at(edges_m, keys.sigma_ground_mps, keys.sigma_top_mps, keys.sigma_top_km)
    if sigma.any():
        step_m = float(edges_m[1])
        length_m = checked_length_m(mission, "wind.correlation_km", keys.correlation_km, step_m)
        values += sigma * unit_process(seed, stream, step_m, length_m, edges_m.size)
    return values


def air_record(mission: Mission, seed: int) -> np.ndarray:
    """The AIR record of one flight, shape (1,), from the ground to the entry altitude."""
    air = np.zeros(1, AIR)
    edges_m = np.linspace(0.0, mission.entry.altitude_km * 1e3, AIR_CELLS + 1)
    air["cells_pm"] = 1.0 / edges_m[1]
    for name, flag, values in (
        ("ln_rho", "is_disturbed", density_profile(mission, seed, edges_m)),
        ("wind_east_mps", "has_wind", wind_profile(mission, seed, edges_m, noise.WIND_EAST)),
        ("wind_north_mps", "has_wind", wind_profile(mission, seed, edges_m, noise.WIND_NORTH)),
    ):
        if values.any():
            air[name][0] = cells(edges_m, values)
            air[flag] = 1
    return air
