"""The inner loop: its steps against the twin, its signs, its band, its hand-over."""

import math

import numpy as np
import pytest

from flight_sw.guidance.heat_flux import lqy, nominal
from flight_sw.records import status
from tests.flight_sw.guidance.heat_flux.guidance_cases import (
    HEAT_FLUX_MAX_WPM2,
    Case,
    altitude_of_load,
    differences,
    random_memory,
    random_nav,
)
from tests.flight_sw.guidance.heat_flux.guidance_twin import LqyTwin, quintic, values_of

V_MPS = 6500.0


def test_a_step_from_any_state_is_that_of_the_twin() -> None:
    rng = np.random.default_rng(20260303)
    seen: set[str] = set()
    for _ in range(700):
        case = Case("lqy")
        nav = random_nav(rng)
        case.design["heat_flux_exponent"] = rng.choice([6.0, 6.0, 5.3, 8.0])
        random_memory(rng, case.memory, nav, float(case.design["heat_flux_exponent"]))
        rho_exponent = float(rng.choice([0.5, 0.4]))
        case.body["onboard"]["heating"]["rho_exponent"] = rho_exponent
        memory = values_of(case.state[0])
        code = case.step(**nav)
        twin = LqyTwin(values_of(case.body[0]["law"]), memory, rho_exponent)
        bank_rad, saturated = twin.step(nav, float(case.body["guidance_dt_s"][0]))
        assert differences(case.state[0], memory) == {}, nav
        assert case.out["bank_cmd_rad"][0] == pytest.approx(bank_rad, rel=1e-10, abs=1e-11)
        assert code == (status.SATURATED if saturated else status.OK)
        inner = memory["nominal"]
        if inner["phase"] >= 2:
            seen.add("at a stop" if bank_rad in (0.0, math.pi) else "between the stops")
            seen.add("in band" if memory["heat_flux_error_wpm2"] else "out of band")
            over_g = inner["load_factor_g"] > 5.0
            seen.add("over the load" if over_g else "under the load")
    assert len(seen) == 6, seen


def tracking(heat_flux_wpm2: float = HEAT_FLUX_MAX_WPM2, load_g: float = 0.7) -> Case:
    """A vehicle on its path, one step into heat-flux tracking."""
    case = Case("lqy")
    for name in ("k_gamma_p_mps2prad", "k_gamma_i_mps3prad", "k_gamma_d_mpsprad"):
        case.design[name] = 0.0
    case.nav["v_rel_mps"], case.nav["alt_m"] = V_MPS, altitude_of_load(0.7, V_MPS)
    case.nav["heading_rad"] = math.pi / 2
    case.start_tracking()
    case.step(
        heat_flux_wpm2=heat_flux_wpm2,
        alt_m=altitude_of_load(load_g, V_MPS),
        flight_path_angle_rad=gamma_of_path(),
    )
    return case


def gamma_of_path() -> float:
    """Path angle that the nominal guidance commands there, so that the lead is nothing."""
    case = Case("nominal")
    case.nav["v_rel_mps"], case.nav["alt_m"] = V_MPS, altitude_of_load(0.7, V_MPS)
    case.start_tracking()
    case.step()
    return float(case.memory["gamma_cmd_rad"])


def correction_rad(case: Case) -> float:
    """The increment that the step added."""
    return float(case.state["correction_rad"][0])


@pytest.mark.parametrize("share", [0.02, -0.02])
def test_too_hot_asks_for_less_bank_and_too_cold_for_more(share: float) -> None:
    case = tracking(HEAT_FLUX_MAX_WPM2 * (1.0 + share))
    assert correction_rad(case) * share < 0.0
    change = case.out["bank_cmd_rad"][0] - case.memory["bank_rad"]
    assert change == pytest.approx(correction_rad(case), rel=1e-12)


def test_the_gain_is_that_of_the_schedule_at_the_present_energy() -> None:
    case = tracking(HEAT_FLUX_MAX_WPM2 + 1e4)
    loop = case.body[0]["law"]["inner_loop"]
    n = int(loop["n_rows"])
    r = 6378137.0 + float(case.nav["alt_m"][0])
    energy = V_MPS**2 / 2 + 3.986004418e14 * (1 / 6378137.0 - 1 / r)
    gain = np.interp(energy, loop["energy_jpkg"][:n], loop["k_heat_flux_radm2pw"][:n])
    assert correction_rad(case) == pytest.approx(-gain * 1e4, rel=1e-9)
    assert 3e-6 < gain < 7e-6  # 0.27 deg per kW/m2, the reproduction's table


