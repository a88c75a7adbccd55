"""The predictor and its Newton step: against a twin in Cartesian vectors, term by term."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from flight_sw.guidance.drag import prediction
from flight_sw.model.onboard import PLANET
from flight_sw.records import status
from flight_sw.records.dictionary import NAV
from sim_harness.world import atmosphere
from tests.flight_sw.guidance.drag.prediction_twin import Plan, Vehicle, end_of
from tests.flight_sw.mars_cases import LIFT_TO_DRAG, MU, RADIUS_M, RHO0, SCALE_M, Case, fix_near

AIR = atmosphere.exponential(RHO0, SCALE_M, 220.0)[0]
PLAN = Plan(math.radians(56.0), math.radians(47.0), 6750.0, 503.0, 503.0, 10e3)
VEHICLE = Vehicle(0.5 / 115.0, 0.5 / 115.0 * LIFT_TO_DRAG)
FIX = {"alt_m": 33e3, "v_rel_mps": 5500.0, "flight_path_angle_rad": -0.15}
SPIN = 7.0882e-5
STEP_S = 1.0
PATH_BAR_M = 5.0
"""Of 200 to 400 km, of paths extrapolated to no step; an end lies on a straight line in a step."""

EFFECT_M = 1000.0
"""What each term moves the end by, at least."""


def aim_of(plan: Plan, step_s: float) -> Any:
    aim = np.zeros(1, prediction.AIM.dtype)
    aim[0] = (
        step_s, plan.end_speed_mps, plan.end_alt_m,
        (plan.bank_fast_rad, plan.bank_slow_rad, plan.v_fast_mps, plan.v_slow_mps),
        plan.cos_low, plan.cos_high,
    )  # fmt: skip
    return aim[0]


def planet_and_plane(vehicle: Vehicle) -> tuple[Any, Any]:
    """The planet, and what the law keeps over a prediction."""
    planet, plane = np.zeros(1, PLANET.dtype), np.zeros(1, prediction.PLANE.dtype)
    planet["radius_m"], planet["mu_m3ps2"], planet["rotation_radps"] = RADIUS_M, MU, SPIN
    plane["drag_area_m2pkg"] = vehicle.drag_area_m2pkg
    plane["lift_area_m2pkg"] = vehicle.lift_area_m2pkg
    around = vehicle.spin_radps * math.cos(vehicle.lat_rad)
    plane["turn_radps"] = 2.0 * around * math.sin(vehicle.heading_rad)
    plane["centrifugal_1ps2"] = around**2
    return planet[0], plane[0]


def path_of(
    fix: dict[str, float], vehicle: Vehicle, plan: Plan, shift: float, step_s: float
) -> Any:
    """A path stepped to its end; it starts at a range of 1,000 km, in a record that was in use."""
    path, nav = np.zeros(1, prediction.PATH.dtype), np.zeros(1, NAV)
    for name, value in fix.items():
        nav[name] = value
    path["ended"], path["steps_count"], path["range_m"] = 1, 400, -7.0
    prediction.start_path(path[0], nav[0], 1e6, shift)
    planet, plane = planet_and_plane(vehicle)
    aim = aim_of(plan, step_s)
    while path["ended"][0] == 0:
        prediction.step_path(planet, AIR, aim, plane, path[0])
    return path[0]


def extrapolated(fix: dict[str, float], vehicle: Vehicle, plan: Plan, shift: float) -> np.ndarray:
    """Way, altitude and speed at the end: the bank is held over a step, an error of first order."""
    long, short = (
        np.array([path["range_m"] - 1e6, path["alt_m"], path["v_mps"]])
        for path in (path_of(fix, vehicle, plan, shift, s) for s in (STEP_S, 0.5 * STEP_S))
    )
    return np.asarray(2.0 * short - long)


CASES = {
    "as designed": (VEHICLE, PLAN, 0.0),
    "lift up": (VEHICLE, PLAN, 0.3),
    "lift down, at its limit": (VEHICLE, PLAN._replace(cos_low=0.1), -1.5),
    "lift up, at its limit": (VEHICLE, PLAN._replace(cos_high=0.8), 1.5),
    "more drag": (VEHICLE._replace(drag_area_m2pkg=1.3 * VEHICLE.drag_area_m2pkg), PLAN, 0.0),
    "more lift": (VEHICLE._replace(lift_area_m2pkg=1.5 * VEHICLE.lift_area_m2pkg), PLAN, 0.0),
    "with the turn": (VEHICLE._replace(spin_radps=SPIN), PLAN, 0.0),
    "against the turn": (VEHICLE._replace(spin_radps=SPIN, heading_rad=-1.2), PLAN, 0.0),
    "at 50 degrees": (VEHICLE._replace(spin_radps=SPIN, lat_rad=-0.9), PLAN, 0.0),
    "end by altitude": (VEHICLE, PLAN._replace(end_speed_mps=0.0, end_alt_m=20e3), 0.0),
    "end by speed": (VEHICLE, PLAN._replace(end_speed_mps=1500.0, end_alt_m=0.0), 0.0),
}


@pytest.mark.parametrize("name", CASES)
def test_a_path_ends_where_its_twins_does(name: str) -> None:
    vehicle, plan, shift = CASES[name]
    way_m, alt_m, v_mps = end_of(FIX, vehicle, plan, shift)
    got = extrapolated(FIX, vehicle, plan, shift)
    assert got[0] == pytest.approx(way_m, abs=PATH_BAR_M)
    assert got[1] == pytest.approx(alt_m, abs=PATH_BAR_M)
    assert got[2] == pytest.approx(v_mps, abs=0.2)
    if name not in ("as designed", "end by altitude", "end by speed"):
        plain, _, _ = end_of(FIX, VEHICLE, PLAN, 0.0)
        assert abs(way_m - plain) > EFFECT_M  # so that no term could be left out unseen


def test_what_a_step_leaves_goes_with_its_length() -> None:
    """A bank held over a step is that of its beginning: half a step late, whatever its length."""
    way_m, _, _ = end_of(FIX, VEHICLE, PLAN, 0.0)
    errors = [
        float(path_of(FIX, VEHICLE, PLAN, 0.0, s)["range_m"]) - 1e6 - way_m for s in (4.0, 1.0)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


def test_a_path_that_never_ends_is_ended() -> None:
    level = {"alt_m": 400e3, "v_rel_mps": 3000.0, "flight_path_angle_rad": 0.0}
    climbing = VEHICLE._replace(spin_radps=0.03)  # the planet flings it out
    path = path_of(level, climbing, PLAN, 0.0, STEP_S)
    assert path["steps_count"] == prediction.STEPS_MAX
    assert path["alt_m"] > 400e3


DRAG, LIFT, LAT, HEADING = 1.25, 0.7, 0.5, 1.1
"""Sensed over modelled, and where: nothing at its neutral value."""


def law_case(step_s: float = STEP_S) -> tuple[Case, dict[str, float], Vehicle, Plan]:
    """The law at a fix, in short steps, and what its twin is told."""
    case = Case("range-predictor")
    case.body["onboard"]["planet"]["rotation_radps"] = SPIN
    case.law["predictor"]["aim"]["step_s"] = step_s
    case.law["predictor"]["steps_count"] = 64
    nav = fix_near(case, 300)
    pressure = RHO0 * math.exp(-nav["alt_m"] / SCALE_M) * nav["v_rel_mps"] ** 2
    nav |= {
        "drag_mps2": DRAG * VEHICLE.drag_area_m2pkg * pressure,
        "lift_mps2": LIFT * VEHICLE.lift_area_m2pkg * pressure,
        "lat_rad": LAT, "heading_rad": HEADING, "lon_rad": 0.1,
    }  # fmt: skip
    vehicle = Vehicle(
        DRAG * VEHICLE.drag_area_m2pkg, LIFT * VEHICLE.lift_area_m2pkg, SPIN, LAT, HEADING
    )
    aim = case.law["predictor"]["aim"]
    ends = (float(aim[n]) for n in ("end_speed_mps", "end_alt_m", "cos_bank_low", "cos_bank_high"))
    plan = Plan(*(float(x) for x in aim["profile"]), *ends)
    return case, nav, vehicle, plan


def range_here_m(nav: dict[str, float]) -> float:
    """Way along the equator, of a place beside it."""
    return RADIUS_M * math.atan2(math.cos(nav["lat_rad"]) * math.sin(nav["lon_rad"]),
                                 math.cos(nav["lat_rad"]) * math.cos(nav["lon_rad"]))  # fmt: skip


def fly_updates(case: Case, nav: dict[str, float], updates: int) -> list[tuple[float, float]]:
    """Predicted error and shift after each pair of paths from the same fix."""
    found: list[tuple[float, float]] = []
    for i in range(1000):
        case.step(**{**nav, "t_s": 0.02 * i})
        if case.state[0]["updates_count"] > len(found):
            found.append(
                (float(case.state[0]["predicted_error_m"]), float(case.state[0]["cos_shift"]))
            )
        if len(found) == updates:
            return found
    raise AssertionError(f"{len(found)} predictions")


def test_the_first_prediction_and_its_correction_are_the_twins() -> None:
    wanted_m = 2500.0  # short of the target, by what a small shift makes good
    errors, shifts = [], []
    for step_s in (0.5 * STEP_S, STEP_S):
        case, nav, vehicle, plan = law_case(step_s)
        apart = float(case.law["predictor"]["cos_apart"])
        here, beside = (end_of(nav, vehicle, plan, shift)[0] for shift in (0.0, apart))
        case.law["tracking"]["ground_track"]["target_m"] = range_here_m(nav) + here + wanted_m
        ((error_m, shift),) = fly_updates(case, nav, 1)
        errors.append(error_m)
        shifts.append(shift)
    assert 2.0 * errors[0] - errors[1] == pytest.approx(wanted_m, abs=PATH_BAR_M)
    newton = wanted_m / ((beside - here) / apart)
    assert 0.01 < newton < 0.15
    # 0.7 of it, docs/laws/drag.md section 22; the difference of two paths is good to 1 %
    assert 2.0 * shifts[0] - shifts[1] == pytest.approx(0.7 * newton, rel=0.01)


@pytest.mark.parametrize(
    ("what", "otherwise"),
    [
        ("drag", {"drag_area_m2pkg": VEHICLE.drag_area_m2pkg}),
        ("lift", {"lift_area_m2pkg": VEHICLE.lift_area_m2pkg}),
        ("turn", {"spin_radps": 0.0}),
        ("latitude", {"lat_rad": 0.0}),
        ("heading", {"heading_rad": math.pi / 2}),
    ],
)
def test_what_is_sensed_and_the_turn_move_the_twins_end(
    what: str, otherwise: dict[str, float]
) -> None:
    """So that the prediction above, which meets the twin's, cannot have left one out."""
    _, nav, vehicle, plan = law_case()
    ends = [end_of(nav, v, plan, 0.0)[0] for v in (vehicle, vehicle._replace(**otherwise))]
    assert abs(ends[0] - ends[1]) > 4.0 * PATH_BAR_M, what


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_each_correction_leaves_three_tenths_of_the_error(sign: float) -> None:
    """A share of 0.7 of Newton's step on an end that is nearly straight in the shift."""
    case, nav, vehicle, plan = law_case()
    here, _, _ = end_of(nav, vehicle, plan, 0.0)
    case.law["tracking"]["ground_track"]["target_m"] = range_here_m(nav) + here + sign * 3000.0
    errors = [error for error, _ in fly_updates(case, nav, 5)]
    for before, after in pairwise(errors):
        assert after / before == pytest.approx(0.3, abs=0.03)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_target_out_of_reach_is_approached_by_largest_steps_to_a_limit(sign: float) -> None:
    case, nav, _, plan = law_case()
    case.law["tracking"]["ground_track"]["target_m"] = range_here_m(nav) + sign * 5e6 + 4e5
    shifts = [shift for _, shift in fly_updates(case, nav, 20)]
    assert shifts[:2] == pytest.approx([sign * 0.15, sign * 0.3], rel=1e-12)
    # no further than full lift all along: 1 - cos of the bank at the slow or fast end
    end = 1.0 - math.cos(plan.bank_fast_rad) if sign > 0 else -1.0 - math.cos(plan.bank_slow_rad)
    assert shifts[-1] == pytest.approx(end, rel=1e-12)


def test_the_shift_flown_follows_and_a_control_beyond_its_limits_says_saturated() -> None:
    case, nav, _, plan = law_case(step_s=4.0)
    case.law["tracking"]["ground_track"]["target_m"] = 1e7
    case.law["predictor"]["follow_ratio"] = share = 0.25
    codes, flown = [], 0.0
    for i in range(20):
        codes.append(case.step(**{**nav, "t_s": 0.02 * i}))
        flown += share * (float(case.state[0]["cos_shift"]) - flown)
        assert case.telemetry["cos_bank_shift"] == pytest.approx(flown, rel=1e-12)
        wanted = plan.cos_nominal(nav["v_rel_mps"]) + flown
        assert codes[-1] == (status.SATURATED if wanted > 1.0 else status.OK)
        assert math.cos(case.out["bank_cmd_rad"][0]) == pytest.approx(min(wanted, 1.0), abs=1e-12)
    assert set(codes) == {status.OK, status.SATURATED}
