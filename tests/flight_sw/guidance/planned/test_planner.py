"""Plans of the shipped vehicle: [JOSHI]'s five cases, and from every latitude between."""

import functools
import math
from typing import Any

import numpy as np
import pytest

from flight_sw import icd
from flight_sw.guidance.planned import plan_job, planned_lqr
from flight_sw.load_image import activate, read_image
from flight_sw.model.motion import LAMBDA, PHI
from flight_sw.records.dictionary import GUIDANCE
from flight_sw.runtime.jit import kernel
from sim_harness.mission.mission import GAINS
from sim_harness.world.missions import load_mission
from tools.gains.planned.offline import Planned, fix_at_entry, iterations_of, plan_offline

pytestmark = pytest.mark.jit_only

CASES_DEG = (20.0, 15.0, 0.0, -10.0, -15.0)  # [JOSHI] Table 1
LATITUDES_DEG = np.arange(-17.5, 27.6, 2.5)
TARGET_DEG = (-16.0, 64.7)


@functools.cache
def load() -> np.ndarray:
    return activate(read_image(GAINS / "rlv" / "planned-lqr.load"))


def planned(latitude_deg: float, from_guess: bool = True, **design: float) -> Planned:
    """A plan from the design's first guess alone, or from the ground's plan beside it."""
    mission = load_mission("rlv", {"entry.latitude_deg": latitude_deg})
    changed = load().copy()
    if from_guess:
        changed["law"]["stored"]["profile"] = changed["law"]["guess"]
    for name, value in design.items():
        changed["law"]["planner"][name] = value
    return plan_offline(changed, fix_at_entry(mission))


@pytest.mark.parametrize("from_guess", [True, False], ids=["guess", "ground plan"])
@pytest.mark.parametrize("latitude_deg", LATITUDES_DEG)
def test_a_plan_ends_at_the_target_within_ten_iterations(
    latitude_deg: float, from_guess: bool
) -> None:
    found = planned(latitude_deg, from_guess)
    assert found.stage == planned_lqr.IN_FORCE
    plan = found.plan[0]
    assert plan_job.ENDINGS[plan["ending"]] == "converged"
    assert plan["iterations"] <= 10
    assert plan["target_error"] < 1.0
    assert plan["excess"] <= 100.0
    end = plan["state"][plan["n_rows"] - 1]
    assert math.degrees(end[PHI]) == pytest.approx(TARGET_DEG[0], abs=0.01)
    assert math.degrees(end[LAMBDA]) == pytest.approx(TARGET_DEG[1], abs=0.01)


def test_the_form_of_the_source_is_slower_and_never_worse_than_what_it_began_with() -> None:
    for latitude_deg in CASES_DEG:
        found = planned(latitude_deg, True, literal=1)
        assert found.job["iteration"][0] > planned(latitude_deg, True).job["iteration"][0]
        errors = [row["target_error"] for row in iterations_of(found.job[0])]
        assert errors == sorted(errors, reverse=True)  # but never worse than what it began with


def test_the_mirror_image_is_planned_from_the_same_guess_with_the_bank_mirrored() -> None:
    """Entry, heading and target mirrored north to south; the rotation is its own mirror image."""
    right, left = (load().copy() for _ in range(2))
    for changed in (right, left):
        changed["law"]["stored"]["profile"] = changed["law"]["guess"]
    mission = load_mission("rlv", {"entry.latitude_deg": 15.0})
    there, back = fix_at_entry(mission), fix_at_entry(mission)
    back["lat_rad"] = -there["lat_rad"]
    back["heading_rad"] = math.pi - there["heading_rad"]
    left["law"]["planner"]["target_lat_rad"] *= -1.0
    one, other = plan_offline(right, there), plan_offline(left, back)
    assert plan_job.ENDINGS[one.plan["ending"][0]] == "converged"
    banks = [found.plan["profile"]["bank_rad"][0] for found in (one, other)]
    assert banks[0] == pytest.approx(-banks[1], abs=1e-9)


@kernel
def fly_the_first(loads: Any, states: Any, navs: Any, outs: Any) -> float:
    """Squared error of the flight along the plan in force: what a job compares with."""
    state = states[0]
    for _ in range(10_000):
        planned_lqr.coast(loads[0], state, navs[0], True, outs[0])
        if state["job"]["guess"] > 0:
            break
    return state["job"]["merit"]


