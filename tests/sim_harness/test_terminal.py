"""Terminal errors against closed forms of the sphere, and which end condition ended a flight."""

import math

import numpy as np
import pytest

from sim_harness.flight.metrics import METRICS, judge_frame
from sim_harness.flight.port import PORT
from sim_harness.flight.terminal import (
    direction,
    end_trigger,
    ranges_rad,
    state_at_end,
    state_of,
    terminal_errors,
    told,
)
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.missions import load_mission
from sim_harness.world.records import END_CONDITION, TIME_OUT, TRUTH
from sim_harness.world.vehicle import hold
from tests.sim_harness.flights import fly, plain_mission

RADIUS_KM = 6378.137
TARGET = {"longitude_deg": 10.0, "latitude_deg": 0.0, "altitude_km": 10.0, "speed_mps": 500.0}


def place(lon_deg: float, lat_deg: float):
    return direction(math.radians(lon_deg), math.radians(lat_deg))


@pytest.mark.parametrize(
    "flown, along_deg, right_deg",
    [((10.0, 0.0), 10.0, 0.0), ((9.0, 0.0), 9.0, 0.0), ((10.0, 1.0), 10.0, -1.0),
     ((11.0, -2.0), 11.0, 2.0), ((-3.0, 0.0), -3.0, 0.0)],
)  # fmt: skip
def test_on_the_equator_longitude_is_range_and_latitude_is_offset(flown, along_deg, right_deg):
    wanted, along, right = ranges_rad(place(0.0, 0.0), place(10.0, 0.0), place(*flown))
    assert math.degrees(wanted) == pytest.approx(10.0)
    assert math.degrees(along) == pytest.approx(along_deg, abs=1e-12)
    assert math.degrees(right) == pytest.approx(right_deg, abs=1e-12)


def test_offsets_are_the_legs_of_a_right_spherical_triangle():
    # Napier: cos c = cos a cos b, wherever on the sphere the triangle lies.
    start, target, flown = place(170.0, 40.0), place(-150.0, 20.0), place(-160.0, 33.0)
    _, along, right = ranges_rad(start, target, flown)
    c = math.acos(np.dot(start, flown))
    assert math.cos(c) == pytest.approx(math.cos(along) * math.cos(right), abs=1e-14)
    assert right < 0.0  # the place lies north of the way, on its left
    back = ranges_rad(target, start, flown)
    assert back[2] == pytest.approx(-right, abs=1e-14)
    assert back[0] - back[1] == pytest.approx(along, abs=1e-14)


@pytest.mark.parametrize("target", [(30.0, 10.0), (-150.0, -10.0)])
def test_a_target_without_a_great_circle_counts_the_distance_alone(target):
    _, along, right = ranges_rad(place(30.0, 10.0), place(*target), place(30.0, 14.0))
    assert (math.degrees(along), right) == (pytest.approx(4.0), 0.0)


def test_errors_have_the_signs_that_are_documented():
    truth = np.zeros(1, TRUTH)
    truth["lon_rad"], truth["lat_rad"] = math.radians(9.0), math.radians(-0.5)
    truth["alt_m"], truth["v_rel_mps"] = 10_700.0, 490.0
    mission = plain_mission(target=TARGET, entry__longitude_deg=0.0, entry__latitude_deg=0.0)
    errors = terminal_errors(mission, state_of(truth[0]))
    # short by a degree over cos(0.5 deg) (4e-5), right of the way, high, slow
    assert errors.downrange_error_km == pytest.approx(RADIUS_KM * math.radians(1.0), rel=1e-3)
    assert errors.crossrange_error_km == pytest.approx(RADIUS_KM * math.radians(0.5))
    assert errors.altitude_error_km == pytest.approx(0.7)
    assert errors.speed_error_mps == pytest.approx(-10.0)


def test_without_a_target_no_error_is_told():
    mission = plain_mission()
    assert set(terminal_errors(mission, state_of(truth_of(mission)[0]))) == {None}


@pytest.mark.parametrize(
    "speed_mps, alt_m, trigger",
    [(500.0, 20e3, "speed"), (900.0, 10e3, "altitude"), (499.0, 9e3, "speed and altitude")],
)
def test_the_part_of_the_end_condition_that_was_met_is_told(speed_mps, alt_m, trigger):
    mission = plain_mission(end={"speed_mps": 500.0, "altitude_km": 10.0})
    truth = np.zeros(1, TRUTH)
    truth["v_rel_mps"], truth["alt_m"] = speed_mps, alt_m
    world = world_of(mission)[0]
    assert end_trigger(world, truth[0], END_CONDITION) == trigger
    assert end_trigger(world, truth[0], TIME_OUT) is None
    assert told(mission, world, truth[0], END_CONDITION)["end_trigger"] == trigger


