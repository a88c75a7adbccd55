"""Onboard planner: bank over energy from the entry to a target, as a job of bounded steps.

[JOSHI] Eqs. 12-19, 29-35. The bank's values at its knots are sought so that the flight along the
profile comes down to the end altitude at the target's latitude and longitude, with the bank that
is asked for there and no heat flux above its limit. Differences from the source:

- the rows of the error stay apart: a minimum-norm Newton step on the weighted errors and the root
  of the constraint's excess. The source takes the two scalars e_t and e_c, which are quadratic in
  the errors: their gradients vanish at the solution (`literal` flies that form);
- knots lie over the energy lost and not over the time, and the bank is rolled in, not jumped to;
- signs of Eqs. 2, 31, 43 as corrected in docs/laws/planned.md.

The job first flies along the plan in force, along the design's guess and its mirror image, and
improves the best of the three: what it ends with is never worse than what is flown without it, and
a target to the left of the entry needs no other design. Where none of them comes down to the end,
as where it skips out, all are banked more, up to four times.

A call of `work_on` makes at most `steps_a_frame_count` steps of the flight ahead: the same number
whatever the pace. Each flight ahead is one trial; a trial that is better becomes what is improved
next. What was found best stays where it is until the job is done.

Limits: the air of the load, no wind. A flight ahead ends after `STEPS_MAX` steps or where it cannot
be continued: such a trial counts as no improvement.
"""

import math

import numpy as np

from flight_sw.guidance.planned.newton import judge, newton_step, target_error_of
from flight_sw.guidance.planned.plan_job import (
    AT_BANK,
    CONVERGED,
    DONE,
    FULL_STEP_RATIO,
    GUESSES,
    NOT_ENDED,
    OUT_OF_ITERATIONS,
    ROWS,
    SMALL_STEP,
    STEEPER_MAX,
    STEEPER_RATIO,
    STEPS_MAX,
    STUCK,
    TRIALS_MAX,
    WORKING,
)  # fmt: skip
from flight_sw.model.motion import LAMBDA, N_STATES, PHI
from flight_sw.model.profile import KNOTS_MAX
from flight_sw.model.propagation import ENDED, GOING, advance, begin
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel, seldom_kernel


@seldom_kernel
def start(
    load: Record, design: Record, guess: Record, in_force: Record, job: Record, x: F8, t_s: float
) -> None:
    """Begins a plan from a state of shape (6,).

    `guess` and `in_force` are profiles with the same knots; the job compares the flights along
    both, and along the guess with its bank mirrored, before it improves the best.
    """
    job["stage"] = WORKING
    job["ending"] = NOT_ENDED
    job["guess"] = 0
    job["steeper"] = 0
    job["iteration"] = 0
    job["trials"] = 0
    job["best"] = 0
    job["flights"] = 0
    job["failed_flights"] = 0
    job["start_s"] = t_s
    for i in range(N_STATES):
        job["start"][i] = x[i]
    job["profile"] = guess
    for k in range(KNOTS_MAX):
        job["guess_rad"][0, k] = in_force["bank_rad"][k]
        job["guess_rad"][1, k] = guess["bank_rad"][k]
        job["guess_rad"][2, k] = -guess["bank_rad"][k]
        job["step_rad"][k] = 0.0
    job["merit"] = math.inf
    job["step_ratio"] = 0.0
    conditions = job["conditions"]
    conditions["step_s"] = design["step_s"]
    conditions["end_alt_m"] = design["end_alt_m"]
    conditions["heat_flux_limit_wpm2"] = design["heat_flux_limit_wpm2"]
    conditions["heat_flux_unit_wpm2"] = design["heat_flux_unit_wpm2"]
    conditions["has_sensitivities"] = 1
    _try_guess(load, job)


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
        merit = judge(load, design, job)
    if not math.isfinite(merit):
        job["failed_flights"] += 1
        merit = math.inf
    if job["guess"] < GUESSES:
        _compare(load, design, job, merit)
    else:
        _search(load, design, job, merit)


