"""Axes against closed forms: exponential lag, trapezoidal slew, stops, the shorter way round."""

import math

import numpy as np
import pytest

from sim_harness.mission.keys import Axis
from sim_harness.world.actuators import braking_rate, follow
from sim_harness.world.assembly import actuator_row
from sim_harness.world.records import ACTUATOR

DT_S = 0.02


def actuator(**keys):
    return np.array([actuator_row(Axis(**keys), DT_S)], ACTUATOR)[0]


def slew(axis, start_deg: float, cmd_deg: float, seconds: float) -> np.ndarray:
    """Angle and rate in degrees at every frame."""
    angle, rate = math.radians(start_deg), 0.0
    rows = [(angle, rate)]
    for _ in range(round(seconds / DT_S)):
        angle, rate = follow(axis, angle, rate, math.radians(cmd_deg), DT_S)
        rows.append((angle, rate))
    return np.degrees(np.array(rows))


def test_ideal_axis_is_there_in_one_frame():
    angle, rate = follow(actuator(), 0.1, 0.0, 2.0, DT_S)
    assert angle == pytest.approx(2.0, rel=1e-15)
    assert rate == pytest.approx(1.9 / DT_S)


@pytest.mark.parametrize("lag_s", [0.05, 0.5, 3.0])
@pytest.mark.parametrize("cmd_deg", [30.0, -30.0])
def test_lag_is_the_exact_exponential(lag_s, cmd_deg):
    path = slew(actuator(lag_s=lag_s), 0.0, cmd_deg, 2.0)
    want = cmd_deg * (1.0 - math.exp(-2.0 / lag_s))
    assert path[-1, 0] == pytest.approx(want, rel=1e-12)


@pytest.mark.parametrize("cmd_deg", [40.0, -40.0])
def test_rate_limit_sets_the_time_of_a_slew(cmd_deg):
    path = slew(actuator(rate_max_degps=20.0), 0.0, cmd_deg, 3.0)
    assert np.abs(path[:, 1]).max() == pytest.approx(20.0)
    arrived = np.argmax(np.isclose(path[:, 0], cmd_deg, atol=1e-9)) * DT_S
    assert arrived == pytest.approx(2.0, abs=1.5 * DT_S)
    assert path[-1] == pytest.approx([cmd_deg, 0.0], abs=1e-9)


@pytest.mark.parametrize("cmd_deg", [60.0, -60.0, 8.0])
def test_acceleration_limit_gives_the_time_optimal_slew_without_overshoot(cmd_deg):
    rate_max, accel_max = 15.0, 5.0
    path = slew(actuator(rate_max_degps=rate_max, accel_max_degps2=accel_max), 0.0, cmd_deg, 12.0)
    distance = abs(cmd_deg)
    if distance > rate_max**2 / accel_max:
        closed_form_s = distance / rate_max + rate_max / accel_max
    else:
        closed_form_s = 2.0 * math.sqrt(distance / accel_max)
    assert np.abs(np.diff(path[:, 1])).max() <= accel_max * DT_S * (1.0 + 1e-9)
    assert np.abs(path[:, 1]).max() <= rate_max * (1.0 + 1e-9)
    assert np.abs(path[:, 0]).max() <= distance * (1.0 + 1e-9)
    arrived = np.argmax(np.abs(path[:, 0] - cmd_deg) < 1e-3) * DT_S
    assert arrived == pytest.approx(closed_form_s, abs=0.2)
    assert path[-1] == pytest.approx([cmd_deg, 0.0], abs=1e-6)


@pytest.mark.parametrize("cmd_deg, stop_deg", [(90.0, 50.0), (-90.0, -10.0)])
@pytest.mark.parametrize("keys", [{}, {"lag_s": 0.2}, {"rate_max_degps": 30.0}])
def test_stops_hold_the_axis(cmd_deg, stop_deg, keys):
    path = slew(actuator(low_deg=-10.0, high_deg=50.0, **keys), 20.0, cmd_deg, 6.0)
    assert path[-1] == pytest.approx([stop_deg, 0.0], abs=1e-6)
    assert path[:, 0].min() >= -10.0 - 1e-12
    assert path[:, 0].max() <= 50.0 + 1e-12


@pytest.mark.parametrize("start_deg, cmd_deg, sign", [(170.0, -170.0, 1.0), (-170.0, 170.0, -1.0)])
def test_free_axis_takes_the_shorter_way_round(start_deg, cmd_deg, sign):
    path = slew(actuator(rate_max_degps=10.0), start_deg, cmd_deg, 1.0)
    assert path[1, 1] == pytest.approx(sign * 10.0)
    assert np.abs(path[:, 0]).max() <= 180.0
    assert slew(actuator(rate_max_degps=10.0), start_deg, cmd_deg, 3.0)[-1, 0] == pytest.approx(
        cmd_deg
    )


def test_axis_with_stops_goes_the_long_way():
    keys = {"rate_max_degps": 10.0, "low_deg": -175.0, "high_deg": 175.0}
    path = slew(actuator(**keys), 170.0, -170.0, 40.0)
    assert path[1, 1] == pytest.approx(-10.0)
    assert path[-1, 0] == pytest.approx(-170.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_axis_that_hits_a_stop_at_speed_stays_there(side):
    axis = actuator(accel_max_degps2=5.0, low_deg=-10.0, high_deg=10.0)
    near, fast, stop = (math.radians(side * x) for x in (9.99, 20.0, 10.0))
    assert follow(axis, near, fast, stop, DT_S) == (pytest.approx(stop), 0.0)


@pytest.mark.parametrize("distance_rad", [1e-6, 1e-4, 0.01, 0.37, 3.0])
def test_braking_from_the_allowed_rate_ends_exactly_at_the_distance(distance_rad):
    accel_radps2 = 0.09
    rate = braking_rate(distance_rad, accel_radps2, DT_S)
    covered = 0.0
    while rate > 0.0:
        covered += rate * DT_S
        rate -= accel_radps2 * DT_S
    assert covered == pytest.approx(distance_rad, rel=1e-9)


def test_nan_command_is_not_hidden():
    assert math.isnan(follow(actuator(), 0.1, 0.0, math.nan, DT_S)[0])
