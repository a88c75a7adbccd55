"""What a design and its mission put into a load, read again from the two files."""

import math
import tomllib
from typing import Any

import numpy as np
import pytest

from flight_sw.errors import DesignError
from flight_sw.limits import UNLIMITED
from flight_sw.model.atmosphere import density
from flight_sw.model.onboard import FORCES, heat_flux, modelled_forces
from sim_harness.world.missions import load_mission
from tests.flight_sw.guidance.heat_flux.guidance_twin import areas_m2
from tests.system.flights import DESIGN_PATH, LAWS, MISSION, built, design
from tools.gains.body import fill_body
from tools.gains.design import design_of, read_tree

DEG = math.pi / 180.0


@pytest.fixture(scope="module")
def chosen() -> dict[str, Any]:
    """design.toml as it is written."""
    return tomllib.loads(DESIGN_PATH.read_text())


@pytest.fixture(scope="module")
def flown() -> dict[str, Any]:
    """The mission as it is written."""
    return tomllib.loads(load_mission(MISSION).path.read_text())


@pytest.fixture(params=LAWS)
def body(request: Any) -> Any:
    """The body of one law's load."""
    return built(request.param).image.body[0]


def test_timing_follows_from_the_missions_rate(body: Any, chosen: Any, flown: Any) -> None:
    assert body["dt_s"] == 1.0 / flown["guidance"]["rate_hz"] == 0.02
    assert body["guidance_divider"] == chosen["timing"]["guidance_divider"]
    assert body["guidance_dt_s"] == 0.02 * chosen["timing"]["guidance_divider"]


def test_mode_thresholds_are_converted(body: Any, chosen: Any, flown: Any) -> None:
    modes, given = body["modes"], chosen["modes"]
    g0 = flown["planet"]["g0_mps2"]
    assert modes["entry_load_mps2"] == pytest.approx(given["entry_load_g"] * g0, rel=1e-14)
    assert modes["terminal_speed_mps"] == given["terminal_speed_mps"]
    assert modes["nav_timeout_cycles"] == round(given["nav_timeout_s"] * 50)
    assert modes["nav_return_cycles"] == round(given["nav_return_s"] * 50)
    assert modes["coast_alpha_rad"] == pytest.approx(given["coast_alpha_deg"] * DEG, rel=1e-14)
    assert modes["coast_bank_rad"] == 0.0


def test_command_limits_are_converted_and_infinity_becomes_unlimited(
    body: Any, chosen: Any
) -> None:
    for axis in ("bank", "alpha"):
        given, limits = chosen["limits"][axis], body[f"{axis}_limits"]
        assert limits["low_rad"] == pytest.approx(given["low_deg"] * DEG, rel=1e-14)
        assert limits["high_rad"] == pytest.approx(given["high_deg"] * DEG, rel=1e-14)
        assert given["rate_max_degps"] == given["accel_max_degps2"] == math.inf
        assert limits["rate_max_radps"] == limits["accel_max_radps2"] == UNLIMITED


def test_gates_are_converted(body: Any, chosen: Any) -> None:
    gates, given = body["gates"], chosen["gates"]
    for name in ("distance_margin_m", "accel_max_mps2", "sensed_ratio", "sensed_margin_mps2",
                 "heat_flux_ratio_ps"):  # fmt: skip
        assert gates[name] == given[name]
    assert gates["heat_flux_margin_wpm2"] == given["heat_flux_margin_kwpm2"] * 1e3
    assert gates["attitude_margin_rad"] == pytest.approx(given["attitude_margin_deg"] * DEG)
    assert gates["turn_rate_max_radps"] == pytest.approx(given["turn_rate_max_degps"] * DEG)


def test_planet_vehicle_and_heating_are_the_missions(body: Any, flown: Any) -> None:
    onboard = body["onboard"]
    assert onboard["planet"]["radius_m"] == flown["planet"]["radius_km"] * 1e3
    for name in ("mu_m3ps2", "rotation_radps", "g0_mps2"):
        assert onboard["planet"][name] == flown["planet"][name]
    assert onboard["vehicle"]["mass_kg"] == flown["vehicle"]["mass_kg"]
    # [MOOIJ18] Eq. 7
    rho, v = 1.0e-4, 7000.0
    given = flown["heating"]
    expected = (
        given["coefficient"] / math.sqrt(given["nose_radius_m"])
        * math.sqrt(rho / given["density_ref_kgpm3"]) * (v / given["speed_ref_mps"]) ** 3
    )  # fmt: skip
    assert heat_flux(onboard, rho, v) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("alpha_deg", [-5.0, 0.0, 20.0, 33.3, 45.0, 90.0])
