"""The command limiter against what a limited axis can and cannot do."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flight_sw import limits
from flight_sw.errors import LoadError
from flight_sw.limits import AXIS_LIMITS, LIMITER, UNLIMITED, limit, stoppable_rate
from flight_sw.records import status

DT_S = 0.02
ROUND_OFF_RAD = 1e-10  # of a thousand frames that each take the rate from a difference


def axis(
    low: float = -3.0, high: float = 3.0, rate: float = UNLIMITED, accel: float = UNLIMITED
) -> Any:
    """Limits of an axis as the kernel takes them."""
    record = np.zeros(1, AXIS_LIMITS.dtype)
    record[0] = (low, high, rate, accel)
    return record[0]


def limiter(command: float = 0.0, rate: float = 0.0, started: int = 1) -> Any:
    """A limiter that has sent this command last."""
    record = np.zeros(1, LIMITER.dtype)
    record[0] = (command, rate, started)
    return record[0]


def followed(target: float, bounds: Any, state: Any, frames: int, dt_s: float = DT_S) -> np.ndarray:
    """Commands of so many frames with one target, from the first frame on."""
    out = np.zeros(frames)
    for i in range(frames):
        limit(target, dt_s, bounds, state)
        out[i] = state["command_rad"]
    return out


@pytest.mark.parametrize(
    ("wanted", "sent", "code"),
    [
        (0.5, 0.5, status.OK),
        (-1.0, -1.0, status.OK),
        (2.0, 2.0, status.OK),
        (math.nextafter(2.0, 9.0), 2.0, status.SATURATED),
        (math.nextafter(-1.0, -9.0), -1.0, status.SATURATED),
        (50.0, 2.0, status.SATURATED),
    ],
)
def test_the_first_command_is_taken_at_once_within_magnitude(
    wanted: float, sent: float, code: int
) -> None:
    state = limiter(rate=0.7, started=0)
    assert limit(wanted, DT_S, axis(-1.0, 2.0, 0.1, 0.1), state) == code
    assert (state["command_rad"], state["rate_radps"], state["started"]) == (sent, 0.0, 1)


@pytest.mark.parametrize("wanted", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("started", [0, 1])
def test_a_command_that_is_no_number_holds_the_last_one(wanted: float, started: int) -> None:
    state = limiter(0.3, 0.2, started)
    assert limit(wanted, DT_S, axis(rate=1.0, accel=1.0), state) == status.NONFINITE
    assert (state["command_rad"], state["rate_radps"], state["started"]) == (0.3, 0.2, started)


@pytest.mark.parametrize(("wanted", "sent"), [(2.5, 2.0), (-2.5, -1.0), (2.0, 2.0), (-1.0, -1.0)])
def test_magnitude_holds_without_rate_limits(wanted: float, sent: float) -> None:
    state = limiter(0.0)
    code = limit(wanted, DT_S, axis(-1.0, 2.0), state)
    assert state["command_rad"] == sent
    assert code == (status.OK if wanted == sent else status.SATURATED)


def test_without_limits_any_step_is_taken_in_one_frame() -> None:
    state = limiter(-2.9)
    assert limit(2.9, DT_S, axis(), state) == status.OK
    assert state["command_rad"] == 2.9
    assert state["rate_radps"] == pytest.approx(5.8 / DT_S, rel=1e-14)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_limited_rate_moves_by_rate_times_frame(sign: float) -> None:
    state = limiter(0.0)
    moved = followed(sign * 1.0, axis(rate=2.0), state, 30)
    expected = np.minimum(2.0 * DT_S * np.arange(1, 31), 1.0)
    assert moved == pytest.approx(sign * expected, abs=1e-12)  # round-off of 25 sums


def test_status_says_saturated_until_the_target_is_reached() -> None:
    state = limiter(0.0)
    codes = [limit(0.1, DT_S, axis(rate=1.0), state) for _ in range(7)]
    assert codes == [status.SATURATED] * 4 + [status.OK] * 3


def test_a_target_one_hair_away_is_reached_exactly() -> None:
    state = limiter(0.1)
    assert limit(0.1 + 1e-9, DT_S, axis(rate=1.0, accel=1.0), state) == status.OK
    assert state["command_rad"] == 0.1 + 1e-9


@given(
    start=st.floats(-3.0, 3.0),
    target=st.floats(-3.0, 3.0),
    rate=st.floats(0.05, 20.0),
    accel=st.floats(0.5, 200.0),
    dt_s=st.sampled_from([0.005, 0.02, 0.04, 0.1]),
)
@settings(max_examples=60)
def test_an_axis_reaches_its_target_in_least_time_and_never_overshoots(
    start: float, target: float, rate: float, accel: float, dt_s: float
) -> None:
    bounds = axis(rate=rate, accel=accel)
    way = abs(target - start)
    peak = min(rate, math.sqrt(way * accel))
    # Closed form of a trapezoid (or triangle) of speed, with two frames for the whole numbers.
    least_s = (way / peak + peak / accel) if way > 0.0 else 0.0
    frames = math.ceil(least_s / dt_s) + 3
    path = np.concatenate([[start], followed(target, bounds, limiter(start), frames, dt_s)])
    assert path[-1] == target
    steps = np.diff(path) * (1.0 if target >= start else -1.0)
    assert steps.min() >= -ROUND_OFF_RAD  # never back, so never beyond
    assert np.abs(steps).max() <= rate * dt_s + ROUND_OFF_RAD
    assert np.abs(np.diff(steps, prepend=0.0)).max() <= accel * dt_s * dt_s + 2 * ROUND_OFF_RAD


@given(st.floats(1e-6, 50.0))
def test_stoppable_rate_uses_up_the_way_exactly(steps: float) -> None:
    rate = stoppable_rate(steps, 1.0, 1.0)
    way = 0.0
    while rate > 1e-9:
        way += rate
        rate -= 1.0
    assert way == pytest.approx(steps, rel=1e-9, abs=1e-8)  # the tail of the loop is cut at 1e-9


@given(st.lists(st.floats(-4.0, 4.0), min_size=5, max_size=40))
@settings(max_examples=40)
def test_rate_acceleration_and_magnitude_hold_whatever_is_asked_for(targets: list[float]) -> None:
    bounds = axis(-1.0, 2.0, 3.0, 40.0)
    state = limiter(0.5)
    path = [0.5]
    for target in targets:
        limit(target, DT_S, bounds, state)
        path.append(float(state["command_rad"]))
        assert -1.0 <= path[-1] <= 2.0
    rates = np.diff(path) / DT_S
    assert np.abs(rates).max() <= 3.0 + 1e-9
    inside = (np.array(path[1:]) > -1.0) & (np.array(path[1:]) < 2.0)  # a stop takes any speed out
    assert np.abs(np.diff(rates, prepend=0.0))[inside].max(initial=0.0) <= 40.0 * DT_S + 1e-9


@pytest.mark.parametrize(("command", "rate", "stop"), [(1.99, 5.0, 2.0), (-0.99, -5.0, -1.0)])
def test_an_axis_too_fast_to_stop_is_stopped_at_its_end(
    command: float, rate: float, stop: float
) -> None:
    """No sequence of targets leads there; a memory that says so must not send it beyond."""
    state = limiter(command, rate)
    assert limit(0.5, DT_S, axis(-1.0, 2.0, 10.0, 1.0), state) == status.SATURATED
    assert state["command_rad"] == stop
    assert state["rate_radps"] == pytest.approx((stop - command) / DT_S, rel=1e-12)


def test_limits_out_of_range_are_refused_by_name() -> None:
    record = axis(rate=0.0)
    with pytest.raises(
        LoadError, match=r"bank\.rate_max_radps is 0, allowed 1\.74533e-05 to 1e\+06"
    ):
        limits.AXIS_LIMITS.check(record, "bank")