def merit_of_the_first(changed: np.ndarray, fix: np.ndarray) -> float:
    state = np.zeros(1, planned_lqr.STATE.dtype)
    return float(fly_the_first(changed, state, fix, np.zeros(1, GUIDANCE)))


def test_the_ground_s_plan_is_kept_where_it_is_good_and_never_made_worse() -> None:
    assert int(planned(0.0, from_guess=False).job["flights"][0]) == 1
    for latitude_deg in CASES_DEG:
        mission = load_mission("rlv", {"entry.latitude_deg": latitude_deg})
        changed = load().copy()
        changed["law"]["planner"]["target_lon_rad"] = math.radians(170.0)
        job = plan_offline(changed, fix_at_entry(mission)).job[0]
        assert 0.0 < job["merit"] <= merit_of_the_first(changed, fix_at_entry(mission))


def test_the_dbc_has_the_words_of_the_job() -> None:
    for signal, words in (
        ("plan_stage", planned_lqr.STAGES),
        ("plan_ending", plan_job.ENDINGS),
        ("plan_source", planned_lqr.SOURCES),
    ):
        (found,) = (s for s in icd.layout("TM_PLAN_D").signals if s.name == signal)
        named = [name for _, name in sorted(found.names)]
        assert named == [word.upper().replace(" ", "_") for word in words]


@pytest.mark.slow
@pytest.mark.parametrize("latitude_deg", CASES_DEG)
def test_from_sixty_random_guesses_fifty_five_plans_converge(latitude_deg: float) -> None:
    """[JOSHI]'s cases from banks up to 20 deg beside the design's at every knot that is sought."""
    rng = np.random.default_rng(20261201)
    fix = fix_at_entry(load_mission("rlv", {"entry.latitude_deg": latitude_deg}))
    most = math.radians(20.0)
    converged = 0
    for _ in range(60):
        changed = load().copy()
        guess = changed["law"]["guess"][0]
        n = int(guess["n_bank"])
        guess["bank_rad"][1:n] += rng.uniform(-most, most, n - 1)
        changed["law"]["stored"]["profile"] = changed["law"]["guess"]
        converged += int(plan_offline(changed, fix).job["ending"][0]) == plan_job.CONVERGED
    assert converged >= 55


def test_guesses_that_skip_out_are_banked_more_until_one_comes_down() -> None:
    changed = load().copy()
    changed["law"]["guess"]["bank_rad"][0, 1:7] = np.radians([30.0, 35.0, 40.0, 30.0, 20.0, 20.0])
    changed["law"]["stored"]["profile"] = changed["law"]["guess"]
    found = plan_offline(changed, fix_at_entry(load_mission("rlv")))
    assert found.job["steeper"][0] > 0
    assert found.job["failed_flights"][0] >= plan_job.GUESSES
    assert found.stage == planned_lqr.IN_FORCE
    assert np.isfinite(found.job["merit"][0])


@pytest.mark.parametrize("steps_a_frame_count", [1, 50])
def test_the_budget_of_a_frame_makes_no_difference_to_the_plan(steps_a_frame_count: int) -> None:
    usual, other = planned(0.0), planned(0.0, steps_a_frame_count=steps_a_frame_count)
    assert other.plan.tobytes() == usual.plan.tobytes()
    assert other.frames != usual.frames


def test_a_plan_takes_at_most_fifteen_seconds_of_coast() -> None:
    dt_s = float(load()["dt_s"][0])
    assert max(planned(latitude).frames for latitude in CASES_DEG) * dt_s <= 15.0


def test_from_a_state_that_cannot_be_flown_nothing_is_planned() -> None:
    fix = fix_at_entry(load_mission("rlv"))
    fix["v_rel_mps"] = np.nan
    found = plan_offline(load().copy(), fix)
    assert found.stage == planned_lqr.FAILED
    assert int(found.plan["n_rows"][0]) == 0


def test_a_target_out_of_reach_leaves_the_best_that_was_found() -> None:
    found = planned(0.0, target_lon_rad=math.radians(170.0))
    assert found.stage == planned_lqr.IN_FORCE
    assert plan_job.ENDINGS[found.plan["ending"][0]] != "converged"
    first, *_, last = iterations_of(found.job[0])
    assert last["target_error"] < first["target_error"]
