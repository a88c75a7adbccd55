"""The adaptive laws: their steps against the twin, their gains in closed form, their hand-over."""

import math
from typing import Any

import numpy as np
import pytest

from flight_sw.guidance.heat_flux import integrated, nominal, sag
from flight_sw.guidance.heat_flux.adaptive import (
    HUGE,
    TRACKER,
    TRACKER_STATE,
    adapted,
    rate_by_difference,
)
from flight_sw.records import status
from tests.flight_sw.guidance.heat_flux.adaptive_twin import SagTwin
from tests.flight_sw.guidance.heat_flux.guidance_cases import (
    HEAT_FLUX_MAX_WPM2,
    Case,
    altitude_of_load,
    random_beliefs,
    random_memory,
    random_nav,
)
from tests.flight_sw.guidance.heat_flux.guidance_twin import Values, values_of

DT_S = 0.02
TABLE_3 = {"t_p_1prad2": 5.0, "t_i_1prad2ps": 50.0, "k_initial_ratio": 0.2, "leak_1ps": 0.1}
OBSERVER = {"eps_s": 2.0, "l1": 2.0, "l2": 1.0}  # design.toml
LAWS = ("sag", "integrated")


def tracker(**changes: float) -> tuple[Any, Any]:
    """A tracker of Table 3 without limits, and its memory."""
    design, state = np.zeros(1, TRACKER.dtype), np.zeros(1, TRACKER_STATE.dtype)
    for name, value in {
        **TABLE_3, "rate_s": 0.0, "error_max_rad": HUGE, "gain_max_ratio": HUGE, **changes,
    }.items():  # fmt: skip
        design[name] = value
    return design[0], state[0]


def test_without_an_error_the_initial_gain_is_forgotten_exponentially() -> None:
    design, state = tracker()
    for _ in range(round(10.0 / DT_S)):
        assert adapted(design, state, 0.0, 0.0, DT_S) == 0.0
    # Eq. 41 without its first term, Euler at 50 Hz
    assert state["gain_integral_ratio"] == pytest.approx(0.2 * (1 - 0.1 * DT_S) ** 500, rel=1e-12)
    assert state["gain_integral_ratio"] == pytest.approx(0.2 * math.exp(-1.0), rel=2e-3)


def test_an_error_that_stays_grows_a_gain_of_its_square_over_the_leak() -> None:
    design, state = tracker()
    for _ in range(round(100.0 / DT_S)):
        bank_rad = adapted(design, state, -0.05, 0.0, DT_S)
    settled = 50.0 * 0.05**2 / 0.1
    assert state["gain_integral_ratio"] == pytest.approx(settled, rel=1e-3)
    assert bank_rad == pytest.approx(-0.05 * (settled + 5.0 * 0.05**2), rel=1e-3)


def test_error_and_gain_are_held_within_their_limits() -> None:
    design, state = tracker(rate_s=9.0, error_max_rad=0.2, gain_max_ratio=3.0)
    for _ in range(2000):
        bank_rad = adapted(design, state, 0.1, 1.0, DT_S)
    assert bank_rad == pytest.approx(3.0 * 0.2, rel=1e-12)
    assert state["gain_integral_ratio"] == 3.0


def test_the_first_difference_is_none_and_the_next_is_over_one_step() -> None:
    design, state = tracker()
    assert rate_by_difference(state, 0.3, DT_S) == 0.0
    adapted(design, state, 0.3, 0.0, DT_S)
    assert rate_by_difference(state, 0.31, DT_S) == pytest.approx(0.01 / DT_S, rel=1e-12)


def random_case(rng: np.random.Generator, law: str) -> tuple[Case, Values]:
    """Any design of the tracking, any memory that a fix could meet, and that fix."""
    case = Case(law)
    nav = random_nav(rng)
    nav["t_s"] = 100.0
    design = case.body[0]["law"]
    random_memory(rng, case.memory, nav, float(case.design["heat_flux_exponent"]))
    random_beliefs(rng, case.design, case.memory, nav)
    tracking = design["tracking"]
    tracking["rate_source"] = rng.integers(0, 3)
    tracking["holds_integral"], tracking["hands_over"] = rng.integers(0, 2, 2)
    design["inner_loop"]["guard_ratio"] = rng.choice([0.0, 0.02])
    for name in ("heat_flux", "load"):
        tracking[name]["error_max_rad"] = rng.choice([0.05, HUGE])
        tracking[name]["gain_max_ratio"] = rng.choice([0.5, HUGE])
        memory = case.state[0][name]
        memory["started"] = rng.integers(0, 2)
        memory["gain_integral_ratio"] = rng.uniform(0.0, 2.0) * memory["started"]
        memory["error_prev_rad"] = rng.normal(0.0, 0.05)
    observer = case.state[0]["observer"]
    observer["started"], observer["t_s"] = 1, nav["t_s"] - DT_S
    observer["value"] = nav["heat_flux_wpm2"] * rng.uniform(0.99, 1.01)
    observer["value_rate"], observer["value_accel"] = rng.normal(0.0, 1e4, 2)
    observer["measured"] = nav["heat_flux_wpm2"] * rng.uniform(0.999, 1.001)
    state = case.state[0]
    state["correction_rad"], state["adaptive_rad"] = rng.normal(0.0, 0.3, 2)
    if law == "sag":
        state["correction_rad"] = 0.0
    state["model_started"], state["model_rate_wpm2ps"] = rng.integers(0, 2), rng.normal(0.0, 1e4)
    return case, nav


