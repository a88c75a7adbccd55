"""Coefficients against the values they were identified from and tables against scipy."""

import math
import re

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from sim_harness.mission.heating_factor import heating_factor
from sim_harness.world.aerodynamics import areas
from sim_harness.world.assembly import world_of
from sim_harness.world.heating import heat_flux
from sim_harness.world.records import HEATING
from tests.sim_harness.flights import plain_mission

# Orbiter, public table: alpha deg by Mach, a negative lift coefficient in it
ALPHAS = [0.0, 10.0, 20.0, 30.0, 40.0]
MACHS = [3.0, 5.0, 8.0, 10.0]
LIFT = [
    [-0.0370, -0.0472, -0.0554, -0.0554],
    [0.2253, 0.1522, 0.1060, 0.1000],
    [0.5222, 0.4235, 0.3649, 0.3559],
    [0.8431, 0.7204, 0.6684, 0.6447],
    [1.0792, 0.9613, 0.9102, 0.8840],
]
DRAG = [
    [0.1068, 0.0876, 0.0800, 0.0800],
    [0.1332, 0.0985, 0.0822, 0.0806],
    [0.2758, 0.2252, 0.1961, 0.1918],
    [0.5698, 0.4922, 0.4582, 0.4433],
    [0.9930, 0.8908, 0.8444, 0.8211],
]


def table_record(rows=5, columns=4):
    model = {
        "model": "table",
        "angle_of_attack_deg": ALPHAS[:rows],
        "mach": MACHS[:columns],
        "lift_coefficient": [row[:columns] for row in LIFT[:rows]],
        "drag_coefficient": [row[:columns] for row in DRAG[:rows]],
    }
    mission = plain_mission(vehicle__aerodynamics=model, vehicle__reference_area_m2=250.0)
    return world_of(mission)[0]["aerodynamics"]


@pytest.mark.parametrize(
    "alpha_deg, lift_m2, drag_m2", [(45.0, 0.496, 1.196), (20.0, 0.509, 0.373)]
)
def test_newtonian_form_gives_the_identified_areas(alpha_deg, lift_m2, drag_m2):
    model = {"model": "newtonian", "n1": 0.7976, "n2": 1.5954, "a1": 0.0795, "a2": 0.9108}
    aero = world_of(plain_mission(vehicle__aerodynamics=model))[0]["aerodynamics"]
    found = areas(aero, math.radians(alpha_deg), 20.0)
    assert found == pytest.approx((lift_m2, drag_m2), abs=1e-3)
    half = world_of(plain_mission(vehicle__aerodynamics=model, vehicle__reference_area_m2=0.5))[0]
    assert areas(half["aerodynamics"], math.radians(alpha_deg), 20.0) == pytest.approx(
        (0.5 * found[0], 0.5 * found[1])
    )


def test_table_agrees_with_scipy_and_holds_its_edges():
    aero = table_record()
    lift = RegularGridInterpolator((ALPHAS, MACHS), np.array(LIFT))
    drag = RegularGridInterpolator((ALPHAS, MACHS), np.array(DRAG))
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-10.0, 50.0, 300), rng.uniform(0.0, 30.0, 300)])
    corners = [(a, m) for a in (-1.0, 0.0, 40.0, 41.0) for m in (2.0, 3.0, 10.0, 11.0)]
    for alpha_deg, mach in np.concatenate([points, corners]):
        held = (np.clip(alpha_deg, 0.0, 40.0), np.clip(mach, 3.0, 10.0))
        want = 250.0 * float(lift(held)), 250.0 * float(drag(held))
        assert areas(aero, math.radians(alpha_deg), mach) == pytest.approx(want, abs=1e-10)


@pytest.mark.parametrize("rows, columns", [(1, 1), (1, 4), (5, 1)])
def test_table_of_one_row_or_column_is_constant_along_it(rows, columns):
    aero = table_record(rows, columns)
    assert areas(aero, math.radians(-5.0), 1.0) == pytest.approx((250.0 * -0.0370, 250.0 * 0.1068))
    if rows == 1:
        assert areas(aero, 0.0, 9.0) == areas(aero, 1.0, 9.0)
    if columns == 1:
        assert areas(aero, 0.3, 3.0) == areas(aero, 0.3, 9.0)


def test_nan_mach_is_not_hidden():
    assert math.isnan(areas(table_record(), 0.2, math.nan)[0])


def heating(*values: float):
    return np.array([(heating_factor(*values), *values[4:])], HEATING)[0]


def test_heat_flux_laws_give_the_published_figures():
    # [MOOIJ18] Eq. 7 equals 1.9495e-4 sqrt(rho/R_N) V^3
    chapman = heating(1.06584e8, 0.238, 1.225, 7905.0, 0.5, 3.0)
    want = 1.9495e-4 * math.sqrt(1e-4 / 0.238) * 7000.0**3
    assert heat_flux(chapman, 1e-4, 7000.0) == pytest.approx(want, rel=1e-4)
    # [DKR57]: 11030 W/cm2 at sea-level density, 7925 m/s, 1 m; k_Q 9.4369e-5 for 1 ft
    detra = heating(11030e4, 0.3048, 1.225, 7925.0, 0.5, 3.15)
    want = 9.4369e-5 * math.sqrt(2e-4) * 6500.0**3.15
    assert heat_flux(detra, 2e-4, 6500.0) == pytest.approx(want, rel=3e-3)
    # a law of other exponents, as for radiation
    other = heating(2.0, 4.0, 2.0, 100.0, 1.2, 8.0)
    assert heat_flux(other, 4.0, 200.0) == pytest.approx(2.0**1.2 * 256.0)


def test_polynomials_are_those_of_their_powers_in_degrees_and_mach() -> None:
    model = {
        "model": "polynomial",
        "lift_powers": [[-0.2, 0.01], [0.03, 0.0, 2e-6]],
        "drag_powers": [[0.08], [-0.006], [6e-4, 1e-6], [1e-7]],
    }
    aero = world_of(plain_mission(vehicle__aerodynamics=model))[0]["aerodynamics"]
    alpha_deg, mach = 27.5, 11.0
    lift, drag = areas(aero, math.radians(alpha_deg), mach)
    assert lift == pytest.approx(-0.2 + 0.01 * mach + alpha_deg * (0.03 + 2e-6 * mach**2))
    expected = 0.08 - 0.006 * alpha_deg + alpha_deg**2 * (6e-4 + 1e-6 * mach) + 1e-7 * alpha_deg**3
    assert drag == pytest.approx(expected)


@pytest.mark.parametrize(
    ("powers", "words"),
    [
        ([[0.01], [-0.001]], "gives C_D -0.08 at an angle of attack of 90 deg and Mach 0"),
        ([[0.1, 0.0, 0.0, 0.0]], "drag_powers has 4 powers of Mach, allowed 3"),
        ([[0.1]] * 5, "has 5 lists, allowed 1 to 4 lists"),
        ([], "has 0 lists, allowed 1 to 4 lists"),
    ],
)
def test_polynomials_that_cannot_be_flown_are_refused(powers: object, words: str) -> None:
    with pytest.raises(ValueError, match=re.escape(words)):
        plain_mission(
            vehicle__aerodynamics={
                "model": "polynomial", "lift_powers": [[0.0]], "drag_powers": powers,
            }
        )  # fmt: skip
