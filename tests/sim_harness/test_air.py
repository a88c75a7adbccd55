"""Wind, density and force factors: closed forms, an independent twin, and their statistics."""

import functools
import math
from typing import Any

import numpy as np
import pytest

from flight_sw.errors import MissionError
from sim_harness.world import noise, profiles
from sim_harness.world.air import cell_at, cubic, true_density, wind
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.missions import load_mission
from tests.conftest import UNCOMPILED
from tests.sim_harness.cartesian_twin import Twin, planet_fixed
from tests.sim_harness.flights import EARTH_J2, EARTH_SPIN_RADPS, flown, plain_mission, run
from tests.sim_harness.test_motion import LIFTING, miss_m_mps
from tools.gains.body import fill_body
from tools.gains.design import design_of, read_tree

SEEDS = 300 if UNCOMPILED else 2000
RANDOM = {
    "atmosphere__density_sigma_ground_ratio": 0.05,
    "atmosphere__density_sigma_top_ratio": 0.2,
    "atmosphere__density_correlation_km": 8.0,
    "wind__sigma_ground_mps": 5.0,
    "wind__sigma_top_mps": 40.0,
    "wind__correlation_km": 8.0,
}


def difference(a: Any, b: Any, *names: str) -> dict[str, float]:
    """Relative differences of fields."""
    return {name: float(abs(a[name] / b[name] - 1.0)) for name in names}


MOTION = ("alt_m", "v_rel_mps", "flight_path_angle_rad", "lon_rad", "drag_mps2")


@pytest.mark.jit_only
def test_a_density_factor_is_a_lighter_vehicle() -> None:
    """The forces per mass are those of a mass divided by it; the heat flux grows by its root."""
    dense = flown(
        plain_mission(vehicle__aerodynamics=LIFTING, atmosphere__density_factor=1.25), 160
    )
    light = flown(plain_mission(vehicle__aerodynamics=LIFTING, vehicle__mass_kg=800.0), 160)
    assert max(difference(dense, light, *MOTION).values()) < 1e-10  # of round-off over 8,000 steps
    flux = dense["heat_flux_wpm2"] / light["heat_flux_wpm2"]
    assert flux == pytest.approx(math.sqrt(1.25), rel=1e-9)


@pytest.mark.jit_only
@pytest.mark.parametrize(
    "model",
    [
        LIFTING,
        {"model": "table", "angle_of_attack_deg": [0.0, 40.0], "mach": [0.0, 30.0],
         "lift_coefficient": [[2.0, 2.0]] * 2, "drag_coefficient": [[2.5, 2.5]] * 2},
    ],
)  # fmt: skip
def test_force_factors_are_factors_of_the_coefficients(model: dict[str, Any]) -> None:
    changed = {**model, "lift_factor": 1.2, "drag_factor": 0.9}
    plain = {"model": "constant", "lift_coefficient": 2.4, "drag_coefficient": 2.25}
    factored = flown(plain_mission(vehicle__aerodynamics=changed), 160, 30.0)
    direct = flown(plain_mission(vehicle__aerodynamics=plain), 160, 30.0)
    assert max(difference(factored, direct, *MOTION, "lift_mps2").values()) < 1e-10


def test_neutral_factors_leave_the_air_as_it_is() -> None:
    air = world_of(plain_mission(), 5)["air"][0]
    assert (air["is_disturbed"], air["has_wind"]) == (0, 0)
    aero = world_of(plain_mission())["aerodynamics"][0]
    assert (aero["lift_ratio"], aero["drag_ratio"]) == (1.0, 1.0)


@pytest.mark.jit_only
@pytest.mark.parametrize(
    ("name", "law"), [("hyperion-1", "nominal"), ("mars-lander", "drag-observer")]
)
def test_the_computer_is_not_told(name: str, law: str) -> None:
    """Not even by the nominal trajectory that is flown on the ground."""
    mission = load_mission(name)
    design = design_of(read_tree(mission.gains_folder / "design.toml"), "design.toml")
    deviating = load_mission(
        name,
        {"density_factor": 1.3, "density_sigma_top_ratio": 0.2, "lift_factor": 0.8,
         "drag_factor": 1.1, "wind.east_mps": 50.0},
    )  # fmt: skip
    believed, deviated = (fill_body(law, design, m).body for m in (mission, deviating))
    assert deviated.tobytes() == believed.tobytes()
    assert world_of(deviating).tobytes() != world_of(mission).tobytes()


