"""The laws that track drag or predict the range: against their twin, and at their edges."""

import math

import numpy as np
import pytest

from flight_sw.guidance.drag import range_predictor
from flight_sw.guidance.drag import tracking as drag_tracking
from flight_sw.records import status
from tests.flight_sw.guidance.drag.drag_twin import DragTwin, ErrorTwin, ratio
from tests.flight_sw.mars_cases import LAWS, Case, fix_near, model_drag

SPLINE = 2e-3  # of a cosine: the twin's spline through drag alone differs so much in its bend


def limited(u: float) -> float:
    return min(max(u, -1.0), 1.0)


@pytest.mark.parametrize("seed", range(12))
def test_the_state_law_commands_what_its_twin_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    case = Case("drag-state", printed=True)
    twin = DragTwin(case.law)
    for _ in range(20):
        share = 1.0 + rng.choice([0.0, 0.002, 0.3]) * rng.uniform(-1.0, 1.0)
        nav = fix_near(case, int(rng.integers(60, 400)), share,
                       flight_path_angle_rad=rng.uniform(-0.3, 0.05))  # fmt: skip
        code = case.step(**nav)
        drag = nav["drag_mps2"]
        u = twin.control(nav, drag, rate=drag * twin.log_rate(nav, drag))
        assert case.telemetry["cos_bank_wanted"] == pytest.approx(
            min(max(u, -30.0), 30.0), rel=2e-3, abs=SPLINE
        )
        assert math.cos(case.out["bank_cmd_rad"][0]) == pytest.approx(limited(u), abs=SPLINE)
        assert code == (status.OK if abs(u) <= 1.0 else status.SATURATED) or abs(abs(u) - 1) < 0.01


