"""High-gain observer: the rate of a measured quantity, from the measurement and a model of its
second derivative. Any law may hold one (or several) in its design and state.

Source: [YANHE] Eq. 25 with two departures: the model term is the caller's, for the control as it is
flown (Eq. 25b assumes an unsaturated law), and the estimate starts at the first measurement, which
leaves nothing to peak. The discrete form is exact for a model held between two steps and a
measurement that is held too, or straight between them (the design's choice); its matrices come
from the ground, tools/gains/observer.py.

`observe` at the beginning of a guidance step brings the estimate to now; `expect` at its end tells
the model of the interval that begins. Steps that were missed are coasted on the model; after too
many the observer starts afresh.

Limits: one period, that of the design. Without a model a rate is followed with a delay of l1 eps /
l2; a held measurement adds half a period, and leaves a rate low by period^2 l2 / (12 eps^2).
"""

import math

from flight_sw.records import status
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

BALANCE_TOLERANCE = 1e-9  # of the matrices' rows, for round-off
STEP_MIN_RATIO = 0.5  # of the period: a shorter one is the same step again, or one out of order


def _is_balanced(design: Record) -> str:
    """A constant measurement without a model is a state of rest."""
    value = float(design["value_from_value"] + design["value_from_measured"]) - 1.0
    value += float(design["value_from_newest"])
    rate = float(design["rate_from_value_1ps"] + design["rate_from_measured_1ps"])
    rate += float(design["rate_from_newest_1ps"])
    if abs(value) <= BALANCE_TOLERANCE and abs(rate * design["period_s"]) <= BALANCE_TOLERANCE:
        return ""
    return f"value_from_measured and rate_from_measured_1ps do not balance ({value:g}, {rate:g})"


def _is_stable(design: Record) -> str:
    """Both poles within the unit circle."""
    trace = float(design["value_from_value"] + design["rate_from_rate"])
    determinant = float(
        design["value_from_value"] * design["rate_from_rate"]
        - design["value_from_rate_s"] * design["rate_from_value_1ps"]
    )
    if abs(determinant) < 1.0 and abs(trace) < 1.0 + determinant:
        return ""
    return f"matrix has trace {trace:g} and determinant {determinant:g}, allowed poles inside 1"


DESIGN = RecordSpec(
    "observer",
    Field("period_s", 1e-4, 1e3, "of the guidance steps"),
    Field("value_from_value", -1.0, 1.0, "transition over a period"),
    Field("value_from_rate_s", 0.0, 1e3, "transition"),
    Field("rate_from_value_1ps", -1e6, 0.0, "transition"),
    Field("rate_from_rate", -1.0, 1.0, "transition"),
    Field("value_from_measured", -2.0, 2.0, "measurement at the beginning of the period"),
    Field("rate_from_measured_1ps", -1e6, 1e6, "measurement at the beginning"),
    Field("value_from_newest", -2.0, 2.0, "measurement at its end; 0 where it is held"),
    Field("rate_from_newest_1ps", -1e6, 1e6, "measurement at its end"),
    Field("value_from_accel_s2", 0.0, 1e6, "model held over a period"),
    Field("rate_from_accel_s", 0.0, 1e3, "model held over a period"),
    Field("coast_max_cycles", 0, 1_000_000, "missed steps, then it starts afresh", kind="u4"),
    rules=(_is_balanced, _is_stable),
)
"""x+ = transition x + inputs, for x = (value, rate)."""

STATE = RecordSpec(
    "observer_state",
    Field("started", kind="u4", why="0 until a first measurement"),
    Field("refused_count", kind="u4", why="inputs that were not finite, steps out of order"),
    Field("starts_count", kind="u4"),
    Field("coasted_count", kind="u4", why="steps bridged by the model"),
    Field("t_s", why="of the estimate"),
    Field("value", why="estimate, in the measurement's unit"),
    Field("value_rate", why="estimate, per second"),
    Field("value_accel", why="model of the second derivative, held since t_s"),
    Field("measured", why="at t_s"),
)


@kernel
def _start(state: Record, t_s: float, measured: float) -> None:
    state["started"] = 1
    state["starts_count"] += 1
    state["t_s"] = t_s
    state["value"] = measured
    state["value_rate"] = 0.0
    state["value_accel"] = 0.0
    state["measured"] = measured


@kernel
def _advance(design: Record, state: Record, measured_now: float, missed: float) -> None:
    """Over the period after the last measurement, then over those without one.

    Where some were missed the newest does not belong to that period: the last is held in it.
    """
    value = state["value"]
    rate = state["value_rate"]
    measured = state["measured"]
    newest = measured_now
    if missed > 0.0:
        newest = measured
    accel = state["value_accel"]
    # [YANHE] Eq. 25, solved over a period
    value_now = (
        design["value_from_value"] * value
        + design["value_from_rate_s"] * rate
        + design["value_from_measured"] * measured
        + design["value_from_newest"] * newest
        + design["value_from_accel_s2"] * accel
    )
    rate_now = (
        design["rate_from_value_1ps"] * value
        + design["rate_from_rate"] * rate
        + design["rate_from_measured_1ps"] * measured
        + design["rate_from_newest_1ps"] * newest
        + design["rate_from_accel_s"] * accel
    )
    if missed > 0.0:
        coast_s = missed * design["period_s"]
        value_now += coast_s * (rate_now + 0.5 * coast_s * accel)
        rate_now += coast_s * accel
        state["coasted_count"] += int(missed)
    state["value"] = value_now
    state["value_rate"] = rate_now


@kernel
def observe(design: Record, state: Record, t_s: float, measured: float) -> int:
    """Brings the estimate in `state` to t_s and takes the measurement; returns a status.

    Input that is not finite, and a step that is not after the last, change nothing but a counter.
    """
    if not (math.isfinite(t_s) and math.isfinite(measured)):
        state["refused_count"] += 1
        return status.NONFINITE
    if state["started"] == 0:
        _start(state, t_s, measured)
        return status.OK
    periods = (t_s - state["t_s"]) / design["period_s"]
    if periods < STEP_MIN_RATIO:
        state["refused_count"] += 1
        return status.DOMAIN
    missed = math.floor(periods + 0.5) - 1.0
    if missed > design["coast_max_cycles"]:
        _start(state, t_s, measured)
        return status.OK
    _advance(design, state, measured, missed)
    if not math.isfinite(state["value"] + state["value_rate"]):
        state["refused_count"] += 1
        _start(state, t_s, measured)
        return status.NONFINITE
    state["t_s"] = t_s
    state["measured"] = measured
    return status.OK


@kernel
def expect(state: Record, value_accel: float) -> int:
    """Takes the model's second derivative for the interval that begins; returns a status.

    One that is not finite is counted, and the last is held.
    """
    if not math.isfinite(value_accel):
        state["refused_count"] += 1
        return status.NONFINITE
    state["value_accel"] = value_accel
    return status.OK