@pytest.mark.parametrize("latitude_deg", [0.0, -16.0, 90.0])
def test_the_energy_of_the_target_is_that_of_its_speed_there(latitude_deg):
    target = TARGET | {"latitude_deg": latitude_deg}
    mission = plain_mission(
        target=target, end={"at_target_energy": "yes"}, planet__rotation_radps=7.292115e-5,
        planet__j2=1.08262668e-3,
    )  # fmt: skip
    world = world_of(mission)[0]
    planet = mission.planet
    r, s = RADIUS_KM * 1e3 + 10e3, math.sin(math.radians(latitude_deg))
    oblate = planet.j2 * (RADIUS_KM * 1e3 / r) ** 2 * (3 * s * s - 1) / 2
    spin = planet.rotation_radps * r * math.cos(math.radians(latitude_deg))
    wanted = 500.0**2 / 2 - spin**2 / 2 - planet.mu_m3ps2 / r * (1 - oblate)
    assert world["end"]["energy_jpkg"] == pytest.approx(wanted, rel=1e-12)
    truth = np.zeros(1, TRUTH)
    truth["v_rel_mps"], truth["alt_m"], truth["jacobi_energy_jpkg"] = 499.0, 10e3, wanted - 1.0
    assert end_trigger(world, truth[0], END_CONDITION) == "energy"


@pytest.mark.parametrize("end, index", [({"altitude_km": 60.0}, 2), ({"speed_mps": 7000.0}, 3)])
def test_errors_are_those_of_the_moment_at_which_the_end_was_met(end, index):
    # Frames of 0.1 s: the last one lies up to 40 m below, the state told does not.
    mission = plain_mission(end=end, guidance__rate_hz=10.0,
                            vehicle__aerodynamics__drag_coefficient=3.0)  # fmt: skip
    fine = plain_mission(end=end, guidance__rate_hz=1000.0,
                         vehicle__aerodynamics__drag_coefficient=3.0)  # fmt: skip
    states = []
    for flown in (mission, fine):
        world, truth = world_of(flown), truth_of(flown)
        assert fly(world, truth, 0.0, 0.0, 400_000) == END_CONDITION
        states.append(state_at_end(world[0], truth[0], END_CONDITION))
    met = 60e3 if index == 2 else 7000.0
    assert states[0][index] == pytest.approx(met, abs=1e-3)
    assert states[0] == pytest.approx(states[1], rel=1e-7)


def test_an_overridden_target_needs_all_its_keys():
    with pytest.raises(Exception, match=r"target\.speed_mps is missing"):
        load_mission("hyperion-1", {"target.longitude_deg": 1.0, "target.latitude_deg": 0.0,
                                    "target.altitude_km": 10.0})  # fmt: skip


def test_steps_of_the_command_count_between_tracked_frames_alone():
    metrics, truth, port = np.zeros(1, METRICS), np.zeros(1, TRUTH), np.zeros(1, PORT)
    metrics["heat_flux_limit_wpm2"] = math.inf
    for bank_rad, tracking in ((0.0, 0), (1.0, 1), (1.3, 1), (1.1, 1), (0.0, 0), (0.7, 1)):
        port["bank_cmd_rad"], port["tracking"] = bank_rad, tracking
        judge_frame(metrics[0], truth[0], port[0], 0.02)
    assert metrics["bank_steps"][0] == 2
    assert metrics["bank_step_sq_rad2"][0] == pytest.approx(0.3**2 + 0.2**2)
    assert metrics["heat_flux_error_jpm2"][0] == 0.0  # no limit: no error


@pytest.mark.parametrize("side_lift_ratio, turned_deg", [(0.0, 0.0), (1.0, 30.0)])
def test_a_vehicle_whose_side_lift_is_left_out_stays_in_its_plane(side_lift_ratio, turned_deg):
    mission = plain_mission(vehicle__side_lift_ratio=side_lift_ratio)
    truth = truth_of(mission)
    hold(world_of(mission)[0], truth[0], math.radians(30.0), 0.0)
    held = truth[0]["held"]
    assert held["cos_bank"] == pytest.approx(math.cos(math.radians(30.0)))
    assert math.degrees(math.asin(held["sin_bank"])) == pytest.approx(turned_deg)