def far_apart(record: Any, twin: Values, rtol: float, path: str = "") -> dict[str, Any]:
    """Numbers of a record that are not those of the twin; what follows the observer is looser."""
    found = {}
    for name, value in values_of(record).items():
        if name == "forces":
            continue
        if isinstance(value, dict):
            found.update(far_apart(record[name], twin[name], rtol, f"{path}{name}."))
        elif not np.isclose(value, twin[name], rtol=rtol, atol=1e-6 if value > 1.0 else rtol):
            found[path + name] = (value, twin[name])
    return found


@pytest.mark.parametrize("law", LAWS)
def test_a_step_from_any_state_is_that_of_the_twin(law: str) -> None:
    rng = np.random.default_rng(20260505)
    seen: set[str] = set()
    for _ in range(400):
        case, nav = random_case(rng, law)
        tracking = case.body[0]["law"]["tracking"]
        is_observed = int(tracking["rate_source"]) == 2
        memory = values_of(case.state[0])
        before = memory["nominal"]["released"]
        code = case.step(**nav)
        twin = SagTwin(
            values_of(case.body[0]["law"]), memory, OBSERVER, has_inner_loop=law == "integrated"
        )
        bank_rad, saturated = twin.step(nav, DT_S)
        rtol = 1e-7 if is_observed else 1e-9  # steps of the twin's observer
        assert far_apart(case.state[0], memory, rtol) == {}, nav
        assert case.out["bank_cmd_rad"][0] == pytest.approx(bank_rad, abs=100 * rtol)
        assert code == (status.SATURATED if saturated else status.OK)
        inner = memory["nominal"]
        if inner["phase"] >= 2:
            seen.add(f"rate {int(tracking['rate_source'])}")
            seen.add("at a stop" if bank_rad in (0.0, math.pi) else "between the stops")
            seen.add("held" if inner["gamma_held"] else "running")
            if inner["released"] > before:
                seen.add("handed over" if tracking["hands_over"] else "let go")
            if inner["released"] and case.body[0]["law"]["inner_loop"]["guard_ratio"]:
                seen.add("guarded")
            if inner["load_factor_g"] > 5.0:
                seen.add("over the load")
    assert len(seen) == 11, seen


def at_release(law: str, hands_over: int) -> Case:
    """A vehicle whose transition has come to the release, its trackers holding 30 deg less."""
    case = Case(law)
    case.nav["v_rel_mps"], case.nav["heading_rad"] = 5100.0, math.pi / 2
    case.nav["alt_m"] = altitude_of_load(2.2, 5100.0)
    case.nav["flight_path_angle_rad"] = -0.012
    case.nav["heat_flux_wpm2"] = HEAT_FLUX_MAX_WPM2
    case.body["law"]["tracking"]["hands_over"] = hands_over
    case.start_tracking(phase=3)
    case.memory["transition_time_s"] = 20.0
    case.state["adaptive_rad"] = math.radians(-30.0)
    return case


def test_a_hand_over_leaves_the_bank_where_the_trackers_had_it() -> None:
    kept = at_release("sag", 1)
    assert kept.memory["released"] == 0
    kept.step()
    assert kept.memory["released"] == 1
    let_go = at_release("sag", 0)
    let_go.body["law"]["inner_loop"]["decay_s"] = 0.01
    let_go.step()
    after = float(kept.out["bank_cmd_rad"][0])
    kept.step(t_s=0.02)
    # The trackers hold nothing any more, and the path law alone flies the same bank.
    assert kept.state["adaptive_rad"][0] == 0.0
    assert kept.out["bank_cmd_rad"][0] == pytest.approx(after, abs=math.radians(0.5))
    without = float(let_go.memory["bank_rad"])
    assert after == pytest.approx(without - math.radians(30.0), abs=math.radians(0.5))


@pytest.mark.parametrize(("error_share", "held"), [(0.02, 1), (-0.02, 1), (0.11, 0), (-0.11, 0)])
def test_the_path_integral_waits_while_a_tracker_acts_and_only_then(
    error_share: float, held: int
) -> None:
    case = Case("integrated")
    case.body["law"]["tracking"]["rate_source"] = 1
    case.nav["v_rel_mps"], case.nav["alt_m"] = 6500.0, altitude_of_load(0.7, 6500.0)
    case.start_tracking()
    case.step(heat_flux_wpm2=HEAT_FLUX_MAX_WPM2 * (1.0 + error_share))
    integral = float(case.memory["gamma_integral_rads"])
    case.step(flight_path_angle_rad=-0.01)
    assert case.memory["gamma_held"] == held
    assert bool(case.memory["gamma_integral_rads"] == integral) is bool(held)


