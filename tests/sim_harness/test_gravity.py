"""Gravity against the gradient of its potential, distances against vectors."""

import math

import numpy as np
import pytest

from sim_harness.world.planet.gravity import gravity, haversine_m, potential
from sim_harness.world.records import PLANET

EARTH = np.array([(6_378_137.0, 3.986004418e14, 7.292115e-5, 1.08263e-3, 9.81)], PLANET)[0]


@pytest.mark.parametrize("lat_rad", [-1.5, -0.7, 0.0, 0.4, 1.2])
@pytest.mark.parametrize("radius_m", [6.4e6, 7.0e6])
def test_gravity_is_the_gradient_of_the_potential(lat_rad, radius_m):
    def at(radius: float, lat: float) -> float:
        return potential(EARTH, radius, math.sin(lat))

    down, north = gravity(EARTH, radius_m, math.sin(lat_rad), math.cos(lat_rad))
    step_m, step_rad = 10.0, 1e-5
    rise = (at(radius_m + step_m, lat_rad) - at(radius_m - step_m, lat_rad)) / (2.0 * step_m)
    slope = (at(radius_m, lat_rad + step_rad) - at(radius_m, lat_rad - step_rad)) / (2.0 * step_rad)
    assert down == pytest.approx(rise, rel=1e-8)
    assert north == pytest.approx(-slope / radius_m, abs=1e-7)


def test_oblate_earth_pulls_less_at_the_pole_for_equal_radius():
    # WGS 84 normal gravity: 9.7803 at the equator, 9.8322 at the pole
    at_equator, _ = gravity(EARTH, 6_378_137.0, 0.0, 1.0)
    at_pole, _ = gravity(EARTH, 6_356_752.3, 1.0, 0.0)
    assert at_equator - 7.292115e-5**2 * 6_378_137.0 == pytest.approx(9.7803, abs=1e-4)
    assert at_pole == pytest.approx(9.8322, abs=2e-4)


@pytest.mark.parametrize(
    "place, other",
    [((0.1, 0.2), (0.1, 0.2)), ((-3.1, 0.5), (3.1, 0.4)), ((0.3, 1.5), (-2.0, 1.4)),
     ((0.5, -0.3), (0.5 + 1e-5, -0.3 + 1e-5)), ((0.0, 0.0), (math.pi, 0.0))],
)  # fmt: skip
def test_ground_range_is_the_angle_between_the_places(place, other):
    def up(lon: float, lat: float) -> np.ndarray:
        c = math.cos(lat)
        return np.array([c * math.cos(lon), c * math.sin(lon), math.sin(lat)])

    a, b = up(*place), up(*other)
    angle = math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))
    assert haversine_m(6e6, *place, *other) == pytest.approx(6e6 * angle, rel=1e-9, abs=1e-6)
