"""Law `planned-lqr`: plans the entry onboard while it coasts, and tracks the plan.  [JOSHI]

In COAST a job (planner.py) seeks the bank over energy from the first navigation fix on, flies the
best once more to write it down, and swaps it in whole. Until then, and if nothing sound was found,
the plan of the load is flown, which was made on the ground. In ENTRY the plan in force is flown
open loop until drag tells where on the axis of energy the vehicle is, then tracked (tracker.py).

A job makes the same number of steps in every minor frame of COAST and in every guidance step of
ENTRY. It takes its inputs once, at its start; it never stops the law.
"""

import math

import numpy as np

from flight_sw.guidance.planned import plan_job, planner, tracker
from flight_sw.guidance.planned.plan import PLAN, ROWS_MAX, add_row, begin_rows, is_sound
from flight_sw.model.motion import N_STATES, RADIUS, V
from flight_sw.model.profile import BREAKS_MAX, KNOTS_MAX, PROFILE
from flight_sw.model.propagation import ENDED, GOING, advance, begin
from flight_sw.records import status
from flight_sw.records.events import Event
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel, seldom_kernel

PLANNING, OPEN_LOOP, TRACKING = 0, 1, 2
PHASES = ("PLANNING", "OPEN_LOOP", "TRACKING")
TELEMETRY = (
    "plan_index",
    "plan_along_error_m",
    "plan_across_error_m",
    "plan_alt_error_m",
    "plan_v_error_mps",
    "plan_bank_rad",
    "plan_integral_rads",
    "plan_stage",
    "plan_ending",
    "plan_source",
    "plan_iterations",
    "plan_flights",
    "plan_target_error",
    "plan_excess",
)
(
    PLAN_INDEX, PLAN_ALONG, PLAN_ACROSS, PLAN_ALT, PLAN_V, PLAN_BANK, PLAN_INTEGRAL, PLAN_STAGE,
    PLAN_ENDING, PLAN_SOURCE, PLAN_ITERATIONS, PLAN_FLIGHTS, PLAN_TARGET_ERROR, PLAN_EXCESS,
) = range(len(TELEMETRY))  # fmt: skip
FIRST_PHASE = dict.fromkeys(
    ("plan_along_error_m", "plan_across_error_m", "plan_alt_error_m", "plan_v_error_mps"), TRACKING
)

TOLD_MAX = 6.7e6  # what the messages carry of a plan's errors

NOT_BEGUN, SEEKING, WRITING, IN_FORCE, FAILED = 0, 1, 2, 3, 4
STAGES = ("not begun", "seeking", "writing", "in force", "failed")
FROM_LOAD, FROM_JOB = 0, 1
SOURCES = ("load", "onboard")

COAST_TELEMETRY = TELEMETRY[PLAN_STAGE:]
EVENTS = {
    "plan_stage": Event(
        "plan",
        "{plan_ending} after {plan_flights} flights ahead, source {plan_source}",
        (IN_FORCE, FAILED),
        (FAILED,),
    )
}

PROFILE_SPEC = RecordSpec.of(
    "profile",
    PROFILE,
    Field("index_by", 0, 1, kind="u4"),
    Field("n_bank", 2, KNOTS_MAX, kind="u4"),
    Field("n_alpha", 1, KNOTS_MAX, kind="u4"),
    Field("n_breaks", 2, BREAKS_MAX, kind="u4"),
    Field("energy_ref_jpkg", -1e12, 1e12),
    Field("index_speed_mps", 0.0, 1e6),
    Field("index_unit_mps", 1e-3, 1e6),
    Field("time_unit_s", 1e-6, 1e6),
    Field("bank_index", -1e6, 1e6, shape=(KNOTS_MAX,), rows="n_bank"),
    Field("bank_rad", -math.pi, math.pi, shape=(KNOTS_MAX,)),
    Field("alpha_index", -1e6, 1e6, shape=(KNOTS_MAX,), rows="n_alpha"),
    Field("alpha_rad", -math.pi, math.pi, shape=(KNOTS_MAX,)),
    Field("breaks", -1e6, 1e6, shape=(BREAKS_MAX,), rows="n_breaks"),
)
PLAN_SPEC = RecordSpec.of(
    "plan",
    PLAN,
    Field("profile", record=PROFILE_SPEC),
    Field("n_rows", 2, ROWS_MAX, kind="i8"),
    Field("ending", 0, len(plan_job.ENDINGS) - 1, kind="u4"),
    Field("iterations", 0, plan_job.ITERATIONS_MAX, kind="u4"),
    Field("flights", 0, 1e6, kind="u4"),
    Field("target_error", 0.0, 1e30),
    Field("excess", 0.0, 1e30),
    Field("heat_flux_peak_wpm2", 0.0, 1e12),
    Field("duration_s", 0.0, 1e6),
    Field("index", -1e6, 1e6, shape=(ROWS_MAX,), rows="n_rows"),
    Field("state", -1e12, 1e12, shape=(ROWS_MAX, N_STATES)),
)