@pytest.mark.jit_only
@pytest.mark.parametrize("heading_deg, bank_deg", [(60.0, 50.0), (-150.0, -100.0), (0.0, 180.0)])
def test_flight_in_a_sheared_wind_agrees_with_the_cartesian_twin(
    heading_deg: float, bank_deg: float
) -> None:
    mission = plain_mission(
        planet__rotation_radps=EARTH_SPIN_RADPS,
        planet__j2=EARTH_J2,
        vehicle__aerodynamics=LIFTING,
        entry__heading_deg=heading_deg,
        wind__east_mps=-30.0,
        wind__table_altitude_km=[0.0, 120.0],
        wind__east_table_mps=[0.0, 600.0],
        wind__north_table_mps=[50.0, -250.0],
    )
    twin = Twin(
        EARTH_SPIN_RADPS, EARTH_J2, lift_area_m2=2.0, drag_area_m2=2.5,
        wind=lambda alt_m: (-30.0 + alt_m / 200.0, 50.0 - alt_m / 400.0),
    )  # fmt: skip
    end = flown(mission, 160.0, bank_deg=bank_deg)
    miss = miss_m_mps(end, *twin.fly(truth_of(mission)[0], 160.0, math.radians(bank_deg)))
    calm = flown(mission.model_copy(update={"wind": plain_mission().wind}), 160.0, bank_deg)
    assert miss_m_mps(calm, *planet_fixed(end))[0] > 100.0  # the wind has its say
    assert miss[0] < 1e-3
    assert miss[1] < 1e-5


@functools.cache
def over_a_plane(east_mps: float, north_mps: float, wind_mps: tuple[float, float]) -> Any:
    """Displacement (east, north, up) and heat load in 60 s without gravity over a plane."""
    speed = math.hypot(east_mps, north_mps, 300.0)
    mission = plain_mission(
        vehicle__aerodynamics=LIFTING,
        entry__altitude_km=60.0,
        entry__latitude_deg=0.0,
        entry__longitude_deg=0.0,
        entry__speed_mps=speed,
        entry__flight_path_angle_deg=math.degrees(math.asin(-300.0 / speed)),
        entry__heading_deg=math.degrees(math.atan2(east_mps, north_mps)),
        wind__east_mps=wind_mps[0],
        wind__north_mps=wind_mps[1],
    )
    world, truth = world_of(mission).copy(), truth_of(mission)
    world["planet"]["radius_m"], world["planet"]["mu_m3ps2"] = 1e13, 0.0
    world.setflags(write=False)
    run(world, truth, math.radians(40.0), 0.0, 3000)
    end = truth[0]
    return (
        np.array([end["lon_rad"] * 1e13, end["lat_rad"] * 1e13, end["alt_m"] - 60e3]),
        float(end["heat_load_jpm2"]),
    )


@pytest.mark.jit_only
def test_over_a_plane_a_uniform_wind_is_another_observer() -> None:
    """Galilei: the flight in the wind, seen from the air, is the one of the relative velocity."""
    windy, windy_heat = over_a_plane(4000.0, 1500.0, (200.0, -300.0))
    still, still_heat = over_a_plane(3800.0, 1800.0, (0.0, 0.0))
    assert windy - still == pytest.approx(np.array([200.0, -300.0, 0.0]) * 60.0, abs=0.02)
    assert windy_heat == pytest.approx(still_heat, rel=1e-7)
    calm, _ = over_a_plane(4000.0, 1500.0, (0.0, 0.0))
    assert np.linalg.norm(windy - calm) > 1e3


def test_air_data_are_those_of_the_motion_through_the_air() -> None:
    """Flying north-east at 3,000 m/s, level: 100 m/s from ahead, 50 from the left."""
    root = math.sqrt(0.5)
    mission = plain_mission(
        vehicle__aerodynamics=LIFTING,
        entry__altitude_km=40.0,
        entry__flight_path_angle_deg=0.0,
        entry__heading_deg=45.0,
        entry__speed_mps=3000.0,
        wind__east_mps=-100.0 * root + 50.0 * root,
        wind__north_mps=-100.0 * root - 50.0 * root,
    )
    truth = truth_of(mission)[0]
    v_air = math.hypot(3100.0, 50.0)
    rho = 1.225 * math.exp(-40e3 / 7200.0)
    assert truth["v_air_mps"] == pytest.approx(v_air, rel=1e-12)
    assert truth["v_rel_mps"] == 3000.0
    assert truth["dynamic_pressure_pa"] == pytest.approx(0.5 * rho * v_air**2, rel=1e-12)
    assert truth["mach"] == pytest.approx(v_air / 300.0, rel=1e-12)
    assert truth["drag_mps2"] == pytest.approx(0.5 * rho * v_air**2 * 2.5 / 1000.0, rel=1e-12)
    assert truth["heat_flux_wpm2"] == pytest.approx(
        1.7415e-4 * math.sqrt(rho) * v_air**3, rel=1e-12
    )