@pytest.mark.parametrize(("share", "acts"), [
    (0.0999, True), (-0.0999, True), (0.1001, False), (-0.1001, False),
])  # fmt: skip
def test_farther_from_the_set_point_than_the_band_nothing_is_fed_back(
    share: float, acts: bool
) -> None:
    case = tracking(HEAT_FLUX_MAX_WPM2 * (1.0 + share))
    assert (correction_rad(case) != 0.0) is acts


@pytest.mark.parametrize(("load_g", "acts"), [(4.99, False), (5.01, True), (5.5, True)])
def test_only_a_load_above_its_limit_is_fed_back(load_g: float, acts: bool) -> None:
    case = tracking(heat_flux_wpm2=0.0, load_g=load_g)
    assert (correction_rad(case) < 0.0) is acts
    assert correction_rad(case) <= 0.0


def test_the_larger_of_the_two_corrections_acts_alone() -> None:
    case = tracking()
    loop = case.body[0]["law"]["inner_loop"]
    loop["lead_s"] = 0.0
    loop["k_heat_flux_radm2pw"], loop["k_load_radpg"] = 5e-6, 0.8
    found = {}
    for load_g in (4.9, 5.1, 6.0):
        case.step(heat_flux_wpm2=1.65e6, alt_m=altitude_of_load(load_g, V_MPS))
        found[load_g] = correction_rad(case)
    # 50 kW/m2 too cold asks for 0.25 rad more, 0.1 g over for 0.08 rad less, 1 g over for 0.8 rad.
    assert found == pytest.approx({4.9: 0.25, 5.1: 0.25, 6.0: -0.8}, rel=1e-3)  # alpha table


def test_climbing_from_the_path_is_a_coming_lack_of_heat() -> None:
    case = tracking()
    level = correction_rad(case)
    case.step(flight_path_angle_rad=float(case.memory["gamma_cmd_rad"]) + 1e-3)
    # h* lies c_gamma V d(gamma) higher; dq/dh = -q / 2 Hs.
    loop = case.body[0]["law"]["inner_loop"]
    expected = -HEAT_FLUX_MAX_WPM2 / (2 * 7050.0) * 20.0 * V_MPS * 1e-3
    assert case.state["heat_flux_error_wpm2"][0] == pytest.approx(expected, rel=1e-9)
    assert correction_rad(case) > level
    loop["lead_s"] = 0.0
    case.step()
    assert case.state["heat_flux_error_wpm2"][0] == 0.0


@pytest.mark.parametrize("released_s", [0.0, 2.5, 5.0, 9.0, 10.0, 50.0])
def test_after_the_release_the_error_fades_in_ten_seconds(released_s: float) -> None:
    whole = tracking(HEAT_FLUX_MAX_WPM2 * 1.01)
    faded = tracking(HEAT_FLUX_MAX_WPM2 * 1.01)
    faded.memory["released"], faded.memory["released_s"] = 1, released_s
    whole.step()
    faded.step()
    share = 1.0 - quintic(released_s / 10.0)  # Eq. 31 as the text wants it: from one to zero
    assert correction_rad(faded) == pytest.approx(share * correction_rad(whole), rel=1e-9)


def test_before_tracking_the_command_is_the_nominal_one() -> None:
    case = Case("lqy")
    plain = Case("nominal")
    for q in (1.8e6, 1.81e6, 1.80e6, 1.79e6):
        for trial in (case, plain):
            trial.step(v_rel_mps=7500.0, alt_m=altitude_of_load(0.4, 7500.0), heat_flux_wpm2=q)
        assert case.out["bank_cmd_rad"] == plain.out["bank_cmd_rad"]
        assert case.out["alpha_cmd_rad"] == plain.out["alpha_cmd_rad"]
        assert case.out["phase"] == plain.out["phase"] < nominal.HEAT_FLUX
    assert correction_rad(case) == 0.0


def test_bank_stays_between_lift_up_and_lift_down() -> None:
    for share, stop in ((0.09, 0.0), (-0.09, math.pi)):
        case = tracking()
        case.body["law"]["inner_loop"]["k_heat_flux_radm2pw"] = 1e-3
        case.step(heat_flux_wpm2=HEAT_FLUX_MAX_WPM2 * (1.0 + share))
        assert case.out["bank_cmd_rad"][0] == stop


def test_telemetry_adds_the_inner_loop_to_that_of_the_nominal_law() -> None:
    case = tracking(HEAT_FLUX_MAX_WPM2 + 1e4)
    telemetry = dict(zip(lqy.TELEMETRY, case.out["telemetry"][0], strict=False))
    assert telemetry["bank_nominal_rad"] == case.memory["bank_rad"]
    assert telemetry["bank_correction_rad"] == correction_rad(case)
    assert telemetry["heat_flux_error_wpm2"] == pytest.approx(1e4, rel=1e-6)
    assert lqy.TELEMETRY[: len(nominal.TELEMETRY)] == nominal.TELEMETRY
