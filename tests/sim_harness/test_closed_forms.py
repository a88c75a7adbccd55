"""Flights with a closed form or a published result; the tolerance is the formula's own error.

[ALLEN58] is exact for a straight path over a flat planet without gravity, and flown so. [EGGERS58]
equilibrium glide neglects the descent angle and takes the air of one altitude: its range is 2 to
5 % low. The skip without gravity is exact. Stardust: published peak load 32.89 g and 31.03 km at
137.9 s after entry, for an assumed constant drag coefficient (3 % and 2 %).
"""

import math

import numpy as np
import pytest

from sim_harness.world.assembly import truth_of, world_of
from tests.sim_harness.flights import EARTH_SPIN_RADPS, flown, fly, plain_mission, traced

pytestmark = pytest.mark.jit_only

RHO0_KGPM3, SCALE_M = 1.225, 7200.0
G0_MPS2 = 9.80665


def coefficients(lift: float, drag: float) -> dict:
    return {"model": "constant", "lift_coefficient": lift, "drag_coefficient": drag}


@pytest.mark.parametrize(
    "fpa_deg, peak_g", [(-90, 127.65), (-45, 90.26), (-20, 43.66), (-10, 22.17)]
)
def test_steep_entry_peaks_as_allen_and_eggers_say(fpa_deg, peak_g):
    beta_kgpm2 = 200.0
    mission = plain_mission(
        vehicle__aerodynamics=coefficients(0.0, 1000.0 / beta_kgpm2),
        entry__speed_mps=7000.0,
        entry__flight_path_angle_deg=float(fpa_deg),
        guidance__rate_hz=1000.0,
    )
    seconds = 110e3 / (7000.0 * math.sin(math.radians(-fpa_deg))) + 40.0
    flight = traced(mission, int(1000 * seconds), low_m=1000.0, flat=True)
    at = int(np.argmax(flight["load_factor_g"]))
    peak_alt_m = SCALE_M * math.log(
        RHO0_KGPM3 * SCALE_M / (beta_kgpm2 * math.sin(math.radians(-fpa_deg)))
    )
    hottest = int(np.argmax(flight["heat_flux_wpm2"]))
    assert flight["load_factor_g"][at] == pytest.approx(peak_g, rel=5e-4)
    assert flight["v_rel_mps"][at] == pytest.approx(7000.0 * math.exp(-0.5), rel=2e-3)
    assert flight["alt_m"][at] == pytest.approx(peak_alt_m, abs=30.0)
    assert flight["v_rel_mps"][hottest] == pytest.approx(7000.0 * math.exp(-1.0 / 6.0), rel=2e-3)


@pytest.mark.parametrize(
    "lift_to_drag, formula_km, formula_s", [(1.0, 5578, 1062), (2.0, 11156, 2124)]
)
def test_equilibrium_glide_goes_as_far_as_the_formula_says(lift_to_drag, formula_km, formula_s):
    lift_area_m2 = 3.0
    radius_m = 6_378_137.0 + 60e3
    v_mps = 7200.0
    gravity_mps2 = 3.986004418e14 / radius_m**2
    wanted_mps2 = gravity_mps2 - v_mps**2 / radius_m
    rho_kgpm3 = 2.0 * 1000.0 * wanted_mps2 / (lift_area_m2 * v_mps**2)
    descent = 2.0 * gravity_mps2 * SCALE_M / (lift_to_drag * v_mps**2)
    mission = plain_mission(
        vehicle__aerodynamics=coefficients(lift_area_m2, lift_area_m2 / lift_to_drag),
        entry__altitude_km=SCALE_M / 1e3 * math.log(RHO0_KGPM3 / rho_kgpm3),
        entry__speed_mps=v_mps,
        entry__flight_path_angle_deg=-math.degrees(descent),
        end__speed_mps=2000.0,
    )
    world, truth = world_of(mission), truth_of(mission)
    assert fly(world, truth, 0.0, 0.0, 400_000) == 1
    assert 1.0 < truth["ground_range_m"][0] / (formula_km * 1e3) < 1.05
    assert 1.0 < truth["t_s"][0] / formula_s < 1.05


def test_skip_without_gravity_turns_as_the_closed_form_says():
    mission = plain_mission(
        vehicle__aerodynamics=coefficients(2.5, 2.5),  # beta 400 kg/m2, L/D 1
        entry__speed_mps=10e3,
        entry__flight_path_angle_deg=-8.0,
    )
    flight = traced(mission, 50 * 400, flat=True)
    lowest = int(np.argmin(flight["alt_m"]))
    out = int(np.argmax(flight["flight_path_angle_rad"]))
    pull_up_rho = RHO0_KGPM3 * math.exp(-flight["alt_m"][lowest] / SCALE_M)
    rho_entry = RHO0_KGPM3 * math.exp(-120e3 / SCALE_M)
    turn = 1.0 - math.cos(math.radians(8.0))
    assert pull_up_rho == pytest.approx(2.0 * 400.0 / SCALE_M * turn + rho_entry, rel=5e-4)
    assert math.degrees(flight["flight_path_angle_rad"][out]) == pytest.approx(8.0, abs=0.01)
    assert flight["v_rel_mps"][out] == pytest.approx(7563.5, abs=2.0)


def stardust_mission(**changes):
    return plain_mission(
        planet__radius_km=6503.14 - 134.0,  # of the ellipsoid below the entry point, 41.5 deg north
        planet__rotation_radps=EARTH_SPIN_RADPS,
        atmosphere={"model": "us76"},
        vehicle={
            "mass_kg": 45.8,
            "reference_area_m2": 0.52,
            "aerodynamics": coefficients(0.0, 45.8 / (60.0 * 0.52)),
        },
        entry={
            "frame": "inertial",
            "altitude_km": 134.0,
            "longitude_deg": -125.0,
            "latitude_deg": 41.5,
            "speed_mps": 12.8e3,
            "flight_path_angle_deg": -8.21,
            "heading_deg": 94.0,
        },
        **changes,
    )


def test_stardust_meets_its_published_peak_and_drogue_time():
    flight = traced(stardust_mission(), 50 * 200, low_m=31.03e3)
    assert flight["v_rel_mps"][0] == pytest.approx(12_448.0, abs=5.0)
    assert math.degrees(flight["flight_path_angle_rad"][0]) == pytest.approx(-8.443, abs=0.01)
    assert flight["load_factor_g"].max() == pytest.approx(32.89, rel=0.03)
    assert flight["t_s"][-1] == pytest.approx(137.9, rel=0.02)


def test_load_factor_counts_in_the_missions_g0():
    in_g = flown(stardust_mission(), 60.0)["load_factor_g"]
    in_mps2 = flown(stardust_mission(planet__g0_mps2=1.0), 60.0)["load_factor_g"]
    assert in_mps2 == pytest.approx(in_g * G0_MPS2)
