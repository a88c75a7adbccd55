"""Motion against conserved quantities, closed orbits, its own finer step and a Cartesian twin."""

import math

import numpy as np
import pytest

from flight_sw.model.angles import wrapped
from sim_harness.world import motion
from sim_harness.world.assembly import truth_of, world_of
from tests.sim_harness.cartesian_twin import Twin, planet_fixed
from tests.sim_harness.flights import (
    EARTH_J2,
    EARTH_MU_M3PS2,
    EARTH_RADIUS_M,
    EARTH_SPIN_RADPS,
    flown,
    plain_mission,
)

LIFTING = {"model": "constant", "lift_coefficient": 2.0, "drag_coefficient": 2.5}


def jacobi_jpkg(truth, spin_radps: float, j2: float) -> float:
    r = EARTH_RADIUS_M + truth["alt_m"]
    s = math.sin(truth["lat_rad"])
    east_mps = spin_radps * r * math.cos(truth["lat_rad"])
    oblate = j2 * (EARTH_RADIUS_M / r) ** 2 * (1.5 * s * s - 0.5)
    return 0.5 * (truth["v_rel_mps"] ** 2 - east_mps**2) - EARTH_MU_M3PS2 / r * (1.0 - oblate)


def miss_m_mps(truth, place, velocity) -> tuple[float, float]:
    here, moving = planet_fixed(truth)
    return float(np.linalg.norm(here - place)), float(np.linalg.norm(moving - velocity))


@pytest.mark.jit_only
@pytest.mark.parametrize("j2", [0.0, EARTH_J2])
def test_jacobi_constant_stays_for_1000_s_without_air(j2):
    mission = plain_mission(
        planet__rotation_radps=EARTH_SPIN_RADPS,
        planet__j2=j2,
        entry__altitude_km=300.0,
        entry__latitude_deg=-35.0,
    )
    before = jacobi_jpkg(truth_of(mission)[0], EARTH_SPIN_RADPS, j2)
    after = flown(mission, 1000.0)
    assert jacobi_jpkg(after, EARTH_SPIN_RADPS, j2) == pytest.approx(before, rel=1e-12)
    assert after["jacobi_energy_jpkg"] == pytest.approx(before, rel=1e-12)
    assert abs(after["lat_rad"] - truth_of(mission)["lat_rad"][0]) > 0.3


@pytest.mark.jit_only
def test_orbit_closes_after_keplers_period():
    r_m = EARTH_RADIUS_M + 300e3
    v_mps = 8000.0
    axis_m = 1.0 / (2.0 / r_m - v_mps * v_mps / EARTH_MU_M3PS2)
    period_s = 2.0 * math.pi * math.sqrt(axis_m**3 / EARTH_MU_M3PS2)
    frames = 200_000
    mission = plain_mission(
        entry__altitude_km=300.0,
        entry__speed_mps=v_mps,
        entry__flight_path_angle_deg=0.0,
        guidance__rate_hz=frames / period_s,
    )
    miss = miss_m_mps(flown(mission, period_s), *planet_fixed(truth_of(mission)[0]))
    assert miss[0] < 1e-3
    assert miss[1] < 1e-6


@pytest.mark.jit_only
def test_error_falls_with_the_fourth_power_of_the_step():
    ends = []
    for rate_hz in (2.0, 4.0, 8.0):
        mission = plain_mission(
            planet__rotation_radps=EARTH_SPIN_RADPS,
            planet__j2=EARTH_J2,
            vehicle__aerodynamics=LIFTING,
            guidance__rate_hz=rate_hz,
        )
        end = flown(mission, 300.0, bank_deg=50.0)
        ends.append(np.append(np.concatenate(planet_fixed(end)), end["heat_load_jpm2"]))
    coarse, fine = ends[0] - ends[1], ends[1] - ends[2]
    assert np.linalg.norm(coarse[:3]) / np.linalg.norm(fine[:3]) == pytest.approx(16.0, rel=0.1)
    assert np.linalg.norm(coarse[3:6]) / np.linalg.norm(fine[3:6]) == pytest.approx(16.0, rel=0.1)
    assert coarse[6] / fine[6] == pytest.approx(16.0, rel=0.1)


@pytest.mark.jit_only
@pytest.mark.parametrize("latitude_deg", [40.0, -40.0])
@pytest.mark.parametrize("heading_deg, bank_deg", [(60.0, 50.0), (-150.0, -100.0)])
@pytest.mark.parametrize("spin_radps, j2", [(EARTH_SPIN_RADPS, EARTH_J2), (-3e-4, 0.05)])
def test_flight_agrees_with_the_cartesian_twin(latitude_deg, heading_deg, bank_deg, spin_radps, j2):
    mission = plain_mission(
        planet__rotation_radps=spin_radps,
        planet__j2=j2,
        vehicle__aerodynamics=LIFTING,
        entry__latitude_deg=latitude_deg,
        entry__heading_deg=heading_deg,
    )
    twin = Twin(spin_radps, j2, lift_area_m2=2.0, drag_area_m2=2.5)
    end = flown(mission, 160.0, bank_deg=bank_deg)
    miss = miss_m_mps(end, *twin.fly(truth_of(mission)[0], 160.0, math.radians(bank_deg)))
    assert end["drag_mps2"] > 2.0  # the air has its say
    assert miss[0] < 1e-3
    assert miss[1] < 1e-5


