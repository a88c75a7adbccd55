"""Onboard planner: bank over energy from the entry to a target, as a job of bounded steps.

[JOSHI] Eqs. 12-19, 29-35. The bank's values at its knots are sought so that the flight along the
profile comes down to the end altitude at the target's latitude and longitude, with the bank that
is asked for there and no heat flux above its limit. Differences from the source:

- the rows of the error stay apart: a minimum-norm Newton step on the weighted errors and the root
  of the constraint's excess. The source takes the two scalars e_t and e_c, which are quadratic in
  the errors: their gradients vanish at the solution (`literal` flies that form);
- knots lie over the energy lost and not over the time, and the bank is rolled in, not jumped to;
- signs of Eqs. 2, 31, 43 as corrected in docs/laws/planned.md.

A call of `work_on` makes at most `steps_a_frame_count` steps of the flight ahead: the same number
whatever the pace. Each flight ahead is one trial; a trial that is better becomes what is improved
next. What was found best stays where it is until the job is done.

Limits: the air of the load, no wind. A flight ahead ends after `STEPS_MAX` steps or where it cannot
be continued: such a trial counts as no improvement.
"""

import math

import numpy as np

from flight_sw.guidance.planned.normal_equations import solve_symmetric
from flight_sw.model.motion import LAMBDA, MOTION, N_STATES, PHI, RADIUS, motion_rates, nearest_turn
from flight_sw.model.profile import (
    KNOTS_MAX,
    PROFILE,
    index_of,
    index_slopes,
    weight_of,
)
from flight_sw.model.propagation import (
    CONDITIONS,
    ENDED,
    GOING,
    PATH,
    WORK,
    advance,
    begin,
    controls_of,
)
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel, seldom_kernel

ROWS = 4  # latitude, longitude, bank at the end, root of the excess
AT_PHI, AT_LAMBDA, AT_BANK, AT_EXCESS = range(ROWS)
STEPS_MAX = 1500  # of one flight ahead: fewer than a plan has rows
ITERATIONS_MAX = 40
TRIALS_MAX = 6  # of step lengths in an iteration
FULL_STEP_RATIO = 0.5  # of the squared error: a full step that leaves less is not searched further

IDLE, WORKING, DONE = 0, 1, 2
NOT_ENDED, CONVERGED, SMALL_STEP, OUT_OF_ITERATIONS, STUCK = 0, 1, 2, 3, 4
ENDINGS = ("none", "converged", "small step", "out of iterations", "stuck")

PLANNER = RecordSpec(
    "planner",
    Field("target_lat_rad", -math.pi / 2, math.pi / 2, "where the flight is to end"),
    Field("target_lon_rad", -math.pi, math.pi),
    Field("end_alt_m", -5e4, 1e7, "at which it ends"),
    Field("end_bank_rad", -math.pi, math.pi, "wanted there"),
    Field("heat_flux_limit_wpm2", 0.0, 1e12, "kept by the plan"),
    Field("heat_flux_unit_wpm2", 1e-3, 1e12, "in which the excess is squared"),
    Field("target_weight_1prad", 0.0, 1e12, "root of H of latitude and longitude"),
    Field("bank_weight_1prad", 0.0, 1e12, "root of H of the bank"),
    Field("excess_weight_ratio", 0.0, 1e12, "on the root of e_c"),
    Field("target_error_max", 0.0, 1e30, "e_t below which a plan is good"),
    Field("excess_max", 0.0, 1e30, "e_c below which it is"),
    Field("step_min_ratio", 0.0, 1.0, "shortest step length"),
    Field("step_s", 0.01, 100.0, "of the flight ahead"),
    Field("steps_a_frame_count", 1, STEPS_MAX, "in one minor frame", kind="u4"),
    Field("iterations_max", 1, ITERATIONS_MAX, "of Newton's", kind="u4"),
    Field("literal", 0, 1, "1: on e_t and e_c alone, as in the source", kind="u4"),
    Field("bank_max_rad", 0.0, math.pi, "planned, either side"),
    Field("first_free_knot", 0, KNOTS_MAX - 1, "of the bank; those before are given", kind="u4"),
)

TRACE = np.dtype(
    [
        ("target_error", "f8"),  # e_t
        ("excess", "f8"),  # e_c
        ("step_ratio", "f8"),  # length of the step that led here
        ("lat_rad", "f8"),
        ("lon_rad", "f8"),
        ("bank_rad", "f8"),
        ("heat_flux_peak_wpm2", "f8"),
        ("t_s", "f8"),
    ],
    align=True,
)
"""What an iteration ended with."""

