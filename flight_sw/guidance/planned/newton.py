"""How far the end of a flight ahead is from what is wanted, and the step that removes it.

[JOSHI] Eqs. 12-19: the errors and their Jacobian by the bank at the knots, and the minimum-norm
step of Newton's. In place of the errors of latitude and longitude stands how far north and east of
the target the flight ends: over a pole the two tell nothing of a distance.
"""

import math

import numpy as np

from flight_sw.guidance.planned.normal_equations import solve_symmetric
from flight_sw.guidance.planned.plan_job import AT_BANK, AT_EAST, AT_EXCESS, AT_NORTH, ROWS
from flight_sw.model.motion import LAMBDA, N_STATES, PHI, RADIUS, motion_rates
from flight_sw.model.profile import KNOTS_MAX, index_of, index_slopes, weight_of
from flight_sw.model.propagation import controls_of
from flight_sw.model.sphere import offset, offset_slopes
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel, seldom_kernel


@kernel
def target_error_of(error: F8) -> float:
    """e_t, [JOSHI] Eq. 13: the weighted squares of all but the excess."""
    total = 0.0
    for i in range(AT_EXCESS):
        total += error[i] * error[i]
    return total


@seldom_kernel
def judge(load: Record, design: Record, job: Record) -> float:
    """Errors and their Jacobian at the end of the flight ahead; the squared error."""
    profile, path = job["profile"], job["path"]
    planet = load["onboard"]["planet"]
    x = path["x"]
    index = index_of(profile, planet, x, path["t_s"])
    alpha, bank, _, bank_slope = controls_of(path, profile, index)
    motion_rates(load["onboard"], load["atmosphere"], x, alpha, bank, job["motion"])
    rate = job["motion"]["rate"]
    index_slopes(profile, planet, x, job["motion"], job["slopes"])
    error = job["error"]
    target_lat, target_lon = design["target_lat_rad"], design["target_lon_rad"]
    north, east = offset(x[PHI], x[LAMBDA], target_lat, target_lon)
    north_by_lat, north_by_lon, east_by_lat, east_by_lon = offset_slopes(
        x[PHI], x[LAMBDA], target_lat, target_lon
    )
    error[AT_NORTH] = design["target_weight_1prad"] * north
    error[AT_EAST] = design["target_weight_1prad"] * east
    error[AT_BANK] = design["bank_weight_1prad"] * (bank - design["end_bank_rad"])
    root = math.sqrt(path["excess"])
    error[AT_EXCESS] = design["excess_weight_ratio"] * root
    n_bank = np.int64(profile["n_bank"])
    for k in range(n_bank):
        later_s = -path["by_knot"][RADIUS, k] / rate[RADIUS]  # to come down to the end altitude
        by_index = 0.0
        for i in range(N_STATES):
            by_index += job["slopes"][i] * (path["by_knot"][i, k] + rate[i] * later_s)
        row = job["jacobian"]
        lat = path["by_knot"][PHI, k] + rate[PHI] * later_s
        lon = path["by_knot"][LAMBDA, k] + rate[LAMBDA] * later_s
        row[AT_NORTH, k] = design["target_weight_1prad"] * (north_by_lat * lat + north_by_lon * lon)
        row[AT_EAST, k] = design["target_weight_1prad"] * (east_by_lat * lat + east_by_lon * lon)
        row[AT_BANK, k] = design["bank_weight_1prad"] * (
            bank_slope * by_index
            + weight_of(profile["bank_index"], n_bank, path["bank_segment"], index, k)
        )
        row[AT_EXCESS, k] = 0.0
        if root > 0.0:
            row[AT_EXCESS, k] = (
                design["excess_weight_ratio"] * 0.5 * path["excess_by_knot"][k] / root
            )
    total = 0.0
    for i in range(ROWS):
        total += error[i] * error[i]
    return total


@seldom_kernel
def newton_step(design: Record, job: Record) -> bool:
    """Minimum-norm step of the free knots that removes the errors in first order.

    step = -J^T (J J^T)^-1 error, [JOSHI] Eq. 19 with its rows kept apart. Rows that say nothing
    new, as that of an excess of zero, are left out. False if none is left.
    """
    error, jacobian, rows = job["best_error"], job["best_jacobian"], job["rows"]
    n_bank = np.int64(job["profile"]["n_bank"])
    first = np.int64(design["first_free_knot"])
    if design["literal"] == 1:
        _to_scalars(job, first, n_bank)
    for i in range(ROWS):
        for j in range(ROWS):
            total = 0.0
            for k in range(first, n_bank):
                total += jacobian[i, k] * jacobian[j, k]
            rows[i, j] = total
        rows[i, ROWS] = -error[i]
    if not solve_symmetric(rows):
        return False
    for k in range(KNOTS_MAX):
        total = 0.0
        if first <= k < n_bank:
            for i in range(ROWS):
                total += jacobian[i, k] * rows[i, ROWS]
        job["step_rad"][k] = total
        if not math.isfinite(total):
            return False
    return True


@seldom_kernel
def _to_scalars(job: Record, first: int, n_bank: int) -> None:
    """The errors and rows of the source: e_t and e_c, each of them one number."""
    error, jacobian = job["best_error"], job["best_jacobian"]
    for k in range(first, n_bank):
        total = 0.0
        for i in range(AT_EXCESS):
            total += 2.0 * error[i] * jacobian[i, k]
        jacobian[AT_NORTH, k] = total
        jacobian[AT_EAST, k] = 2.0 * error[AT_EXCESS] * jacobian[AT_EXCESS, k]
        jacobian[AT_BANK, k] = 0.0
        jacobian[AT_EXCESS, k] = 0.0
    target, excess = target_error_of(error), error[AT_EXCESS] * error[AT_EXCESS]
    error[AT_NORTH] = target
    error[AT_EAST] = excess
    error[AT_BANK] = 0.0
    error[AT_EXCESS] = 0.0