@seldom_kernel
def _compare(load: Record, design: Record, job: Record, merit: float) -> None:
    """Keeps a first guess that is better than those before; improves the best after the last."""
    if merit < job["merit"]:
        _keep(design, job, merit)
    job["guess"] += 1
    if job["stage"] != WORKING:
        return
    if job["guess"] < GUESSES:
        _try_guess(load, job)
    elif job["merit"] == math.inf:
        if job["steeper"] < STEEPER_MAX:
            _bank_more(load, design, job)
        else:
            _end(job, STUCK)
    else:
        _improve(load, design, job)


@seldom_kernel
def _bank_more(load: Record, design: Record, job: Record) -> None:
    """No guess could be flown down: all of them again, with less lift upwards."""
    job["steeper"] += 1
    quarter = 0.5 * math.pi
    for guess in range(GUESSES):
        for k in range(np.int64(design["first_free_knot"]), np.int64(job["profile"]["n_bank"])):
            bank = job["guess_rad"][guess, k]
            more = abs(bank) + STEEPER_RATIO * max(quarter - abs(bank), 0.0)
            job["guess_rad"][guess, k] = math.copysign(more, bank)
    job["guess"] = 0
    _try_guess(load, job)


@seldom_kernel
def _search(load: Record, design: Record, job: Record, merit: float) -> None:
    """Step length: a full step that halves the squared error, otherwise one that is shorter.

    A shorter length is where the parabola through the best, its slope and the trial is lowest, or
    the half after a trial that failed; the first of them that is any better is taken.
    """
    ratio = job["step_ratio"]
    job["trials"] += 1
    improves = merit < job["merit"]
    if improves and (merit <= FULL_STEP_RATIO * job["merit"] or job["trials"] > 1):
        _keep(design, job, merit)
        if job["stage"] == WORKING:
            _improve(load, design, job)
        return
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
    _try_ratio(load, design, job)


@seldom_kernel
def _keep(design: Record, job: Record, merit: float) -> None:
    """The flight just judged becomes the best; ends the job if it is good."""
    path = job["path"]
    job["merit"] = merit
    job["best"] = job["iteration"]
    for i in range(ROWS):
        job["best_error"][i] = job["error"][i]
        for k in range(KNOTS_MAX):
            job["best_jacobian"][i, k] = job["jacobian"][i, k]
    for k in range(KNOTS_MAX):
        job["best_bank_rad"][k] = job["profile"]["bank_rad"][k]
    told = job["trace"][job["best"]]
    told["target_error"] = target_error_of(job["error"])
    told["excess"] = path["excess"]
    told["step_ratio"] = job["step_ratio"]
    told["lat_rad"] = path["x"][PHI]
    told["lon_rad"] = path["x"][LAMBDA]
    told["bank_rad"] = design["end_bank_rad"] + job["error"][AT_BANK] / design["bank_weight_1prad"]
    told["heat_flux_peak_wpm2"] = path["heat_flux_peak_wpm2"]
    told["t_s"] = path["t_s"] - job["start_s"]
    if told["target_error"] < design["target_error_max"] and told["excess"] <= design["excess_max"]:
        _end(job, CONVERGED)


@seldom_kernel
def _improve(load: Record, design: Record, job: Record) -> None:
    """Newton's step from the best, and the flight ahead with all of it."""
    if job["iteration"] >= design["iterations_max"]:
        _end(job, OUT_OF_ITERATIONS)
    elif not newton_step(design, job):
        _end(job, STUCK)
    else:
        job["iteration"] += 1
        job["trials"] = 0
        job["step_ratio"] = 1.0
        _try_ratio(load, design, job)


@kernel
def _try_guess(load: Record, job: Record) -> None:
    """The flight ahead along the next first guess."""
    profile = job["profile"]
    for k in range(KNOTS_MAX):
        profile["bank_rad"][k] = job["guess_rad"][job["guess"], k]
    begin(job["path"], profile, load["onboard"]["planet"], job["start"], job["start_s"])


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