COVERED_RATIO = 0.75  # of the plan's index where errors are fed back: gains are held beyond


def _gains_cover_the_plan(design: Record) -> str:
    """Gains stand over most of the plan."""
    table, plan = design["tracker"], design["stored"]
    first, last = (float(table["index"][i]) for i in (0, int(table["n_rows"]) - 1))
    begins, ends = (
        float(table["feedback_from_index"]),
        float(plan["index"][int(plan["n_rows"]) - 1]),
    )
    if min(last, ends) - max(first, begins) >= COVERED_RATIO * (ends - begins):
        return ""
    return (
        f"tracker.index goes from {first:g} to {last:g}, allowed at least {COVERED_RATIO:.0%} of "
        f"where the plan is tracked, {begins:g} to {ends:.4g}"
    )


DESIGN = RecordSpec(
    "planned_lqr",
    Field("plans_onboard", 0, 1, "0: the load's plan is flown", kind="u4"),
    Field("planner", record=plan_job.PLANNER),
    Field("tracker", record=tracker.TRACKER),
    Field("guess", record=PROFILE_SPEC),
    Field("stored", record=PLAN_SPEC),
    rules=(_gains_cover_the_plan,),
)
STATE = RecordSpec(
    "planned_lqr_state",
    Field("stage", kind="u4", why="STAGES of the job"),
    Field("source", kind="u4", why="SOURCES of the plan in force"),
    Field("in_force", kind="u4", why="which of the two plans, where the job's is flown"),
    Field("failed_jobs", kind="u4"),
    Field("started_s"),
    Field("job", kind=plan_job.JOB),
    Field("plans", kind=PLAN, shape=(2,)),
    Field("tracking", kind=tracker.TRACKING),
)


@seldom_kernel
def _write_down(load: Record, design: Record, state: Record) -> None:
    """The best bank of the job, and an empty plan beside the one in force to fly it into."""
    job = state["job"]
    plan = state["plans"][1 - state["in_force"]]
    plan["profile"] = job["profile"]
    for k in range(KNOTS_MAX):
        plan["profile"]["bank_rad"][k] = job["best_bank_rad"][k]
        job["profile"]["bank_rad"][k] = job["best_bank_rad"][k]
    told = job["trace"][job["best"]]
    plan["ending"] = job["ending"]
    plan["iterations"] = job["best"]
    plan["flights"] = job["flights"]
    plan["target_error"] = told["target_error"]
    plan["excess"] = told["excess"]
    plan["heat_flux_peak_wpm2"] = told["heat_flux_peak_wpm2"]
    plan["duration_s"] = told["t_s"]
    begin_rows(plan)
    job["conditions"]["has_sensitivities"] = 0
    planet = load["onboard"]["planet"]
    begin(job["path"], job["profile"], planet, job["start"], job["start_s"])
    add_row(plan, planet, job["path"]["x"], job["start_s"])
    state["stage"] = WRITING


@seldom_kernel
def _write_on(load: Record, design: Record, state: Record) -> None:
    """Some steps of the best flight, a row each; swaps the plan in where it is sound."""
    job = state["job"]
    other = 1 - state["in_force"]
    plan = state["plans"][other]
    for _ in range(np.int64(design["planner"]["steps_a_frame_count"])):
        code = advance(
            load["onboard"], load["atmosphere"], job["profile"], job["conditions"], job["path"],
            job["work"],
        )  # fmt: skip
        has_room = False
        if code in (GOING, ENDED):
            x, t_s = job["path"]["x"], job["path"]["t_s"]
            has_room = add_row(plan, load["onboard"]["planet"], x, t_s)
        if code == GOING and has_room:
            continue
        if code == ENDED and has_room and is_sound(plan):
            state["in_force"] = other
            state["source"] = FROM_JOB
            state["stage"] = IN_FORCE
        else:
            state["stage"] = FAILED
            state["failed_jobs"] += 1
        return


@seldom_kernel
def plan_on(load: Record, state: Record) -> None:
    """The job's share of one minor frame."""
    design = load["law"]
    if state["stage"] == SEEKING:
        planner.work_on(load, design["planner"], state["job"])
        if state["job"]["stage"] == plan_job.DONE:
            if state["job"]["merit"] < math.inf:
                _write_down(load, design, state)
            else:
                state["stage"] = FAILED
                state["failed_jobs"] += 1
    elif state["stage"] == WRITING:
        _write_on(load, design, state)