@pytest.mark.jit_only
@pytest.mark.parametrize("latitude_deg", [60.0, -60.0])
def test_flight_over_a_pole_comes_down_the_other_side(latitude_deg):
    mission = plain_mission(
        entry__altitude_km=300.0,
        entry__latitude_deg=latitude_deg,
        entry__heading_deg=0.0 if latitude_deg > 0.0 else 180.0,
        entry__flight_path_angle_deg=0.0,
    )
    end = flown(mission, 700.0)
    twin = Twin(0.0, 0.0, 0.0, 0.0)
    miss = miss_m_mps(end, *twin.fly(truth_of(mission)[0], 700.0, 0.0))
    assert miss[0] < 0.01
    assert abs(end["lat_rad"]) < math.pi / 2
    assert math.degrees(end["lon_rad"]) == pytest.approx(-170.0)


POLE_DISTANCE_PER_DEG_M = 6_678e3 * 0.5 * math.pi / 180.0  # from 60 deg latitude at 300 km


@pytest.mark.jit_only
@pytest.mark.parametrize(
    "distance_m, off_m",
    [(600.0, 0.05), (60.0, 30.0), (6.0, 1000.0)],
    ids=["600 m: no effect", "60 m", "6 m: step too coarse"],
)
def test_flight_past_a_pole_is_off_by_no_more_than_stated(distance_m, off_m):
    mission = plain_mission(
        entry__altitude_km=300.0,
        entry__latitude_deg=60.0,
        entry__heading_deg=distance_m / POLE_DISTANCE_PER_DEG_M,
        entry__flight_path_angle_deg=0.0,
    )
    twin = Twin(0.0, 0.0, 0.0, 0.0)
    miss = miss_m_mps(flown(mission, 700.0), *twin.fly(truth_of(mission)[0], 700.0, 0.0))
    assert miss[0] < off_m


@pytest.mark.jit_only
@pytest.mark.parametrize(
    "fpa_deg, off_m", [(-89.99, 1e-5), (-90.0, 3.0)], ids=["beyond the floor", "vertical"]
)
def test_vertical_entry_over_the_turning_planet_is_off_by_metres(fpa_deg, off_m):
    mission = plain_mission(
        planet__rotation_radps=EARTH_SPIN_RADPS,
        vehicle__aerodynamics={**LIFTING, "lift_coefficient": 0.0},
        entry__flight_path_angle_deg=fpa_deg,
        entry__speed_mps=3000.0,
    )
    twin = Twin(EARTH_SPIN_RADPS, 0.0, 0.0, 2.5)
    end = flown(mission, 30.0)
    miss = miss_m_mps(end, *twin.fly(truth_of(mission)[0], 30.0, 0.0))
    assert end["alt_m"] < 30e3
    assert miss[0] < off_m


@pytest.mark.parametrize(
    "x, kept", [(0.5, 0.5), (0.01, 0.1), (0.0, 0.1), (-0.01, -0.1), (-0.5, -0.5)]
)
def test_floor_keeps_the_sign_and_leaves_larger_values_alone(x, kept):
    assert motion.away_from_zero(x, 0.1) == kept


def test_turn_rates_stay_finite_at_rest():
    mission = plain_mission(planet__rotation_radps=EARTH_SPIN_RADPS)
    world, truth = world_of(mission)[0], truth_of(mission)[0]
    for v_mps in (0.0, 0.5, 1.0):
        place = truth["lat_rad"], truth["alt_m"], v_mps, -0.5, 1.0
        found = motion.rates(world, truth["held"], *place)
        assert abs(found[4]) < 10.0 / motion.V_MIN_MPS
        assert abs(found[5]) < 10.0 / motion.V_MIN_MPS


@pytest.mark.parametrize("turns", [-3, -1, 0, 1, 2])
@pytest.mark.parametrize("angle_rad", [-3.1, -0.5, 0.0, 2.0, 3.1])
def test_wrapped_angle_is_the_same_direction(angle_rad, turns):
    assert wrapped(angle_rad + turns * 2.0 * math.pi) == pytest.approx(angle_rad, abs=1e-14)


@pytest.mark.parametrize("angle_rad", [math.pi, -math.pi, 3.0])
def test_wrapping_leaves_an_angle_in_range_alone(angle_rad):
    assert wrapped(angle_rad) == angle_rad
    assert math.isnan(wrapped(math.nan))


@pytest.mark.parametrize("lat_rad", [1.6, -1.6, 0.3])
@pytest.mark.parametrize("fpa_rad", [1.7, -1.7, -0.2])
def test_folding_keeps_place_and_direction(lat_rad, fpa_rad):
    lat, fpa, lon_turn, heading_turn = motion.folded(lat_rad, fpa_rad)
    names = ("lon_rad", "lat_rad", "flight_path_angle_rad", "heading_rad")
    rest = {"alt_m": 1e5, "v_rel_mps": 7e3}
    before = dict(zip(names, (0.4, lat_rad, fpa_rad, 0.9), strict=True)) | rest
    after = dict(zip(names, (0.4 + lon_turn, lat, fpa, 0.9 + heading_turn), strict=True)) | rest
    for was, is_now in zip(planet_fixed(before), planet_fixed(after), strict=True):
        assert is_now == pytest.approx(was, abs=1e-6)
    assert abs(lat) <= math.pi / 2
    assert abs(fpa) <= math.pi / 2
