"""Entry states: inertial and relative are each other's inverse, and worked by hand once."""

import math

import pytest

from sim_harness.world.frames import Velocity, inertial_from_relative, relative_from_inertial

SPIN_RADPS = 7.292115e-5


@pytest.mark.parametrize("heading_rad", [-2.5, -0.1, 0.7, 1.6, 3.0])
@pytest.mark.parametrize("fpa_rad", [-1.2, -0.1, 0.3])
@pytest.mark.parametrize("lat_rad", [-1.0, 0.0, 0.7])
def test_round_trip_returns_the_entry_state(heading_rad, fpa_rad, lat_rad):
    start = Velocity(7500.0, fpa_rad, heading_rad)
    there = inertial_from_relative(start, 6.5e6, lat_rad, SPIN_RADPS)
    assert relative_from_inertial(there, 6.5e6, lat_rad, SPIN_RADPS) == pytest.approx(start)


@pytest.mark.parametrize("heading_rad, speed_mps", [(math.pi / 2, 7474.0), (-math.pi / 2, 6526.0)])
def test_eastward_flight_is_faster_in_inertial_space(heading_rad, speed_mps):
    # 474 m/s is the equator's speed at 6,500 km from the centre
    there = inertial_from_relative(Velocity(7000.0, 0.0, heading_rad), 6.5e6, 0.0, SPIN_RADPS)
    assert there.speed_mps == pytest.approx(speed_mps, abs=0.1)
    assert there.heading_rad == pytest.approx(heading_rad)


def test_vertical_fall_stays_vertical_at_the_pole():
    fall = Velocity(5000.0, -math.pi / 2, 0.3)
    there = inertial_from_relative(fall, 6.5e6, math.pi / 2, SPIN_RADPS)
    assert there.flight_path_angle_rad == pytest.approx(-math.pi / 2)
