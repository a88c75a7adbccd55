"""Command limits: magnitude, rate and acceleration of bank and angle of attack."""

import math

from flight_sw.records import status
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

SLOWEST = math.radians(1e-3)  # rad/s or rad/s2: no axis is that slow
UNLIMITED = 1e6  # rad/s or rad/s2: no limit at any frame rate
LIMIT_TOLERANCE_RAD = 1e-12  # round-off of (target - previous) / dt * dt


def _stops_in_order(limits: Record) -> str:
    low_rad, high_rad = float(limits["low_rad"]), float(limits["high_rad"])
    return "" if low_rad <= high_rad else f"low_rad is {low_rad:g}, allowed to {high_rad:g}"


AXIS_LIMITS = RecordSpec(
    "axis_limits",
    Field("low_rad", -math.pi, math.pi, "smallest command"),
    Field("high_rad", -math.pi, math.pi, "largest command"),
    Field("rate_max_radps", SLOWEST, UNLIMITED, "command slew"),
    Field("accel_max_radps2", SLOWEST, UNLIMITED, "command slew change"),
    rules=(_stops_in_order,),
)

LIMITER = RecordSpec(
    "limiter",
    Field("command_rad", why="last command sent"),
    Field("rate_radps", why="slew of the last command"),
    Field("started", kind="u4", why="0 before the first command"),
)


@kernel
def stoppable_rate(distance_rad: float, step_radps: float, dt_s: float) -> float:
    """Largest rate for the next frame from which the axis still stops within a distance.

    It slows down by at most `step_radps` a frame: with k frames of that before the last one, the
    way is (k + 1) rate - k (k + 1) / 2 step, each times the frame.
    """
    steps = distance_rad / (step_radps * dt_s)
    k = math.floor(0.5 * (math.sqrt(1.0 + 8.0 * steps) - 1.0))
    return step_radps * (steps / (k + 1.0) + 0.5 * k)


@kernel
def limit(wanted_rad: float, dt_s: float, limits: Record, limiter: Record) -> int:
    """Move the axis' command towards `wanted_rad` as fast as its limits allow.

    Writes `limiter`; a command that is not finite holds the last one. The first command is taken
    as it is, within magnitude.
    """
    if not math.isfinite(wanted_rad):
        return status.NONFINITE
    code = status.OK
    target_rad = wanted_rad
    if target_rad < limits["low_rad"]:
        target_rad = limits["low_rad"]
        code = status.SATURATED
    elif target_rad > limits["high_rad"]:
        target_rad = limits["high_rad"]
        code = status.SATURATED
    if limiter["started"] == 0:
        limiter["started"] = 1
        limiter["command_rad"] = target_rad
        limiter["rate_radps"] = 0.0
        return code

    previous_rad = limiter["command_rad"]
    rate_prev_radps = limiter["rate_radps"]
    step_radps = limits["accel_max_radps2"] * dt_s
    if target_rad == previous_rad and abs(rate_prev_radps) <= step_radps:
        limiter["command_rad"] = target_rad  # where it is already, and able to stay there
        limiter["rate_radps"] = target_rad - previous_rad
        return code
    rate_radps = (target_rad - previous_rad) / dt_s
    brake_radps = stoppable_rate(abs(target_rad - previous_rad), step_radps, dt_s)
    reach_radps = min(limits["rate_max_radps"], brake_radps)
    rate_radps = min(max(rate_radps, -reach_radps), reach_radps)
    rate_radps = min(max(rate_radps, rate_prev_radps - step_radps), rate_prev_radps + step_radps)
    moved_rad = previous_rad + rate_radps * dt_s
    moved_rad = min(max(moved_rad, limits["low_rad"]), limits["high_rad"])
    if abs(target_rad - moved_rad) > LIMIT_TOLERANCE_RAD:
        code = status.SATURATED
    else:
        moved_rad = target_rad
    limiter["command_rad"] = moved_rad
    limiter["rate_radps"] = (moved_rad - previous_rad) / dt_s
    return code
