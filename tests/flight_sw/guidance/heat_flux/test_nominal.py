"""The nominal law: its path against calculus, its steps against the twin, its signs and phases."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flight_sw.guidance.heat_flux import nominal
from flight_sw.guidance.heat_flux.nominal import path_angle_command, smooth_step
from flight_sw.records import status
from tests.flight_sw.guidance.heat_flux.guidance_cases import (
    HEAT_FLUX_MAX_WPM2,
    Case,
    altitude_of_load,
    differences,
    random_memory,
    random_nav,
)
from tests.flight_sw.guidance.heat_flux.guidance_twin import NominalTwin, density, values_of

H_S_M, K_KGPM2, G_MPS2 = 7050.0, 1205.0, 9.5
EXPONENTS = (6.0, 5.0, 3.3, 2.0)
RHO0_KGPM3 = 1.225


def constant_of(n: float) -> float:
    """rho V^n at 6,000 m/s and 60 km."""
    return RHO0_KGPM3 * math.exp(-60e3 / H_S_M) * 6000.0**n


@pytest.mark.parametrize("n", EXPONENTS)
@pytest.mark.parametrize("v_mps", [3000.0, 5000.0, 7500.0])
def test_slope_is_the_derivative_of_the_path_angle(n: float, v_mps: float) -> None:
    def gamma(v: float) -> float:
        return path_angle_command(constant_of(n), n, v, K_KGPM2, G_MPS2, H_S_M)[0]

    _, slope = path_angle_command(constant_of(n), n, v_mps, K_KGPM2, G_MPS2, H_S_M)
    step = 0.5
    central = (gamma(v_mps + step) - gamma(v_mps - step)) / (2.0 * step)
    assert slope == pytest.approx(central, rel=1e-5)  # truncation of the difference
    assert slope > 0.0  # steeper where slower


@pytest.mark.parametrize("n", EXPONENTS)
def test_the_path_keeps_rho_v_to_the_n_in_the_equations_it_is_made_from(n: float) -> None:
    constant = constant_of(n)

    def motion(_: float, x: np.ndarray) -> list[float]:
        h, v = x
        gamma, _ = path_angle_command(constant, n, v, K_KGPM2, G_MPS2, H_S_M)
        rho = RHO0_KGPM3 * math.exp(-h / H_S_M)
        drag = rho * v * v / (2.0 * K_KGPM2)
        return [v * math.sin(gamma), -drag - G_MPS2 * math.sin(gamma)]

    flight = solve_ivp(motion, (0.0, 150.0), [60e3, 6000.0], rtol=1e-10, atol=1e-8)
    h, v = flight.y
    ratio = RHO0_KGPM3 * np.exp(-h / H_S_M) * v**n / constant
    assert v[-1] < 5700.0  # it has flown somewhere
    assert np.abs(ratio - 1.0).max() < 1e-7  # of the integrator


def test_a_path_steeper_than_possible_is_held_at_its_limit() -> None:
    gamma, slope = path_angle_command(1e4 * constant_of(2.0), 2.0, 1000.0, K_KGPM2, G_MPS2, H_S_M)
    assert math.sin(gamma) == pytest.approx(-nominal.SIN_GAMMA_MAX, rel=1e-14)
    assert math.isfinite(slope)


def test_smooth_step_is_flat_to_second_order_at_both_ends() -> None:
    quintic = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])  # [MOOIJ18] before Eq. 18
    for x in np.linspace(0.0, 1.0, 41):
        assert smooth_step(x) == pytest.approx(quintic(x), abs=1e-14)
    for end in (0.0, 1.0):
        assert quintic.deriv(1)(end) == quintic.deriv(2)(end) == 0.0
        assert smooth_step(end) == end
    assert (smooth_step(-3.0), smooth_step(7.0)) == (0.0, 1.0)
    assert smooth_step(0.5) == 0.5


def test_a_step_from_any_state_is_that_of_the_twin() -> None:
    rng = np.random.default_rng(20260301)
    seen: set[tuple[int, int, int, bool]] = set()
    for _ in range(1000):
        case = Case("nominal")
        nav = random_nav(rng)
        case.design["heat_flux_exponent"] = rng.choice([6.0, 6.0, 5.3, 8.0])
        random_memory(rng, case.memory, nav, float(case.design["heat_flux_exponent"]))
        before = int(case.memory["phase"])
        memory = values_of(case.memory)
        code = case.step(**nav)
        twin = NominalTwin(values_of(case.design), memory)
        expected = twin.step(nav, float(case.body["guidance_dt_s"][0]))
        assert differences(case.memory, memory) == {}, (nav, before)
        assert code == (status.SATURATED if expected else status.OK)
        seen.add((before, memory["phase"], expected, 0.0 < memory["bank_rad"] < math.pi))
    for phases in [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (2, 3), (3, 3)]:
        assert any(case[:2] == phases for case in seen), phases
    for saturated in (0, 1):
        assert (3, 3, saturated, True) in seen
        assert (2, 2, saturated, True) in seen


def test_a_sequence_of_steps_is_that_of_the_twin() -> None:
    case = Case("nominal")
    twin = NominalTwin(values_of(case.design), values_of(case.memory))
    rng = np.random.default_rng(20260302)
    v_mps, alt_m = 6200.0, altitude_of_load(0.9, 6200.0)
    q_wpm2 = 1.72e6
    for _ in range(400):
        v_mps -= 0.8
        alt_m -= 6.0
        q_wpm2 *= 0.9999
        nav = {
            "lat_rad": 0.3, "heading_rad": 1.2, "v_rel_mps": v_mps, "alt_m": alt_m,
            "flight_path_angle_rad": -0.012 + rng.normal(0.0, 1e-4), "heat_flux_wpm2": q_wpm2,
        }  # fmt: skip
        case.step(**nav)
        twin.step(nav, float(case.body["guidance_dt_s"][0]))
    assert differences(case.memory, twin.memory) == {}
    assert twin.memory["phase"] == nominal.TRANSITION


def steady(bank_deg: float = 60.0) -> Case:
    """A vehicle on the heat-flux limit whose commanded bank is not saturated."""
    case = Case("nominal")
    case.step(
        v_rel_mps=6500.0, alt_m=altitude_of_load(0.7, 6500.0), flight_path_angle_rad=-0.005,
        heat_flux_wpm2=HEAT_FLUX_MAX_WPM2, lat_rad=0.0, heading_rad=math.pi / 2,
    )  # fmt: skip
    case.start_tracking()
    for name in ("k_gamma_p_mps2prad", "k_gamma_i_mps3prad", "k_gamma_d_mpsprad"):
        case.design[name] = 0.0
    return case


def bank_with(case: Case, **changes: float) -> float:
    """Bank of one step from a copy of the case, design or memory or fix changed."""
    trial = Case("nominal")
    for name in ("body", "state", "nav"):
        getattr(trial, name)[:] = getattr(case, name)
    fix = {}
    for name, value in changes.items():
        if name in trial.nav.dtype.names:
            fix[name] = value
        else:
            record = trial.design if name in trial.design.dtype.names else trial.memory
            record[name] = value
    trial.step(**fix)
    return float(trial.out["bank_cmd_rad"][0])


def test_on_the_path_the_bank_is_unsaturated() -> None:
    assert 0.3 < bank_with(steady()) < math.pi - 0.3


def test_too_much_flow_asks_for_less_bank() -> None:
    case = steady()
    constant = float(case.memory["tracking_constant"])
    quiet = {"k_flow_d_heat_flux_rads": 0.0}
    hot = bank_with(case, tracking_constant=constant / 1.05, **quiet, k_flow_p_rad=0.0)
    with_p = bank_with(case, tracking_constant=constant / 1.05, **quiet)
    assert with_p - hot == pytest.approx(-0.05, rel=1e-9)  # K_np = -1 rad, 5 % too much


@pytest.mark.parametrize(("gain", "sign"), [("k_gamma_p_mps2prad", -1), ("k_gamma_i_mps3prad", -1)])
def test_a_path_below_the_commanded_one_asks_for_less_bank(gain: str, sign: int) -> None:
    case = steady()
    design = {gain: 5.0}
    low = bank_with(case, flight_path_angle_rad=-0.03, **design)
    without = bank_with(case, flight_path_angle_rad=-0.03)
    assert (low - without) * sign > 0.0


def test_a_path_angle_error_that_grows_is_damped_by_a_positive_derivative_gain() -> None:
    case = steady()
    falling = {"gamma_started": 1, "gamma_error_prev_rad": 0.0, "flight_path_angle_rad": -0.03}
    assert bank_with(case, **falling, k_gamma_d_mpsprad=1.0) < bank_with(case, **falling)
    unseen = {**falling, "gamma_started": 0}  # no rate from an error that was never seen
    assert bank_with(case, **unseen, k_gamma_d_mpsprad=1.0) == bank_with(case, **unseen)


def test_bank_stays_between_lift_up_and_lift_down() -> None:
    case = steady()
    constant = float(case.memory["tracking_constant"])
    assert bank_with(case, tracking_constant=constant / 10.0) == 0.0
    assert bank_with(case, tracking_constant=constant * 3.0, k_flow_p_rad=-5.0) == math.pi


def test_flying_east_needs_more_bank_than_flying_west() -> None:
    case = steady()  # the planet's rotation carries an eastward vehicle
    assert bank_with(case, heading_rad=math.pi / 2) > bank_with(case, heading_rad=-math.pi / 2)


def phases_of(fluxes: list[float], set_point_wpm2: float = HEAT_FLUX_MAX_WPM2) -> list[int]:
    """Phases after each of a row of heat fluxes, at low load."""
    case = Case("nominal")
    case.design["peak_by"] = 0
    case.design["heat_flux_max_wpm2"] = set_point_wpm2
    found = []
    for q in fluxes:
        case.step(v_rel_mps=7500.0, alt_m=altitude_of_load(0.4, 7500.0), heat_flux_wpm2=q)
        found.append(int(case.memory["phase"]))
    return found


def test_the_peak_needs_two_falling_samples_in_a_row() -> None:
    assert phases_of([1.0e6, 1.8e6, 1.79e6, 1.795e6, 1.79e6, 1.785e6]) == [0, 0, 0, 0, 0, 1]
    assert phases_of([1.8e6, 1.8e6, 1.8e6, 1.8e6]) == [0, 0, 0, 0]  # level is not falling


def test_tracking_begins_at_the_set_point_from_above() -> None:
    fluxes = [1.8e6, 1.79e6, 1.78e6, 1.700001e6, 1.7e6]
    assert phases_of(fluxes) == [0, 0, 1, 1, 2]


def test_a_set_point_above_the_peak_is_tracked_from_the_peak_with_a_scaled_constant() -> None:
    assert phases_of([1.6e6, 1.59e6, 1.58e6]) == [0, 0, 2]
    case = Case("nominal")
    case.design["peak_by"], case.design["heat_flux_max_wpm2"] = 0, 1.9e6
    alt_m = altitude_of_load(0.4, 7500.0)
    for q in (1.6e6, 1.59e6, 1.58e6):
        case.step(v_rel_mps=7500.0, alt_m=alt_m, heat_flux_wpm2=q)
    present = density(alt_m) * 7500.0**6
    assert case.memory["tracking_constant"] == pytest.approx(present * 1.9 / 1.6, rel=1e-12)


def test_angle_of_attack_is_lowered_at_the_peak_and_bank_held_until_tracking() -> None:
    case = Case("nominal")
    case.design["peak_by"], case.design["bank_before_tracking_rad"] = 0, 0.25
    for q, alpha_deg in ((1.8e6, 45.0), (1.79e6, 45.0), (1.78e6, 20.0), (1.77e6, 20.0)):
        case.step(v_rel_mps=7500.0, alt_m=altitude_of_load(0.4, 7500.0), heat_flux_wpm2=q)
        assert math.degrees(case.out["alpha_cmd_rad"][0]) == pytest.approx(alpha_deg, rel=1e-14)
        assert case.out["bank_cmd_rad"][0] == 0.25
        assert case.out["tracking"][0] == 0


def test_the_load_factor_at_the_peak_is_that_of_the_angle_taken_there() -> None:
    case = Case("nominal")
    case.design["peak_by"] = 0
    v_mps = 7500.0
    alt_m = altitude_of_load(0.8, v_mps)  # 0.8 g at 20 deg, 1.6 g at 45 deg: the start is at 1 g
    for q in (1.6e6, 1.59e6, 1.58e6):
        case.step(v_rel_mps=v_mps, alt_m=alt_m, heat_flux_wpm2=q)
    assert case.memory["load_factor_g"] == pytest.approx(0.8, rel=1e-4)  # alpha table
    assert case.memory["phase"] == nominal.HEAT_FLUX


@pytest.mark.parametrize(("load_g", "phase"), [(0.995, 2), (1.005, 3)])
def test_the_transition_begins_at_its_share_of_the_load_limit(load_g: float, phase: int) -> None:
    case = steady()
    case.step(alt_m=altitude_of_load(load_g, 6500.0))  # of 5 g, 20 %
    assert case.memory["phase"] == phase


def test_the_exponent_falls_from_six_to_two_over_the_load_and_comes_back() -> None:
    case = steady()
    case.memory["phase"] = nominal.TRANSITION
    exponents = []
    for load_g in (0.5, 1.0, 3.0, 5.0, 5.5, 1.0):
        case.step(alt_m=altitude_of_load(load_g, 6500.0))
        exponents.append(float(case.memory["flow_exponent"]))
    # Eq. 19 at a share of 0, 0, 1/2, 1, beyond, 0
    assert exponents == pytest.approx([6.0, 6.0, 4.0, 2.0, 2.0, 6.0], abs=1e-3)


def test_tracking_is_given_up_once_the_exponent_is_low_and_not_taken_up_again() -> None:
    case = steady()
    case.step(alt_m=altitude_of_load(0.9, 6500.0))
    assert case.out["tracking"][0] == 1
    case.step(alt_m=altitude_of_load(3.0, 6500.0))
    assert case.out["tracking"][0] == 0
    assert case.memory["released_s"] == 0.0
    for _ in range(5):
        case.step(alt_m=altitude_of_load(0.9, 6500.0))
    assert case.out["tracking"][0] == 0
    assert case.memory["released_s"] == pytest.approx(5 * 0.02, rel=1e-12)


def test_a_vehicle_at_rest_is_no_case_for_the_law() -> None:
    case = steady()
    bank_rad = case.memory["bank_rad"].copy()
    assert case.step(v_rel_mps=0.5) == status.DOMAIN
    assert case.memory["bank_rad"] == bank_rad


@pytest.mark.parametrize(
    ("gamma_rad", "bank_rad"), [(-0.05, 0.0), (0.05, math.pi)], ids=["too low", "too high"]
)
def test_without_lift_upwards_the_bank_goes_to_its_stop_and_says_so(
    gamma_rad: float, bank_rad: float
) -> None:
    """An angle of attack of -20 deg lifts downwards: a cosine formed with it would turn about."""
    case = steady()
    case.design["alpha_after_peak_rad"] = math.radians(-20.0)
    case.design["k_gamma_p_mps2prad"] = 1e4
    for gain in ("k_flow_p_rad", "k_flow_d_heat_flux_rads"):
        case.design[gain] = 0.0
    assert case.step(flight_path_angle_rad=gamma_rad) == status.SATURATED
    assert case.memory["forces"]["lift_mps2"] < -1.0
    assert case.out["bank_cmd_rad"][0] == bank_rad


@pytest.mark.parametrize("field", ["flight_path_angle_rad", "heading_rad", "lat_rad", "alt_m"])
def test_a_fix_that_is_no_number_gives_no_bank_and_no_good_status(field: str) -> None:
    case = steady()
    assert case.step() == status.OK
    assert case.step(**{field: math.nan}) != status.OK
    assert math.isnan(case.out["bank_cmd_rad"][0])  # which the limiter holds


def test_telemetry_reports_what_its_names_say() -> None:
    case = steady()
    case.step()
    telemetry = dict(zip(nominal.TELEMETRY, case.out["telemetry"][0], strict=False))
    assert case.out["phase"][0] == case.memory["phase"] == nominal.HEAT_FLUX
    assert telemetry["bank_nominal_rad"] == case.out["bank_cmd_rad"][0]
    assert telemetry["flow_exponent"] == 6.0
    assert telemetry["tracking_constant_ratio"] == pytest.approx(1.0, rel=1e-12)
    assert telemetry["flight_path_angle_cmd_rad"] == case.memory["gamma_cmd_rad"]


def peak_seen_at(drop_wpm2: float) -> float:
    """Time of the peak on a parabola of heat flux that peaks at 100 s, under 5 kW/m2 of noise."""
    case = Case("nominal")
    case.design["peak_by"], case.design["peak_drop_wpm2"] = 0, drop_wpm2
    rng = np.random.default_rng(20261125)
    for step in range(8000):
        t_s = 0.02 * step
        q_wpm2 = 1.6e6 * (1.0 - ((t_s - 100.0) / 200.0) ** 2) + rng.normal(0.0, 5e3)
        case.step(v_rel_mps=7000.0, alt_m=65e3, flight_path_angle_rad=-0.01, heat_flux_wpm2=q_wpm2)
        if case.memory["phase"] != nominal.PRE_PEAK:
            return t_s
    return math.inf


def test_noise_is_no_peak_where_the_design_asks_for_a_drop() -> None:
    """Two in a row, 40 kW/m2 under the highest sample, which is some 3 sigma over the curve: the
    curve has fallen by 15 to 40 kW/m2, which it does within 19 to 32 s."""
    assert peak_seen_at(0.0) < 1.0
    assert 119.0 < peak_seen_at(40e3) < 132.0


def stepped(case: Case, q_wpm2: float, gamma_rad: float, drag_mps2: float) -> int:
    """Phase after a step at 7,500 m/s and 70 km, where the air thins by e in 7,050 m."""
    case.step(
        v_rel_mps=7500.0, alt_m=70e3, flight_path_angle_rad=gamma_rad, drag_mps2=drag_mps2,
        heat_flux_wpm2=q_wpm2,
    )  # fmt: skip
    return int(case.memory["phase"])


RISING = {"gamma_rad": -0.02, "drag_mps2": 3.0}  # d ln q / dt = 7500 0.02 / 14100 - 3 2.8 / 7500
BEYOND = {"gamma_rad": -0.001, "drag_mps2": 10.0}  # 7500 0.001 / 14100 - 3 10 / 7500 < 0


def test_false_samples_make_no_peak_while_the_model_expects_a_rise() -> None:
    case = Case("nominal")
    for q in (1.20e6, 1.21e6, 1.22e6):
        assert stepped(case, q, **RISING) == nominal.PRE_PEAK
    for q in (1.17e6, 1.12e6, 1.08e6):  # three that fall as far as the gate lets them
        assert stepped(case, q, **RISING) == nominal.PRE_PEAK
    for q in (1.23e6, 1.24e6):
        assert stepped(case, q, **RISING) == nominal.PRE_PEAK


def test_falling_samples_are_the_peak_where_the_model_consents_in_the_same_sample() -> None:
    case = Case("nominal")
    phases = [stepped(case, q, **BEYOND) for q in (1.8e6, 1.799e6, 1.798e6)]
    assert phases == [nominal.PRE_PEAK, nominal.PRE_PEAK, nominal.POST_PEAK]


def test_a_lasting_fall_is_a_peak_whatever_the_model_expects() -> None:
    case = Case("nominal")
    phases = [stepped(case, 1.6e6 - 500.0 * i, **RISING) for i in range(300)]
    # 25 kW/m2 a second: 2 % of 1,700, 34 kW/m2, and one second's lag of the low pass
    first = next(i for i, phase in enumerate(phases) if phase != nominal.PRE_PEAK)
    assert 1.3 < 0.02 * first < 2.8


def test_a_false_spike_scales_no_constant() -> None:
    case = Case("nominal")
    case.design["heat_flux_max_wpm2"] = 1.9e6
    for i in range(200):
        stepped(case, 1.6e6 if i != 150 else 1.72e6, **BEYOND)
    for q in (1.599e6, 1.598e6):
        stepped(case, q, **BEYOND)
    present = density(70e3) * 7500.0**6
    ratio = float(case.memory["tracking_constant"]) / present
    assert ratio == pytest.approx(1.9 / 1.6, rel=0.015)  # 1.9 / 1.72 is 7 % less


def test_a_false_dip_starts_no_tracking_far_above_the_set_point() -> None:
    case = Case("nominal")
    case.design["heat_flux_max_wpm2"] = 1.5e6
    for q in (1.7e6, 1.699e6, 1.698e6):
        stepped(case, q, **BEYOND)
    assert case.memory["phase"] == nominal.POST_PEAK
    for q in (1.58e6, 1.49e6, 1.41e6, 1.69e6):
        assert stepped(case, q, **BEYOND) == nominal.POST_PEAK