JOB = np.dtype(
    [
        ("stage", "u4"),  # IDLE, WORKING, DONE
        ("ending", "u4"),  # ENDINGS
        ("iteration", "u4"),
        ("trials", "u4"),  # in this iteration
        ("flights", "u4"),  # ahead, altogether
        ("failed_flights", "u4"),
        ("start", "f8", (N_STATES,)),
        ("start_s", "f8"),
        ("profile", PROFILE),  # of the trial
        ("path", PATH),
        ("work", WORK),
        ("conditions", CONDITIONS),
        ("best_bank_rad", "f8", (KNOTS_MAX,)),
        ("step_rad", "f8", (KNOTS_MAX,)),  # Newton's
        ("step_ratio", "f8"),
        ("best_ratio", "f8"),  # of the trials of this iteration
        ("merit", "f8"),  # squared error of the best
        ("trial_merit", "f8"),
        ("kept_ratio", "f8"),  # where the line's best trial lay
        ("kept_merit", "f8"),
        ("error", "f8", (ROWS,)),
        ("jacobian", "f8", (ROWS, KNOTS_MAX)),
        ("rows", "f8", (ROWS, ROWS + 1)),  # normal equations
        ("slopes", "f8", (N_STATES,)),
        ("motion", MOTION),
        ("trace", TRACE, (ITERATIONS_MAX + 1,)),
    ],
    align=True,
)
"""A plan in the making: its bytes are part of a checkpoint."""


@seldom_kernel
def start(load: Record, design: Record, profile: Record, job: Record, x: F8, t_s: float) -> None:
    """Begins a plan from a state of shape (6,): the profile's bank is the first guess."""
    job["stage"] = WORKING
    job["ending"] = NOT_ENDED
    job["iteration"] = 0
    job["trials"] = 0
    job["flights"] = 0
    job["failed_flights"] = 0
    job["start_s"] = t_s
    for i in range(N_STATES):
        job["start"][i] = x[i]
    job["profile"] = profile
    for k in range(KNOTS_MAX):
        job["best_bank_rad"][k] = profile["bank_rad"][k]
        job["step_rad"][k] = 0.0
    job["merit"] = math.inf
    job["kept_merit"] = math.inf
    job["kept_ratio"] = 0.0
    job["step_ratio"] = 0.0
    conditions = job["conditions"]
    conditions["step_s"] = design["step_s"]
    conditions["end_alt_m"] = design["end_alt_m"]
    conditions["heat_flux_limit_wpm2"] = design["heat_flux_limit_wpm2"]
    conditions["heat_flux_unit_wpm2"] = design["heat_flux_unit_wpm2"]
    conditions["has_sensitivities"] = 1
    begin(job["path"], job["profile"], load["onboard"]["planet"], job["start"], t_s)


@seldom_kernel
def work_on(load: Record, design: Record, job: Record) -> None:
    """At most `steps_a_frame_count` steps of the flight ahead."""
    for _ in range(np.int64(design["steps_a_frame_count"])):
        if job["stage"] != WORKING:
            return
        code = advance(
            load["onboard"], load["atmosphere"], job["profile"], job["conditions"], job["path"],
            job["work"],
        )  # fmt: skip
        if code == GOING and job["path"]["steps"] < STEPS_MAX:
            continue
        _flown(load, design, job, code == ENDED)


@seldom_kernel
def _flown(load: Record, design: Record, job: Record, ended: bool) -> None:
    """A flight ahead is over: judge it, and begin the next or end the job."""
    job["flights"] += 1
    merit = math.inf
    if ended:
        merit = _judge(load, design, job)
    if not math.isfinite(merit):
        job["failed_flights"] += 1
        merit = math.inf
    job["trial_merit"] = merit
    if job["iteration"] == 0 and job["trials"] == 0:
        if merit == math.inf:
            _end(job, STUCK)
            return
        _accept(load, design, job, 0.0)
    else:
        _search(load, design, job)
    if job["stage"] == WORKING:
        _try_ratio(load, design, job)


@kernel
def _try_ratio(load: Record, design: Record, job: Record) -> None:
    """The flight ahead with the bank a step length from the best, within its bound."""
    profile = job["profile"]
    most = design["bank_max_rad"]
    for k in range(KNOTS_MAX):
        bank = job["best_bank_rad"][k] + job["step_ratio"] * job["step_rad"][k]
        profile["bank_rad"][k] = min(max(bank, -most), most)
    begin(job["path"], profile, load["onboard"]["planet"], job["start"], job["start_s"])


@kernel
def _end(job: Record, ending: int) -> None:
    job["ending"] = ending
    job["stage"] = DONE