def test_the_sampled_coefficients_are_the_newtonian_ones(body: Any, alpha_deg: float) -> None:
    forces = np.zeros(1, FORCES.dtype)
    alt_m, v_mps = 60e3, 6000.0
    modelled_forces(body["onboard"], body["atmosphere"], alt_m, v_mps, alpha_deg * DEG, forces[0])
    drag_m2, lift_m2 = areas_m2(alpha_deg * DEG)
    at_a_knot = alpha_deg / 1.25 == round(alpha_deg / 1.25)
    tolerance = 1e-12 if at_a_knot else 1e-3  # linear between samples 1.25 deg apart
    pressure = 0.5 * density(body["atmosphere"], alt_m) * v_mps**2 / 450.0
    assert forces["drag_area_m2"][0] == pytest.approx(drag_m2, rel=tolerance)
    assert forces["lift_mps2"][0] == pytest.approx(pressure * lift_m2, rel=tolerance, abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_the_nominal_design_is_converted(law: str, chosen: Any, flown: Any) -> None:
    record = built(law).image.body[0]["law"]
    record = record if law == "nominal" else record["nominal"]
    given = chosen["nominal"]
    assert record["heat_flux_max_wpm2"] == flown["limits"]["heat_flux_max_kwpm2"] * 1e3
    assert record["load_factor_max_g"] == flown["limits"]["load_factor_max_g"]
    assert record["alpha_before_peak_rad"] == pytest.approx(45.0 * DEG, rel=1e-14)
    assert record["alpha_after_peak_rad"] == pytest.approx(20.0 * DEG, rel=1e-14)
    assert record["bank_before_tracking_rad"] == 0.0
    plain = [n for n in given if not n.endswith("_deg")]
    assert len(plain) >= 9
    for name in plain:
        if name.startswith("k_gamma_") and law in ("sag", "integrated"):
            assert record[name] == 0.0, name  # [tracking] asks for a loop of its own
        else:
            assert record[name] == given[name], name
    assert record["heat_flux_exponent"] == pytest.approx(6.0, rel=1e-15)  # 3 over a half


def test_the_inner_loop_is_converted(chosen: Any) -> None:
    loop = built("lqy").image.body[0]["law"]["inner_loop"]
    assert loop["n_rows"] == len(chosen["lqy"]["speeds_mps"])
    for name in ("lead_s", "band_ratio", "decay_s"):
        assert loop[name] == chosen["lqy"][name]
    assert not loop["energy_jpkg"][loop["n_rows"] :].any()


def changed(**tables: Any) -> dict[str, Any]:
    """The design's tables with some replaced; None removes one."""
    tree = {**read_tree(DESIGN_PATH), **tables}
    return {k: v for k, v in tree.items() if v is not None}


@pytest.mark.parametrize(("law", "table"), [
    ("lqy", "lqy"), ("lqy", "nominal"), ("nominal", "nominal"),
])  # fmt: skip
def test_a_law_without_its_table_is_refused_by_name(law: str, table: str) -> None:
    incomplete = design_of(changed(**{table: None}), "design.toml")
    with pytest.raises(DesignError, match=rf"\[{table}\]"):
        fill_body(law, incomplete, load_mission(MISSION))


@pytest.mark.parametrize(
    ("table", "key", "value", "words"),
    [
        ("timing", "guidance_divider", 0, "guidance_divider is 0, allowed 1 to 10000 minor frames"),
        ("timing", "guidance_divider", 1.5, "guidance_divider is 1.5, allowed a whole number"),
        ("modes", "entry_load_g", -1.0, "entry_load_g is -1, allowed 0 to 10 g"),
        ("modes", "nav_timeout_s", math.nan, "nav_timeout_s is nan, allowed"),
        ("gates", "sensed_ratio", "much", 'sensed_ratio is "much", allowed 0 to 1000'),
        ("nominal", "scale_height_m", math.inf, "scale_height_m is inf, allowed 100 to 100000 m"),
        ("nominal", "k_gama_p", 1.0, "k_gama_p"),
        ("lqy", "speeds_mps", [3000, 2500], "speeds_mps"),
        ("lqy", "speeds_mps", [3000], "has 1 values, allowed a list of 2 to 32 numbers"),
        ("lqy", "decay_s", 0.0, "decay_s is 0, allowed 0.01 to 1000 s"),
    ],
)
def test_a_bad_choice_is_named_with_file_and_range(
    table: str, key: str, value: Any, words: str
) -> None:
    tree = read_tree(DESIGN_PATH)
    tree = {**tree, table: {**tree[table], key: value}}
    with pytest.raises(DesignError) as caught:
        design_of(tree, "my/design.toml")
    assert str(caught.value).startswith("my/design.toml: ")
    assert words in str(caught.value)


def test_stops_in_the_wrong_order_and_unknown_laws_are_refused() -> None:
    tree = read_tree(DESIGN_PATH)
    tree["limits"]["bank"] = {"low_deg": 10.0, "high_deg": 5.0}
    with pytest.raises(DesignError, match="low_deg is 10, allowed below high_deg 5"):
        design_of(tree, "d")
    with pytest.raises(DesignError, match=r'names "best", allowed nominal, lqy'):
        design_of(changed(laws=["best"]), "d")


def test_the_same_design_fills_the_same_body(chosen: Any) -> None:
    for law in LAWS:
        first, second = (fill_body(law, design(), load_mission(MISSION)).body for _ in range(2))
        assert first.tobytes() == second.tobytes()
