"""A frame of the vehicle: the paper's natural peak, outputs, outcomes, attitude within a frame."""

import math

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from sim_harness.world import records, vehicle
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.missions import load_mission
from sim_harness.world.navigation import NAV_STATE, measure
from tests.sim_harness.flights import flown, fly, plain_mission, run, traced

LIFTING = {"model": "constant", "lift_coefficient": 2.0, "drag_coefficient": 2.5}
NEWTONIAN = {"model": "newtonian", "n1": 0.8, "n2": 1.6, "a1": 0.08, "a2": 0.9}


@pytest.mark.jit_only
def test_natural_peak_of_hyperion_is_the_identified_one():
    mission = load_mission("hyperion-1")
    world, truth = world_of(mission), truth_of(mission)
    assert fly(world, truth, 0.0, math.radians(45.0), 100_000) == records.END_CONDITION
    assert truth["heat_flux_max_wpm2"][0] == pytest.approx(1_700.5e3, abs=6e3)


@pytest.mark.jit_only
def test_outputs_follow_from_the_state():
    end = flown(plain_mission(vehicle__aerodynamics=LIFTING, planet__j2=1e-3), 140.0)
    rho = 1.225 * math.exp(-end["alt_m"] / 7200.0)
    v = end["v_rel_mps"]
    pressure = 0.5 * rho * v * v
    radius_m = 6_378_137.0 + end["alt_m"]
    assert end["rho_kgpm3"] == pytest.approx(rho)
    assert end["mach"] == pytest.approx(v / 300.0)
    assert end["dynamic_pressure_pa"] == pytest.approx(pressure)
    assert end["lift_mps2"] == pytest.approx(pressure * 2.0 / 1000.0)
    assert end["drag_mps2"] == pytest.approx(pressure * 2.5 / 1000.0)
    load = math.hypot(end["lift_mps2"], end["drag_mps2"]) / 9.80665
    assert end["load_factor_g"] == pytest.approx(load)
    assert end["heat_flux_wpm2"] == pytest.approx(1.7415e-4 * math.sqrt(rho) * v**3)
    fall = 3.986004418e14 * (1.0 / 6_378_137.0 - 1.0 / radius_m)
    assert end["energy_jpkg"] == pytest.approx(0.5 * v * v + fall)
    assert end["t_s"] == 140.0
    assert end["minor_frames"] == 7000


def test_forces_reported_are_those_of_the_angle_reached_at_the_end_of_a_frame():
    mission = plain_mission(
        vehicle__aerodynamics=NEWTONIAN,
        entry__altitude_km=60.0,
        actuators__alpha__rate_max_degps=20.0,
    )
    end = flown(mission, 1.0, alpha_deg=40.0)
    s, c = math.sin(math.radians(20.0)), math.cos(math.radians(20.0))
    normal, axial = 0.8 * s * s + 1.6 * s * c, 0.08 * c * c + 0.9 * s * s
    force = end["dynamic_pressure_pa"] / 1000.0
    assert end["alpha_rad"] == pytest.approx(math.radians(20.0))
    assert end["lift_mps2"] == pytest.approx(force * (normal * c - axial * s), rel=1e-9)
    assert end["drag_mps2"] == pytest.approx(force * (normal * s + axial * c), rel=1e-9)


@pytest.mark.jit_only
def test_peaks_are_the_largest_values_on_the_way():
    mission = plain_mission(vehicle__aerodynamics=LIFTING)
    flight = traced(mission, 50 * 400)
    end = flown(mission, 400.0)
    rho = 1.225 * np.exp(-flight["alt_m"] / 7200.0)
    pressures = 0.5 * rho * np.square(flight["v_rel_mps"])
    assert end["load_factor_max_g"] == flight["load_factor_g"].max() > end["load_factor_g"]
    assert end["heat_flux_max_wpm2"] == flight["heat_flux_wpm2"].max() > end["heat_flux_wpm2"]
    assert end["dynamic_pressure_max_pa"] == pytest.approx(pressures.max())


def test_coefficients_of_a_table_follow_the_mach_number_in_flight():
    model = {
        "model": "table",
        "angle_of_attack_deg": [0.0, 40.0],
        "mach": [0.0, 30.0],
        "lift_coefficient": [[0.0, 3.0], [4.0, 7.0]],
        "drag_coefficient": [[1.0, 4.0], [3.0, 6.0]],
    }
    mission = plain_mission(vehicle__aerodynamics=model, entry__altitude_km=60.0)
    end = flown(mission, 2.0, alpha_deg=10.0)
    area_m2 = 1.0 * (end["mach"] / 10.0 + 1.0)  # lift: 4 at 40 deg, 3 more at Mach 30
    force = end["dynamic_pressure_pa"] / 1000.0
    assert end["lift_mps2"] == pytest.approx(force * area_m2)
    assert end["drag_mps2"] == pytest.approx(force * (area_m2 + 0.5))
    mean_drag_mps2 = (7500.0 - end["v_rel_mps"]) / 2.0
    assert mean_drag_mps2 == pytest.approx(end["drag_mps2"], rel=0.2)


@pytest.mark.jit_only
def test_ground_range_adds_up_to_the_arc_flown():
    # A still planet without lift keeps the vehicle in one plane: the arc is the angle turned.
    mission = plain_mission(entry__latitude_deg=0.0, entry__heading_deg=90.0)
    end = flown(mission, 300.0)
    arc_rad = end["lon_rad"] - math.radians(10.0)
    assert end["ground_range_m"] == pytest.approx(6_378_137.0 * arc_rad, rel=1e-9)