@seldom_kernel
def _begin_or_go_on(load: Record, state: Record, nav: Record, has_fix: bool) -> None:
    design = load["law"]
    if state["stage"] == NOT_BEGUN and design["plans_onboard"] == 1:
        if not has_fix:
            return
        tracker.take_state(load["onboard"]["planet"], nav, state["tracking"]["x"])
        planner.start(
            load, design["planner"], design["guess"], design["stored"]["profile"], state["job"],
            state["tracking"]["x"], nav["t_s"],
        )  # fmt: skip
        state["started_s"] = nav["t_s"]
        state["stage"] = SEEKING
        return
    plan_on(load, state)


@seldom_kernel
def coast(load: Record, state: Record, nav: Record, has_fix: bool, out: Record) -> None:
    """Called in every minor frame of COAST: begins a job at the first fix, and goes on with it."""
    _begin_or_go_on(load, state, nav, has_fix)
    _report_planning(load, state, out["telemetry"])


@seldom_kernel
def _track(load: Record, plan: Record, state: Record, t_s: float) -> None:
    design, own = load["law"]["tracker"], state["tracking"]
    if tracker.compare(load["onboard"]["planet"], plan, design, own, t_s):
        tracker.correct(design, own, load["guidance_dt_s"])


@kernel
def step(load: Record, state: Record, nav: Record, out: Record) -> int:
    """One guidance step of law `planned-lqr`."""
    plan_on(load, state)
    design, own = load["law"]["tracker"], state["tracking"]
    tracker.take_state(load["onboard"]["planet"], nav, own["x"])
    if state["source"] == FROM_JOB:
        _track(load, state["plans"][state["in_force"]], state, nav["t_s"])
    else:
        _track(load, load["law"]["stored"], state, nav["t_s"])
    reference = own["reference"]
    alpha = reference["alpha_rad"] + own["alpha_shift_rad"]
    bank = reference["bank_rad"] + own["bank_shift_rad"]
    most = design["bank_max_rad"]
    out["alpha_cmd_rad"] = min(max(alpha, design["alpha_low_rad"]), design["alpha_high_rad"])
    out["bank_cmd_rad"] = min(max(bank, -most), most)
    out["tracking"] = own["feeds_back"]
    out["phase"] = TRACKING if own["feeds_back"] == 1 else OPEN_LOOP
    if state["stage"] in (SEEKING, WRITING):
        out["phase"] = PLANNING
    _report(load, state, out)
    return status.SATURATED if own["is_limited"] == 1 else status.OK


@kernel
def _report_plan(plan: Record, told: F8) -> None:
    """How the plan in force was made."""
    told[PLAN_ENDING] = plan["ending"]
    told[PLAN_ITERATIONS] = plan["iterations"]
    told[PLAN_FLIGHTS] = plan["flights"]
    told[PLAN_TARGET_ERROR] = min(plan["target_error"], TOLD_MAX)
    told[PLAN_EXCESS] = min(plan["excess"], TOLD_MAX)


@kernel
def _report_planning(load: Record, state: Record, told: F8) -> None:
    """The job's stage and the plan in force; of a job that failed how it ended, and when."""
    told[PLAN_STAGE] = state["stage"]
    told[PLAN_SOURCE] = state["source"]
    if state["source"] == FROM_JOB:
        _report_plan(state["plans"][state["in_force"]], told)
    else:
        _report_plan(load["law"]["stored"], told)
    if state["stage"] == FAILED:
        told[PLAN_ENDING] = state["job"]["ending"]
        told[PLAN_FLIGHTS] = state["job"]["flights"]


@seldom_kernel
def _report(load: Record, state: Record, out: Record) -> None:
    """Telemetry, each number in its place of TELEMETRY."""
    own, told = state["tracking"], out["telemetry"]
    x, planned = own["x"], own["reference"]["state"]
    radius_m = load["onboard"]["planet"]["radius_m"]
    told[PLAN_INDEX] = own["index"]
    told[PLAN_ALONG] = own["along_rad"] * radius_m
    told[PLAN_ACROSS] = own["across_rad"] * radius_m
    told[PLAN_ALT] = x[RADIUS] - planned[RADIUS]
    told[PLAN_V] = x[V] - planned[V]
    told[PLAN_BANK] = own["reference"]["bank_rad"]
    told[PLAN_INTEGRAL] = own["integral_rads"]
    _report_planning(load, state, told)
