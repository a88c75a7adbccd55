"""The corridor against closed forms and against the equations of motion."""

import math

import numpy as np
import pytest

from sim_harness.mission.mission import Mission
from sim_harness.world.assembly import world_of
from sim_harness.world.motion import rates
from sim_harness.world.records import HELD
from tests.sim_harness.flights import plain_mission
from tools.review.corridor import (
    DYNAMIC_PRESSURE,
    EQUILIBRIUM,
    HEAT_FLUX,
    LOAD_FACTOR,
    Corridor,
    PathLimits,
    altitude_of_density,
    corridor,
    flown_by_speed,
)
from tools.review.source import limits_of

CL, CD, AREA_M2, MASS_KG = 0.4, 0.8, 2.0, 1000.0
RHO0_KGPM3, SCALE_M = 1.225, 7200.0  # of the exponential atmosphere of plain_mission
LAT_RAD, HEADING_RAD = 0.3, 1.1
FIELDS = (
    "t_s", "v_rel_mps", "drag_mps2", "lift_mps2", "dynamic_pressure_pa", "lat_rad", "heading_rad",
)  # fmt: skip


def mission(**changes: object) -> Mission:
    """A vehicle of L/D 0.5 with a limit of every kind."""
    aerodynamics = {"model": "constant", "lift_coefficient": CL, "drag_coefficient": CD}
    vehicle = {"mass_kg": MASS_KG, "reference_area_m2": AREA_M2, "aerodynamics": aerodynamics}
    limits = {
        "heat_flux_max_kwpm2": 800.0,
        "load_factor_max_g": 4.0,
        "dynamic_pressure_max_kpa": 15.0,
    }
    return plain_mission(vehicle=vehicle, limits=limits, **changes)


def truth(speeds_mps: np.ndarray) -> np.ndarray:
    """States at some pressure, as the vehicle above would have been in them."""
    rows = np.zeros(len(speeds_mps), [(name, "f8") for name in FIELDS])
    rows["t_s"] = np.arange(len(rows))
    rows["v_rel_mps"] = speeds_mps
    rows["dynamic_pressure_pa"] = 5000.0
    rows["drag_mps2"] = 5000.0 * CD * AREA_M2 / MASS_KG
    rows["lift_mps2"] = 5000.0 * CL * AREA_M2 / MASS_KG
    rows["lat_rad"], rows["heading_rad"] = LAT_RAD, HEADING_RAD
    return rows


def corridor_of(flown: Mission, low_mps: float = 0.0) -> Corridor:
    """Its corridor from 7,000 to 3,000 m/s."""
    found = flown_by_speed(truth(np.linspace(7000.0, 3000.0, 50)))
    assert found is not None
    return corridor(world_of(flown)[0], limits_of(flown), found, low_mps)


def test_each_upper_limit_is_met_exactly_on_its_line() -> None:
    found = corridor_of(mission())
    v = found.v_rel_mps
    density = {n: 2.0 * d * MASS_KG / (CD * AREA_M2 * v * v) for n, d in found.drag_mps2.items()}
    heat_flux = 1.7415e-4 * np.sqrt(density[HEAT_FLUX]) * v**3  # nose radius 1 m
    np.testing.assert_allclose(heat_flux, 800e3, rtol=1e-12)
    total = found.drag_mps2[LOAD_FACTOR] * math.hypot(1.0, CL / CD)
    np.testing.assert_allclose(total / 9.80665, 4.0, rtol=1e-12)
    pressure = 0.5 * density[DYNAMIC_PRESSURE] * v * v
    np.testing.assert_allclose(pressure, 15e3, rtol=1e-12)


def test_altitudes_are_those_of_the_density() -> None:
    found = corridor_of(mission())
    density = 2.0 * found.drag_mps2[LOAD_FACTOR] * MASS_KG / (CD * AREA_M2 * found.v_rel_mps**2)
    expected = -SCALE_M * np.log(density / RHO0_KGPM3)
    np.testing.assert_allclose(found.alt_m[LOAD_FACTOR], expected, atol=0.01)


@pytest.mark.parametrize("spin_radps", [0.0, 7.292115e-5, -3e-4])
def test_equilibrium_glide_holds_the_flight_path_angle_level(spin_radps: float) -> None:
    flown = mission(planet__rotation_radps=spin_radps)
    found = corridor_of(flown)
    held = np.zeros(1, HELD)
    held["cos_bank"], held["lift_area_m2"], held["drag_area_m2"] = 1.0, CL * AREA_M2, CD * AREA_M2
    world, steepest = world_of(flown)[0], 0.0
    for v, alt in zip(found.v_rel_mps, found.alt_m[EQUILIBRIUM], strict=True):
        if math.isfinite(alt):
            turn = rates(world, held[0], LAT_RAD, float(alt), float(v), 0.0, HEADING_RAD)[4]
            steepest = max(steepest, abs(turn))
    assert steepest < 1e-8  # rad/s; gravity alone would turn it by 1e-3


def test_without_a_limit_there_is_no_line() -> None:
    found = flown_by_speed(truth(np.linspace(7000.0, 3000.0, 50)))
    assert found is not None
    none = PathLimits(math.inf, math.inf, math.inf)
    assert set(corridor(world_of(mission())[0], none, found, 0.0).drag_mps2) == {EQUILIBRIUM}


def test_the_corridor_reaches_down_to_the_end_of_the_mission() -> None:
    assert corridor_of(mission(), low_mps=1500.0).v_rel_mps[0] == 1500.0
    assert corridor_of(mission()).v_rel_mps[0] == 3000.0


def test_a_speed_flown_twice_counts_as_it_was_last() -> None:
    rows = truth(np.array([6900.0, 7000.0, 6500.0, 6600.0, 6400.0]))
    rows["drag_mps2"] *= np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    found = flown_by_speed(rows)
    assert found is not None
    assert found.v_rel_mps.tolist() == [6400.0, 6500.0, 7000.0]


def test_a_flight_without_air_has_no_corridor() -> None:
    rows = truth(np.linspace(7000.0, 6999.0, 5))
    rows["dynamic_pressure_pa"] = 0.0
    assert flown_by_speed(rows) is None


def test_a_density_outside_the_air_has_no_altitude() -> None:
    air = world_of(mission())[0]["atmosphere"]
    found = altitude_of_density(air, np.array([RHO0_KGPM3 / math.e, 1e9, 0.0]))
    assert found[0] == pytest.approx(SCALE_M, abs=0.01)
    assert np.isnan(found[1:]).all()