def test_forces_sensed_are_learnt_with_the_filters_time_constant() -> None:
    case = Case("integrated")
    case.nav["v_rel_mps"], case.nav["alt_m"] = 6500.0, altitude_of_load(0.7, 6500.0)
    case.start_tracking()
    case.design["adaptation_share_ratio"] = 0.0
    case.step(alpha_rad=math.radians(20.0))
    forces = case.memory["forces"]
    case.nav["drag_mps2"] = 1.2 * float(forces["drag_mps2"])
    case.nav["lift_mps2"] = 0.8 * float(forces["lift_mps2"])
    case.design["adaptation_share_ratio"] = -math.expm1(-DT_S / 5.0)
    modelled_g = float(case.memory["load_factor_g"])
    for i in range(round(5.0 / DT_S)):
        case.step(t_s=i * DT_S)
    share = 1.0 - math.exp(-1.0)
    assert case.memory["drag_excess_ratio"] == pytest.approx(0.2 * share, rel=1e-9)
    assert case.memory["lift_excess_ratio"] == pytest.approx(-0.2 * share, rel=1e-9)
    for i in range(round(60.0 / DT_S)):
        case.step(t_s=5.0 + i * DT_S)
    sensed_g = math.hypot(case.nav["drag_mps2"][0], case.nav["lift_mps2"][0]) / 9.81
    assert case.memory["load_factor_g"] == pytest.approx(sensed_g, rel=1e-4)
    assert abs(sensed_g / modelled_g - 1.0) > 0.03


@pytest.mark.parametrize(("change", "why"), [
    ({"alpha_rad": math.radians(45.0)}, "another angle of attack is flown"),
    ({"drag_mps2": 0.1, "lift_mps2": 0.1}, "there is next to no air"),
])  # fmt: skip
def test_nothing_is_learnt_where_the_comparison_means_nothing(
    change: dict[str, float], why: str
) -> None:
    case = Case("integrated")
    case.nav["v_rel_mps"], case.nav["alt_m"] = 6500.0, altitude_of_load(0.7, 6500.0)
    case.start_tracking()
    case.step(**{"alpha_rad": math.radians(20.0), "drag_mps2": 9.0, "lift_mps2": 9.0, **change})
    assert case.memory["drag_excess_ratio"] == 0.0, why


def test_too_hot_after_the_release_is_fed_back_and_too_cold_is_not() -> None:
    found = {}
    for share in (-0.03, -0.01, 0.0, 0.02, 0.2):
        case = Case("integrated")
        case.body["law"]["tracking"]["rate_source"] = 1
        case.body["law"]["inner_loop"]["lead_s"] = 0.0
        case.nav["v_rel_mps"], case.nav["alt_m"] = 5000.0, altitude_of_load(2.0, 5000.0)
        case.start_tracking(phase=3)
        case.memory["released"] = 1
        case.step(heat_flux_wpm2=HEAT_FLUX_MAX_WPM2 * (1.0 + share))
        assert case.state["adaptive_rad"][0] == 0.0
        found[share] = float(case.state["heat_flux_error_wpm2"][0])
    expected = {s: max(s, 0.0) * HEAT_FLUX_MAX_WPM2 for s in found}
    assert found == pytest.approx(expected, abs=1e-6)


def test_a_peak_below_the_floor_is_noise() -> None:
    case = Case("sag")
    case.body["law"]["tracking"]["rate_source"] = 1
    for q in (0.6, 0.5, 0.4, 0.49, 0.48, 0.47, 0.46):
        case.step(v_rel_mps=7600.0, alt_m=80e3, heat_flux_wpm2=q * 1.0e6)
    assert case.memory["phase"] == nominal.PRE_PEAK
    case.step(heat_flux_wpm2=1.5e6)
    for q in (1.49e6, 1.48e6):
        case.step(heat_flux_wpm2=q)
    assert case.memory["phase"] > nominal.PRE_PEAK


@pytest.mark.parametrize(("law", "module"), [("sag", sag), ("integrated", integrated)])
def test_telemetry_is_what_the_state_holds(law: str, module: Any) -> None:
    rng = np.random.default_rng(20260506)
    for _ in range(30):
        case, nav = random_case(rng, law)
        case.step(**nav)
        told = dict(zip(module.TELEMETRY, case.out["telemetry"][0], strict=False))
        state = case.state[0]
        assert told["drag_excess_ratio"] == case.memory["drag_excess_ratio"]
        assert told["lift_excess_ratio"] == case.memory["lift_excess_ratio"]
        assert told["heat_flux_used_wpm2"] == state["heat_flux_wpm2"]
        assert told["heat_flux_rate_wpm2ps"] == state["heat_flux_rate_wpm2ps"]
        assert told["adaptive_gain_ratio"] == pytest.approx(
            min(float(state["heat_flux"]["gain_ratio"]), 60e3)
        )
        assert abs(told["bank_adaptive_rad"]) <= math.pi
        if law == "integrated":
            assert told["bank_correction_rad"] == state["correction_rad"]
            assert told["heat_flux_error_wpm2"] == state["heat_flux_error_wpm2"]