@pytest.mark.jit_only
def test_wind_from_the_left_pushes_to_the_right() -> None:
    """The heading grows by the sideways drag over the speed: pressure x C_D S x cross wind."""
    model = {**LIFTING, "lift_coefficient": 0.0}
    flat = {"entry__altitude_km": 40.0, "entry__flight_path_angle_deg": 0.0,
            "entry__heading_deg": 0.0, "entry__latitude_deg": 0.0}  # fmt: skip
    before = plain_mission(vehicle__aerodynamics=model, wind__east_mps=50.0, **flat)
    turned = flown(before, 0.1)["heading_rad"]
    rho = 1.225 * math.exp(-40e3 / 7200.0)
    sideways = 0.5 * rho * math.hypot(7500.0, 50.0) * 50.0 * 2.5 / 1000.0
    assert turned == pytest.approx(sideways * 0.1 / 7500.0, rel=2e-3)  # the speed falls meanwhile


@functools.cache
def drawn() -> dict[str, np.ndarray]:
    """Random profiles of many seeds, at the edges of the cells."""
    mission = plain_mission(**RANDOM)
    edges_m = np.linspace(0.0, 120e3, profiles.AIR_CELLS + 1)
    east, north = noise.WIND_EAST, noise.WIND_NORTH
    return {
        "edges_m": edges_m,
        "density": np.array(
            [profiles.density_profile(mission, seed, edges_m) for seed in range(SEEDS)]
        ),
        "east": np.array(
            [profiles.wind_profile(mission, seed, edges_m, east) for seed in range(SEEDS)]
        ),
        "north": np.array(
            [profiles.wind_profile(mission, seed, edges_m, north) for seed in range(SEEDS)]
        ),
    }


@pytest.mark.parametrize(
    ("name", "ground", "top"), [("density", 0.05, 0.2), ("east", 5.0, 40.0), ("north", 5.0, 40.0)]
)
def test_random_profiles_have_their_size_at_every_altitude(
    name: str, ground: float, top: float
) -> None:
    sigma = np.interp(drawn()["edges_m"], [0.0, 100e3], [ground, top])
    profile = drawn()[name]
    assert np.abs(profile.mean(axis=0) / sigma).max() < 4.5 / math.sqrt(SEEDS)
    assert profile.std(axis=0) == pytest.approx(sigma, rel=4.5 / math.sqrt(2.0 * SEEDS))


@pytest.mark.parametrize("name", ["density", "east"])
@pytest.mark.parametrize("lengths", [0.25, 1.0, 3.0])
def test_random_profiles_are_correlated_over_their_length(name: str, lengths: float) -> None:
    """(1 + a x) exp(-a x), 1/e at the length; a profile is some ten independent samples long."""
    sigma = drawn()[name].std(axis=0)
    lag = round(lengths * 8e3 / drawn()["edges_m"][1])
    x = profiles.ONE_OVER_E * lag * drawn()["edges_m"][1] / 8e3
    unit = drawn()[name] / sigma
    found = float((unit[:, lag:] * unit[:, :-lag]).mean())
    assert found == pytest.approx((1.0 + x) * math.exp(-x), abs=1.0 / math.sqrt(SEEDS))
    if lengths == 1.0:
        assert found == pytest.approx(math.exp(-1.0), abs=0.03)


def test_random_profiles_of_density_and_winds_are_independent() -> None:
    columns = [drawn()[name][:, 128] for name in ("density", "east", "north")]
    assert np.abs(np.corrcoef(columns)[np.triu_indices(3, 1)]).max() < 4.0 / math.sqrt(SEEDS)


def test_a_profile_depends_on_the_seed_alone() -> None:
    mission = plain_mission(**RANDOM)
    assert world_of(mission, 4).tobytes() == world_of(mission, 4).tobytes()
    for field in ("ln_rho", "wind_east_mps", "wind_north_mps"):
        first, second = (world_of(mission, seed)["air"][field] for seed in (4, 5))
        assert not np.any(first[0, :, 0] == second[0, :, 0])


def test_cells_meet_with_slope_and_curvature() -> None:
    table = world_of(plain_mission(**RANDOM), 3)["air"]["ln_rho"][0]
    value, slope, curvature = (
        table[:-1] @ np.array(powers) for powers in ([1, 1, 1, 1], [0, 1, 2, 3], [0, 0, 2, 6])
    )
    assert value == pytest.approx(table[1:, 0], abs=1e-12)
    assert slope == pytest.approx(table[1:, 1], abs=1e-12)
    assert curvature == pytest.approx(2.0 * table[1:, 2], abs=1e-12)


