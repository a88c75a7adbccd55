"""The onboard planner flown on the ground: the same kernels, to the end, iteration by iteration."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.guidance.planned import plan_job, planned_lqr
from flight_sw.guidance.planned.plan import PLAN, add_row, begin_rows
from flight_sw.model.propagation import ENDED, GOING, advance, begin
from flight_sw.records.dictionary import GUIDANCE
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel
from sim_harness.mission.mission import Mission
from sim_harness.world.assembly import truth_of
from tools.gains.fixes import fix_of

Rows = npt.NDArray[np.void]
FRAMES_MAX = 1_000_000


class Planned(NamedTuple):
    """What the planner came to."""

    plan: Rows
    """PLAN, shape (1,); without rows where nothing could be flown."""
    job: Rows
    """plan_job.JOB, shape (1,)."""
    frames: int
    """Minor frames that it took at the design's budget."""
    stage: int
    """planned_lqr.STAGES."""


@kernel
def _plan(loads: Any, states: Any, navs: Any, outs: Any) -> int:
    """Minor frames of COAST until the job is over."""
    state = states[0]
    for frame in range(FRAMES_MAX):
        planned_lqr.coast(loads[0], state, navs[0], True, outs[0])
        if state["stage"] in (planned_lqr.IN_FORCE, planned_lqr.FAILED):
            return frame + 1
    return FRAMES_MAX


@kernel
def _write_rows(loads: Any, jobs: Any, plans: Any) -> bool:
    """Flies a plan's own profile from the job's start and writes its rows anew."""
    load, job, plan = loads[0], jobs[0], plans[0]
    planet = load["onboard"]["planet"]
    job["conditions"]["has_sensitivities"] = 0
    begin_rows(plan)
    begin(job["path"], plan["profile"], planet, job["start"], job["start_s"])
    add_row(plan, planet, job["path"]["x"], job["start_s"])
    for _ in range(plan_job.STEPS_MAX):
        code = advance(
            load["onboard"], load["atmosphere"], plan["profile"], job["conditions"], job["path"],
            job["work"],
        )  # fmt: skip
        if not add_row(plan, planet, job["path"]["x"], job["path"]["t_s"]):
            return False
        if code != GOING:
            return code == ENDED
    return False


def with_banks(load: Rows, found: Planned, banks_rad: npt.NDArray[np.float64]) -> Planned:
    """A plan with other banks at its knots, its rows flown anew; all have shape (1,)."""
    plan, job = found.plan.copy(), found.job.copy()
    plan["profile"]["bank_rad"] = banks_rad
    return found._replace(plan=plan) if _write_rows(load, job, plan) else found


def fix_at_entry(mission: Mission) -> Rows:
    """The entry state as a perfect navigation fix, shape (1,)."""
    return fix_of(truth_of(mission)[0])


def plan_offline(load: Rows, nav: Rows) -> Planned:
    """The plan that a computer with this load makes from a fix; both have shape (1,)."""
    state = np.zeros(1, planned_lqr.STATE.dtype)
    frames = int(_plan(load, state, nav, np.zeros(1, GUIDANCE)))
    plan = np.zeros(1, PLAN)
    if int(state["stage"][0]) == planned_lqr.IN_FORCE:
        plan[0] = state["plans"][0, int(state["in_force"][0])]
    return Planned(plan, state["job"].copy(), frames, int(state["stage"][0]))


def iterations_of(job: Record) -> list[dict[str, float]]:
    """What each iteration ended with, the first guess as number 0."""
    told = job["trace"][: int(job["best"]) + 1]
    return [
        {
            "iteration": i,
            "target_error": float(row["target_error"]),
            "excess": float(row["excess"]),
            "step_ratio": float(row["step_ratio"]),
            "latitude_deg": float(np.degrees(row["lat_rad"])),
            "longitude_deg": float(np.degrees(row["lon_rad"])),
            "bank_final_deg": float(np.degrees(row["bank_rad"])),
            "heat_flux_max_kwpm2": float(row["heat_flux_peak_wpm2"]) / 1e3,
            "duration_s": float(row["t_s"]),
        }
        for i, row in enumerate(told)
    ]
