"""How an axis (bank or angle of attack) follows its command: lag, rate, acceleration, stops.

Order within a frame: the command is held inside the stops; the lag takes its share of the error
(exact for a command held over the frame); the acceleration limit keeps the rate low enough to stop
at the command without overshoot; then rate and acceleration limit apply. Infinite limits and zero
lag make the axis follow at once.

An axis whose stops are a full turn or more apart turns freely: it takes the shorter way round
and its angle stays between -pi and pi. Any other axis never crosses its stops.

Limits: the angle moves linearly within a frame.
"""

import math

from flight_sw.model.angles import wrapped
from flight_sw.records.types_ import Record
from sim_harness.jit import kernel


@kernel
def braking_rate(distance_rad: float, accel_radps2: float, dt_s: float) -> float:
    """Largest rate from which the axis still stops within a distance, in whole frames.

    It is lost in `slower` further frames of full deceleration and a rest of one.
    """
    quantum = accel_radps2 * dt_s
    root = math.sqrt(1.0 + 8.0 * distance_rad / (quantum * dt_s))
    slower = math.floor(0.5 * (root - 1.0))
    return distance_rad / (dt_s * (slower + 1.0)) + 0.5 * quantum * slower


@kernel
def held_between(x: float, low: float, high: float) -> float:
    """x, or the nearer bound outside; NaN stays NaN."""
    if x < low:
        return low
    if x > high:
        return high
    return x


@kernel
def wrapped_if_free(actuator: Record, angle_rad: float) -> float:
    """The angle between -pi and pi on an axis without stops."""
    if actuator["turns_freely"] == 1:
        return wrapped(angle_rad)
    return angle_rad


@kernel
def is_ideal(actuator: Record) -> bool:
    """True when the axis follows within the frame that commands it."""
    return (
        actuator["lag_gain"] == 1.0
        and actuator["rate_max_radps"] == math.inf
        and actuator["accel_max_radps2"] == math.inf
    )


@kernel
def follow(
    actuator: Record, angle_rad: float, rate_radps: float, cmd_rad: float, dt_s: float
) -> tuple[float, float]:
    """Angle and rate after one frame of following a command."""
    if actuator["turns_freely"] == 1:
        error = wrapped(cmd_rad - angle_rad)
    else:
        error = held_between(cmd_rad, actuator["low_rad"], actuator["high_rad"]) - angle_rad
    if is_ideal(actuator):
        return wrapped_if_free(actuator, angle_rad + error), error / dt_s

    accel = actuator["accel_max_radps2"]
    rate_max = actuator["rate_max_radps"]
    rate = held_between(actuator["lag_gain"] * error / dt_s, -rate_max, rate_max)
    if accel < math.inf:
        stoppable = braking_rate(abs(error), accel, dt_s)
        rate = held_between(rate, -stoppable, stoppable)
        rate = held_between(rate, rate_radps - accel * dt_s, rate_radps + accel * dt_s)
    angle = wrapped_if_free(actuator, angle_rad + rate * dt_s)
    if actuator["turns_freely"] == 0:
        if angle < actuator["low_rad"]:
            return actuator["low_rad"], 0.0
        if angle > actuator["high_rad"]:
            return actuator["high_rad"], 0.0
    return angle, rate