def test_profiles_pass_through_what_was_drawn_and_hold_their_ends() -> None:
    mission = plain_mission(**RANDOM)
    air = world_of(mission, 3)["air"][0]
    edges_m = np.linspace(0.0, 120e3, profiles.AIR_CELLS + 1)
    values = profiles.density_profile(mission, 3, edges_m)
    for i in (0, 1, 100, 255, 256):
        cell, u = cell_at(air, float(edges_m[i]))
        assert cubic(air["ln_rho"], cell, u) == pytest.approx(values[i], abs=1e-9)
    for beyond_m, end in ((-5e3, values[0]), (150e3, values[-1])):
        assert cubic(air["ln_rho"], *cell_at(air, beyond_m)) == pytest.approx(end, abs=1e-12)
    world = world_of(mission, 3)[0]
    expected = 1.225 * math.exp(values[100] - edges_m[100] / 7200.0)
    assert true_density(world, float(edges_m[100])) == pytest.approx(expected, rel=1e-9)
    assert math.isnan(true_density(world, math.nan))


def test_a_table_of_wind_goes_through_its_rows_without_overshoot() -> None:
    air = world_of(
        plain_mission(
            wind__table_altitude_km=[15.0, 30.0, 60.0, 75.0],
            wind__east_table_mps=[10.0, 60.0, 60.0, -20.0],
            wind__north_mps=3.0,
        )
    )["air"][0]
    for alt_m, east in ((0.0, 10.0), (15e3, 10.0), (30e3, 60.0), (45e3, 60.0), (100e3, -20.0)):
        assert wind(air, alt_m) == pytest.approx((east, 3.0), abs=0.05)
    everywhere = [wind(air, float(alt_m))[0] for alt_m in np.linspace(0.0, 120e3, 1000)]
    assert -21.0 < min(everywhere)
    assert max(everywhere) < 61.0


def end_of(seed: int, rate_hz: float) -> np.ndarray:
    """Place after 160 s in random air, at an integration step."""
    mission = plain_mission(vehicle__aerodynamics=LIFTING, guidance__rate_hz=rate_hz, **RANDOM)
    world, truth = world_of(mission, seed), truth_of(mission, seed)
    run(world, truth, math.radians(50.0), 0.0, round(160.0 * rate_hz))
    return np.asarray(planet_fixed(truth[0])[0])


@pytest.mark.jit_only
def test_random_air_does_not_spoil_the_order_of_the_integration() -> None:
    """The third derivative jumps between cells: single flights scatter about the fourth order, more
    where a step spans cells. Geometric means of eight, 2 to 8 Hz; 50 Hz is at round-off."""
    errors = []
    for seed in range(8):
        exact = end_of(seed, 200.0)
        errors.append([np.linalg.norm(end_of(seed, hz) - exact) for hz in (2.0, 8.0, 50.0)])
    coarse, fine, flown_m = np.exp(np.log(errors).mean(axis=0))
    assert math.sqrt(coarse / fine) > 8.0
    assert flown_m < 1e-6


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"density_sigma_top_ratio": 0.1, "density_correlation_km": 0.5},
         r"atmosphere.density_correlation_km is 0.5, allowed from 0.936 km for an entry at 119.81"),
        ({"wind.sigma_top_mps": 10.0, "wind.correlation_km": 0.1}, r"wind.correlation_km is 0.1"),
        ({"density_factor": 0.0}, r"density_factor is 0, allowed 0.001 to 1000"),
        ({"wind.east_mps": 2000.0}, r"wind.east_mps is 2000, allowed -1000 to 1000 m/s"),
        ({"lift_factor": -1.0}, r"lift_factor is -1, allowed 0 to 100"),
    ],
)  # fmt: skip
def test_what_cannot_be_flown_is_refused(changes: dict[str, float], complaint: str) -> None:
    with pytest.raises(MissionError, match=complaint):
        load_mission("hyperion-1", changes)


@pytest.mark.parametrize(
    ("keys", "complaint"),
    [
        ({"wind__east_table_mps": [1.0, 2.0]}, "part of a table"),
        ({"wind__table_altitude_km": [0.0, 9.0]}, "part of a table"),
        (
            {"wind__table_altitude_km": [0.0, 9.0], "wind__east_table_mps": [1.0, 2.0, 3.0]},
            "one length",
        ),
    ],
)
def test_half_a_table_of_wind_is_refused(keys: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        plain_mission(**keys)


@pytest.mark.jit_only
def test_a_stuck_axis_is_a_rate_of_almost_nothing() -> None:
    mission = plain_mission(
        vehicle__aerodynamics=LIFTING, entry__bank_deg=20.0,
        actuators__bank={"rate_max_degps": 1e-3},
    )  # fmt: skip
    assert math.degrees(flown(mission, 100.0, bank_deg=90.0)["bank_rad"]) == pytest.approx(20.1)