@pytest.mark.jit_only
def test_heat_load_is_the_integral_of_the_flux():
    mission = plain_mission(vehicle__aerodynamics=LIFTING)
    world, truth = world_of(mission), truth_of(mission)
    fluxes = []
    for _ in range(100):
        fluxes.append(truth["heat_flux_wpm2"][0])
        run(world, truth, 0.0, 0.0, 100)
    fluxes.append(truth["heat_flux_wpm2"][0])
    simpson = (
        2.0 / 3.0 * (fluxes[0] + fluxes[-1] + 4.0 * sum(fluxes[1::2]) + 2.0 * sum(fluxes[2:-1:2]))
    )
    assert truth["heat_load_jpm2"][0] == pytest.approx(simpson, rel=1e-4)
    assert truth["heat_flux_max_wpm2"][0] >= max(fluxes)


@pytest.mark.jit_only
@pytest.mark.parametrize(
    "changes, outcome",
    [
        ({"end__speed_mps": 3000.0}, records.END_CONDITION),
        ({"end__altitude_km": 20.0}, records.END_CONDITION),
        ({"end__time_max_s": 50.0}, records.TIME_OUT),
        ({}, records.GROUND),
        ({"entry__flight_path_angle_deg": 0.0, "entry__speed_mps": 8500.0}, records.SKIPPED_OUT),
    ],
)
def test_flight_ends_for_the_stated_reason(changes, outcome):
    drag = {"model": "constant", "lift_coefficient": 0.0, "drag_coefficient": 2.5}
    mission = plain_mission(vehicle__aerodynamics=drag, **changes)
    world, truth = world_of(mission), truth_of(mission)
    assert vehicle.ended(world[0], truth[0]) == records.FLYING
    assert fly(world, truth, 0.0, 0.0, 1_000_000) == outcome
    if outcome == records.TIME_OUT:
        assert truth["t_s"][0] == 50.0


@pytest.mark.parametrize("name", ["lat_rad", "v_rel_mps", "heading_rad", "heat_load_jpm2"])
def test_a_number_gone_wrong_ends_the_flight_as_numerical(name):
    mission = plain_mission()
    world, truth = world_of(mission), truth_of(mission)
    truth[name] = math.nan
    assert vehicle.ended(world[0], truth[0]) == records.NUMERICAL


@pytest.mark.jit_only
@pytest.mark.parametrize("bank_deg, side", [(60.0, 1.0), (-60.0, -1.0)])
def test_positive_bank_turns_to_the_right(bank_deg, side):
    mission = plain_mission(vehicle__aerodynamics=LIFTING, entry__latitude_deg=0.0)
    end = flown(mission, 150.0, bank_deg=bank_deg)
    assert side * (end["heading_rad"] - math.radians(60.0)) > 0.02


@pytest.mark.jit_only
@pytest.mark.parametrize("axis, name", [("bank", "heading_rad"), ("alpha", "v_rel_mps")])
def test_halving_the_frame_of_a_lagging_axis_quarters_the_error(axis, name):
    ends = []
    for rate_hz in (25.0, 50.0, 100.0):
        mission = plain_mission(
            vehicle__aerodynamics=NEWTONIAN,
            guidance__rate_hz=rate_hz,
            entry__altitude_km=70.0,
            entry__angle_of_attack_deg=40.0 if axis == "bank" else 0.0,
            **{f"actuators__{axis}__rate_max_degps": 1.0},
        )
        ends.append(flown(mission, 20.0, bank_deg=60.0, alpha_deg=40.0)[name])
    assert (ends[0] - ends[1]) / (ends[1] - ends[2]) == pytest.approx(4.0, rel=0.1)


def test_lift_is_reported_by_its_magnitude_and_all_else_as_it_is():
    down = {**LIFTING, "lift_coefficient": -2.0}
    mission = plain_mission(vehicle__aerodynamics=down, entry__bank_deg=10.0)
    world, truth = world_of(mission), truth_of(mission)
    values = np.full(500, np.nan)
    nav_state = np.zeros(1, NAV_STATE)
    run(world, truth, 0.3, 0.2, 100)
    measure(world[0], truth[0], nav_state[0], values)
    from flight_sw.icd import value_index

    reported = {
        "lon_rad": "NAV_POSITION",
        "lat_rad": "NAV_POSITION",
        "alt_m": "NAV_VERTICAL",
        "v_rel_mps": "NAV_VERTICAL",
        "flight_path_angle_rad": "NAV_DIRECTION",
        "heading_rad": "NAV_DIRECTION",
        "drag_mps2": "NAV_AERO",
        "bank_rad": "NAV_ATTITUDE",
        "alpha_rad": "NAV_ATTITUDE",
        "heat_flux_wpm2": "NAV_HEATING",
        "t_s": "NAV_TIME",
    }
    for name, message in reported.items():
        assert values[value_index(message, name)] == truth[name][0], name
    assert truth["lift_mps2"][0] < 0.0
    assert values[value_index("NAV_AERO", "lift_mps2")] == -truth["lift_mps2"][0]
    assert np.isfinite(values).sum() == len(reported) + 1


@pytest.mark.jit_only
def test_flight_allocates_nothing():
    mission = load_mission("hyperion-1")
    world, truth = world_of(mission), truth_of(mission)
    run(world, truth, 0.0, 0.8, 1)
    _nrt_python.memsys_enable_stats()
    costs = []
    for frames in (10, 10_000):
        before = rtsys.get_allocation_stats()
        run(world, truth, 0.0, 0.8, frames)
        after = rtsys.get_allocation_stats()
        costs.append(after.alloc - before.alloc)
    assert costs[0] == costs[1]