@seldom_kernel
def _search(load: Record, design: Record, job: Record) -> None:
    """Step length by a parabola through what is known of the squared error on the line.

    A full step that halves it is taken. Otherwise the parabola's lowest point is flown too, and
    the better of all is taken; a trial that failed halves the length.
    """
    ratio, merit = job["step_ratio"], job["trial_merit"]
    job["trials"] += 1
    improves = merit < job["merit"]
    if improves and (merit <= FULL_STEP_RATIO * job["merit"] or job["trials"] > 1):
        _accept(load, design, job, ratio)
        return
    if merit < job["kept_merit"]:
        job["kept_merit"] = merit
        job["kept_ratio"] = ratio
    if job["trials"] >= TRIALS_MAX:
        _end(job, STUCK)
        return
    shorter = 0.5 * ratio
    if merit < math.inf and job["merit"] > 0.0:
        bend = merit - job["merit"] + 2.0 * job["merit"] * ratio  # the slope is -2 merit
        if bend > 0.0:
            shorter = job["merit"] * ratio * ratio / bend
    shorter = min(max(shorter, 0.1 * ratio), 0.9 * ratio)
    if shorter < design["step_min_ratio"]:
        _end(job, SMALL_STEP)
        return
    job["step_ratio"] = shorter


@seldom_kernel
def _accept(load: Record, design: Record, job: Record, ratio: float) -> None:
    """The trial becomes the best; ends the job if it is good, or takes Newton's next step."""
    profile, path = job["profile"], job["path"]
    for k in range(KNOTS_MAX):
        job["best_bank_rad"][k] = profile["bank_rad"][k]
    job["merit"] = job["trial_merit"]
    job["kept_merit"] = math.inf
    i = np.int64(job["iteration"])
    told = job["trace"][i]
    told["target_error"] = _target_error(job)
    told["excess"] = path["excess"]
    told["step_ratio"] = ratio
    told["lat_rad"] = path["x"][PHI]
    told["lon_rad"] = path["x"][LAMBDA]
    told["bank_rad"] = design["end_bank_rad"] + job["error"][AT_BANK] / design["bank_weight_1prad"]
    told["heat_flux_peak_wpm2"] = path["heat_flux_peak_wpm2"]
    told["t_s"] = path["t_s"] - job["start_s"]
    if _target_error(job) < design["target_error_max"] and path["excess"] <= design["excess_max"]:
        _end(job, CONVERGED)
    elif i >= np.int64(design["iterations_max"]):
        _end(job, OUT_OF_ITERATIONS)
    elif not _newton(design, job):
        _end(job, STUCK)
    else:
        job["iteration"] += 1
        job["trials"] = 0
        job["step_ratio"] = 1.0


@kernel
def _target_error(job: Record) -> float:
    """e_t, [JOSHI] Eq. 13: the weighted squares of all but the excess."""
    e = job["error"]
    return e[AT_PHI] * e[AT_PHI] + e[AT_LAMBDA] * e[AT_LAMBDA] + e[AT_BANK] * e[AT_BANK]


@seldom_kernel
def _judge(load: Record, design: Record, job: Record) -> float:
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
    error[AT_PHI] = design["target_weight_1prad"] * (x[PHI] - design["target_lat_rad"])
    error[AT_LAMBDA] = design["target_weight_1prad"] * nearest_turn(
        x[LAMBDA] - design["target_lon_rad"]
    )
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
        row[AT_PHI, k] = design["target_weight_1prad"] * (
            path["by_knot"][PHI, k] + rate[PHI] * later_s
        )
        row[AT_LAMBDA, k] = design["target_weight_1prad"] * (
            path["by_knot"][LAMBDA, k] + rate[LAMBDA] * later_s
        )
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
def _newton(design: Record, job: Record) -> bool:
    """Minimum-norm step of the free knots that removes the errors in first order.

    step = -J^T (J J^T)^-1 error, [JOSHI] Eq. 19 with its rows kept apart. Rows that say nothing
    new, as that of an excess of zero, are left out. False if none is left.
    """
    error, jacobian, rows = job["error"], job["jacobian"], job["rows"]
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
    error, jacobian = job["error"], job["jacobian"]
    for k in range(first, n_bank):
        total = 0.0
        for i in range(AT_EXCESS):
            total += 2.0 * error[i] * jacobian[i, k]
        jacobian[AT_PHI, k] = total
        jacobian[AT_LAMBDA, k] = 2.0 * error[AT_EXCESS] * jacobian[AT_EXCESS, k]
        jacobian[AT_BANK, k] = 0.0
        jacobian[AT_EXCESS, k] = 0.0
    target, excess = _target_error(job), error[AT_EXCESS] * error[AT_EXCESS]
    error[AT_PHI] = target
    error[AT_LAMBDA] = excess
    error[AT_BANK] = 0.0
    error[AT_EXCESS] = 0.0
