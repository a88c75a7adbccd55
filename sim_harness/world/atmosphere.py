"""Builds the ATMOSPHERE record: exponential, U.S. Standard 1976, or a table of one's own."""

import itertools
import math

import numpy as np
from scipy.interpolate import CubicSpline

from flight_sw.model.atmosphere import ATMOSPHERE, BUCKETS, KNOTS_MAX
from flight_sw.records.types_ import F8
from sim_harness.world import us76

EXPONENTIAL_LOWEST_M = -10_000.0
EXPONENTIAL_HIGHEST_M = 2_000_000.0
US76_LAYER_STEP_M = 1_000.0
US76_STEPS_M = ((150_000.0, 1_000.0), (300_000.0, 5_000.0), (us76.HIGHEST_M, 20_000.0))


def hermite(width_m: float, left: float, right: float, slope_left: float, slope_right: float) -> F8:
    """Coefficients (powers 0..3) of the cubic with given values and slopes at both ends."""
    secant = (right - left) / width_m
    second = (3.0 * secant - 2.0 * slope_left - slope_right) / width_m
    third = (slope_left + slope_right - 2.0 * secant) / (width_m * width_m)
    return np.array([left, slope_left, second, third])


def pack(alts_m: F8, coefficients: F8, sound_speed_mps: F8) -> np.ndarray:
    """The record from knots, one row of cubic coefficients per interval, and the speed of sound."""
    n = len(alts_m)
    if not 2 <= n <= KNOTS_MAX:
        raise ValueError(f"atmosphere has {n} knots, allowed 2 to {KNOTS_MAX}")
    record = np.zeros(1, ATMOSPHERE)
    record["n"] = n
    record["alt_m"][0, :n] = alts_m
    record["ln_rho"][0, : n - 1] = coefficients
    record["sound_speed_sq_m2ps2"][0, :n] = np.square(sound_speed_mps)
    span_m = alts_m[-1] - alts_m[0]
    record["buckets_pm"] = BUCKETS / span_m
    # A hair below the edge, so that round-off in the kernel never starts above its interval.
    edges_m = alts_m[0] + span_m * (np.arange(BUCKETS) / BUCKETS - 1e-9)
    record["bucket"] = np.clip(np.searchsorted(alts_m, edges_m, side="right") - 1, 0, n - 2)
    return record


def exponential(rho0_kgpm3: float, scale_height_m: float, sound_speed_mps: float) -> np.ndarray:
    """rho0 exp(-alt/scale height) from -10 to 2,000 km; the speed of sound is constant."""
    alts_m = np.array([EXPONENTIAL_LOWEST_M, EXPONENTIAL_HIGHEST_M])
    lowest = math.log(rho0_kgpm3) - EXPONENTIAL_LOWEST_M / scale_height_m
    row = np.array([[lowest, -1.0 / scale_height_m, 0.0, 0.0]])
    return pack(alts_m, row, np.full(2, sound_speed_mps))


def us_standard_1976() -> np.ndarray:
    """[US76] from -5 to 1,000 km; the speed of sound of 86 km is held above."""
    bases_m = [us76.geometric_m(layer.base_m) for layer in us76.LAYERS[1:]]
    grid_m = np.arange(us76.LOWEST_M, us76.TURBOPAUSE_M + 1.0, US76_LAYER_STEP_M)
    below_m = np.unique(np.concatenate([grid_m, bases_m]))
    rows = []
    sound = []
    for left_m, right_m in itertools.pairwise(below_m):
        layer = us76.layer_at(0.5 * (left_m + right_m))
        rho_left, slope_left, temperature_k = us76.layer_state(layer, left_m)
        rho_right, slope_right, _ = us76.layer_state(layer, right_m)
        values = math.log(rho_left), math.log(rho_right)
        rows.append(hermite(right_m - left_m, *values, slope_left, slope_right))
        sound.append(sound_speed_of(temperature_k))
    spline = us76.ln_density_above_86_km()
    above_m = [us76.TURBOPAUSE_M]
    for top_m, step_m in US76_STEPS_M:
        above_m.extend(np.arange(above_m[-1] + step_m, top_m + 1.0, step_m))
    for left_m, right_m in itertools.pairwise(above_m):
        slopes = spline(left_m, 1), spline(right_m, 1)
        rows.append(hermite(right_m - left_m, spline(left_m), spline(right_m), *slopes))
    _, _, temperature_k = us76.layer_state(us76.LAYERS[-1], us76.TURBOPAUSE_M)
    sound.extend([sound_speed_of(temperature_k)] * len(above_m))
    alts_m = np.concatenate([below_m, above_m[1:]])
    return pack(alts_m, np.array(rows), np.array(sound))


def sound_speed_of(temperature_k: float) -> float:
    """Speed of sound in air of 28.9644 kg/kmol."""
    return math.sqrt(us76.HEAT_CAPACITY_RATIO * us76.GAS_CONSTANT_JPKGK * temperature_k)


def table(alts_m: F8, rho_kgpm3: F8, sound_speed_mps: F8) -> np.ndarray:
    """Natural cubic spline of ln(density) through a table of one's own."""
    if len(alts_m) < 3:
        slope = np.diff(np.log(rho_kgpm3)) / np.diff(alts_m)
        rows = np.array([[math.log(rho_kgpm3[0]), slope[0], 0.0, 0.0]])
        return pack(alts_m, rows, sound_speed_mps)
    spline = CubicSpline(alts_m, np.log(rho_kgpm3), bc_type="natural")
    return pack(alts_m, spline.c[::-1].T, sound_speed_mps)