def test_the_observers_law_commands_what_its_twin_does() -> None:
    case = Case("drag-observer", printed=True)
    observer = case.law["watch"]["observer"]
    # The load's observer holds the measurement between steps for this comparison.
    from tests.flight_sw.mars_cases import design
    from tools.gains.observer import fill_observer

    choice = design().drag_observer
    assert choice is not None
    held = choice.model_copy(update={"hold": "zero", "eps_s": 0.45})
    fill_observer(observer, held, 0.02)
    twin = ErrorTwin(case.law, 2.0, 1.0, 0.45)
    rng = np.random.default_rng(3)
    for i in range(60):
        share = 1.0 + 0.002 * math.sin(0.2 * i) + 1e-4 * rng.normal()
        nav = fix_near(case, 300 - i // 10, share, t_s=0.02 * i)
        case.step(**nav)
        u = twin.step(nav, 0.02)
        got = case.telemetry
        assert got["cos_bank_wanted"] == pytest.approx(u, rel=1e-3, abs=2.0 * SPLINE)
        assert got["observed_value"] == pytest.approx(twin.memory["value"], abs=1e-4)
        assert got["observed_rate"] == pytest.approx(twin.memory["value_rate"], abs=1e-4)


def test_the_shipped_law_follows_the_ratio_and_bounds_its_feedback() -> None:
    case = Case("drag-observer")
    twin = DragTwin(case.law)
    for i in range(200):
        nav = fix_near(case, 30, 1.05, t_s=0.02 * i)
        case.step(**nav)
    drag = nav["drag_mps2"]
    # At rest the ratio's observer is the measurement, and the lift that of the sensors.
    assert case.telemetry["observed_value"] == pytest.approx(ratio(nav), rel=1e-6)
    u = twin.control(nav, drag, rate=drag * twin.log_rate(nav, drag), lift=nav["lift_mps2"])
    assert case.telemetry["cos_bank_wanted"] == pytest.approx(u, rel=2e-3, abs=SPLINE)
    unbounded = DragTwin(case.law)
    unbounded.floor = 0.0
    raw = unbounded.control(nav, drag, rate=drag * twin.log_rate(nav, drag), lift=nav["lift_mps2"])
    assert abs(raw - u) > 0.05


@pytest.mark.parametrize("law", LAWS)
def test_before_the_air_is_felt_the_nominal_bank_is_held(law: str) -> None:
    case = Case(law)
    profile = case.law["tracking"]["profile"]
    nav = fix_near(case, 505, 1.0, drag_mps2=0.5)
    assert case.step(**nav) == status.OK
    at = (nav["v_rel_mps"] - profile["v_slow_mps"]) / (
        profile["v_fast_mps"] - profile["v_slow_mps"]
    )
    at = min(max(float(at), 0.0), 1.0)
    bank = profile["bank_slow_rad"] + at * (profile["bank_fast_rad"] - profile["bank_slow_rad"])
    assert case.out["bank_cmd_rad"][0] == pytest.approx(float(bank))
    assert case.out["tracking"][0] == 0
    case.step(**{**nav, "drag_mps2": 2.5, "t_s": 0.02})
    assert case.out["tracking"][0] == 1
    case.step(**{**nav, "drag_mps2": 0.5, "t_s": 0.04})  # it does not fall back
    assert case.out["tracking"][0] == 1


CALM = {"flight_path_angle_rad": -0.0307}
"""With row 300 a fix at which the bank is well between its ends, some 78 deg."""

SENSED = ("drag_mps2", "lift_mps2")
SEEN_THROUGH = ("drag-observer", "drag_mps2")
FIELDS = (
    *SENSED,
    "v_rel_mps",
    "alt_m",
    "flight_path_angle_rad",
    "heading_rad",
    "lat_rad",
    "lon_rad",
)


def banks_with(law: str, field: str | None) -> tuple[int, float, float, float]:
    """A status and three banks: before a fix with a field that is no number, with it, and after.

    None: that fix is not there at all. The fixes after it want another bank.
    """
    case = Case(law)
    if law == "range-predictor":
        case.law["predictor"]["steps_count"] = 8
    nav = fix_near(case, 300, **CALM)
    code = status.OK
    for i in range(20):
        case.step(**{**nav, "t_s": 0.02 * i})
    before = held = float(case.out["bank_cmd_rad"][0])
    if field is not None:
        code = case.step(**{**nav, "t_s": 0.4, field: math.nan})
        held = float(case.out["bank_cmd_rad"][0])
    felt = {name: factor * nav[name] for name, factor in zip(SENSED, (1.002, 0.8), strict=True)}
    for i in range(21, 60):
        case.step(**{**nav, **felt, "t_s": 0.02 * i})
    return code, before, held, float(case.out["bank_cmd_rad"][0])


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("field", FIELDS)
def test_a_fix_that_is_no_number_holds_the_bank_and_leaves_nothing_behind(
    law: str, field: str
) -> None:
    code, before, held, after = banks_with(law, field)
    _, _, _, without = banks_with(law, None)
    assert 0.3 < before < math.pi - 0.3
    if law == "range-predictor" and field == "v_rel_mps":
        assert math.isnan(held)  # which the limiter holds
    elif law == "range-predictor":
        assert abs(held - before) < 0.01  # it goes on to the shift asked for
    else:
        assert held == before
        # longitude makes no control, sensed lift is an average, drag may be an estimate
        used = field not in ("lon_rad", "lift_mps2") and (law, field) != SEEN_THROUGH
        assert (code in (status.NONFINITE, status.DOMAIN)) == used
    assert after == pytest.approx(without, abs=0.003)  # of a step less
    assert abs(after - before) > 0.02


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("off_rad", [-0.1, 0.002, 0.1])
def test_the_observers_model_is_that_of_the_bank_flown_whatever_its_sign(
    sign: float, off_rad: float
) -> None:
    """The vehicle may report a bank to the left; the laws command a magnitude of it."""
    case = Case("drag-observer")
    case.law["watch"]["observes"] = 0
    case.law["tracking"]["cos_bank_high"] = 0.25  # where the command stands here: more than flown
    nav = fix_near(case, 300, **CALM)
    case.step(**nav)
    commanded = float(case.out["bank_cmd_rad"][0])
    case.step(**{**nav, "t_s": 0.02, "bank_rad": sign * (commanded + off_rad)})
    tracking = case.state[0]["tracking"]
    reach = math.radians(20.0) * 0.02  # [limits.bank] of the design, over a step
    wanted = float(case.out["bank_cmd_rad"][0])
    flown = (
        commanded
        + off_rad
        + math.copysign(min(abs(wanted - commanded - off_rad), reach), wanted - commanded - off_rad)
    )
    dynamics = tracking["dynamics"]
    expected = dynamics["free_mps4"] + dynamics["authority_mps4"] * math.cos(flown)
    assert case.state[0]["observer"]["value_accel"] == pytest.approx(
        expected - tracking["accel_ref_mps4"], rel=1e-9
    )


def test_no_air_at_all_is_no_authority() -> None:
    case = Case("drag-state", printed=True)
    case.step(**fix_near(case, 300))
    held = float(case.out["bank_cmd_rad"][0])
    nothing = fix_near(case, 300, drag_mps2=0.0, lift_mps2=0.0)
    assert case.step(**nothing) == status.DOMAIN
    assert case.out["bank_cmd_rad"][0] == held


def first_prediction(share: float) -> tuple[float, float]:
    """Predicted error and shift after the first pair of paths, at a share of the load's drag."""
    case = Case("range-predictor")
    nav = fix_near(case, 300)
    drag = share * model_drag(nav["alt_m"], nav["v_rel_mps"])
    for i in range(200):
        case.step(**{**nav, "t_s": 0.02 * i, "drag_mps2": drag, "lift_mps2": 0.18 * drag})
        if case.state[0]["updates_count"] == 1:
            break
    return float(case.state[0]["predicted_error_m"]), float(case.state[0]["cos_shift"])


def test_more_drag_than_modelled_falls_shorter_and_asks_for_more_lift_up() -> None:
    errors, shifts = zip(*(first_prediction(share) for share in (0.7, 1.0, 1.4)), strict=True)
    assert errors[0] < errors[1] < errors[2]
    assert np.sign(errors).tolist() == np.sign(shifts).tolist()


def test_a_paths_steps_are_dealt_out_one_a_frame() -> None:
    case = Case("range-predictor")
    nav = fix_near(case, 300)
    counts = []
    for i in range(60):
        case.step(**{**nav, "t_s": 0.02 * i})
        counts.append(
            int(case.state[0]["here"]["steps_count"] + case.state[0]["beside"]["steps_count"])
        )
    rises = np.diff(counts)
    assert set(rises[rises > 0]) == {1}
    assert case.state[0]["updates_count"] >= 1


def test_phases_and_telemetry_have_names() -> None:
    assert drag_tracking.PHASES[drag_tracking.TRACKING] == "tracking"
    assert len(range_predictor.TELEMETRY) == len(set(range_predictor.TELEMETRY)) <= 16
