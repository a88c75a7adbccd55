"""Simple adaptive control of one output error: gains that grow with the square of the error.

Source: [MOOIJ18] Eqs. 33-41 without a reference model, so that the error alone drives the command,
and a scalar of each. Error, gain and their product can be held within limits, which the source
does not do: its gain has none, and 5 % of heat-flux error asks for thousands of degrees.

Limits: bank alone; an error that stays grows a gain of T_i e^2 / sigma_i.
"""

import math

from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

DIFFERENCE, ANALYTIC, OBSERVER = 0, 1, 2
RATES = ("difference", "analytic", "observer")
"""Where the rate of the heat-flux error comes from."""

HUGE = 1e12

TRACKER = RecordSpec(
    "adaptive_tracker",
    Field("t_p_1prad2", 0.0, 1e6, "proportional weight, Eq. 36"),
    Field("t_i_1prad2ps", 0.0, 1e6, "integral weight, Eq. 35"),
    Field("k_initial_ratio", -1e3, 1e3, "Eq. 37"),
    Field("leak_1ps", 0.0, 1e2, "sigma_i of Eq. 41"),
    Field("rate_s", 0.0, 1e3, "K_D of Eq. 40"),
    Field("error_max_rad", math.radians(1e-3), HUGE, "of the error with its rate"),
    Field("gain_max_ratio", 1e-3, HUGE, "of the integral gain, and of the whole"),
)

TRACKER_STATE = RecordSpec(
    "adaptive_tracker_state",
    Field("started", kind="u4"),
    Field("error_prev_rad", why="without its rate"),
    Field("error_rad", why="e* of Eq. 40, as fed back"),
    Field("gain_integral_ratio", why="Eqs. 37 and 41"),
    Field("gain_ratio", why="with the proportional part, Eq. 34"),
)


@kernel
def rate_by_difference(state: Record, error_rad: float, dt_s: float) -> float:
    """Backward difference of the error, as in the source; 0 at the first step."""
    rate_radps = 0.0
    if state["started"] == 1:
        rate_radps = (error_rad - state["error_prev_rad"]) / dt_s
    return rate_radps


@kernel
def adapted(
    design: Record, state: Record, error_rad: float, rate_radps: float, dt_s: float
) -> float:
    """Bank for an error and its rate; the gains are brought up to date.  [MOOIJ18] Eqs. 33-41"""
    integral = state["gain_integral_ratio"]
    if state["started"] == 0:
        state["started"] = 1
        integral = design["k_initial_ratio"]
    most_rad = design["error_max_rad"]
    error = min(max(error_rad + design["rate_s"] * rate_radps, -most_rad), most_rad)
    squared = error * error
    integral += (squared * design["t_i_1prad2ps"] - design["leak_1ps"] * integral) * dt_s
    integral = min(integral, design["gain_max_ratio"])
    gain = min(integral + squared * design["t_p_1prad2"], design["gain_max_ratio"])
    state["error_prev_rad"] = error_rad
    state["error_rad"] = error
    state["gain_integral_ratio"] = integral
    state["gain_ratio"] = gain
    return gain * error
