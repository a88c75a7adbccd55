"""What a flight is judged by: peaks, integrals and times, kept up once a minor frame."""

import math

import numpy as np

from flight_sw.records.types_ import Record
from sim_harness.jit import kernel

METRICS = np.dtype(
    [
        ("heat_flux_limit_wpm2", "f8"),  # inf: none
        ("load_factor_limit_g", "f8"),  # inf: none
        ("dynamic_pressure_limit_pa", "f8"),  # inf: none
        ("activated", "u4"),  # 1 once a tracker has been active
        ("heat_flux_max_before_wpm2", "f8"),  # before that
        ("heat_flux_max_after_wpm2", "f8"),  # from then on
        ("heat_flux_error_jpm2", "f8"),  # integral of |q - limit| while tracking, [MOOIJ18] Eq. 42
        ("load_factor_over_gs", "f8"),  # integral of the load factor over its limit, Eq. 43
        ("bank_effort_rads", "f8"),  # integral of |commanded bank|, Eq. 44
        ("bank_step_sq_rad2", "f8"),  # sum of squared steps of the command while tracking
        ("bank_steps", "i8"),  # and their number
        ("bank_prev_rad", "f8"),  # commanded a frame before
        ("tracked_before", "u4"),  # 1 while that frame was tracked too
        ("tracking_time_s", "f8"),
        ("heat_flux_over_s", "f8"),  # time over each limit
        ("load_factor_over_s", "f8"),
        ("dynamic_pressure_over_s", "f8"),
        ("bank_saturated_s", "f8"),  # time with the command on a limit
        ("alpha_saturated_s", "f8"),
        ("bank_travel_rad", "f8"),  # sum of the command's steps
        ("without_fix_s", "f8"),
        ("bank_reversals", "i8"),
        ("bank_sign", "i8"),
    ],
    align=True,
)
"""Judgement of one flight, updated in place."""


SIDE_MIN_RAD = math.radians(1.0)  # nearer to level a command is on neither side


@kernel
def _judge_command(metrics: Record, port: Record, dt_s: float) -> None:
    """Account for the command that is flown in one minor frame."""
    bank_rad = port["bank_cmd_rad"]
    metrics["bank_effort_rads"] += abs(bank_rad) * dt_s
    if port["bank_saturated"] == 1:
        metrics["bank_saturated_s"] += dt_s
    if port["alpha_saturated"] == 1:
        metrics["alpha_saturated_s"] += dt_s
    if port["fix_valid"] == 0:
        metrics["without_fix_s"] += dt_s
    sign = 0
    if bank_rad >= SIDE_MIN_RAD:
        sign = 1
    elif bank_rad <= -SIDE_MIN_RAD:
        sign = -1
    if sign != 0:
        if metrics["bank_sign"] != 0 and sign != metrics["bank_sign"]:
            metrics["bank_reversals"] += 1
        metrics["bank_sign"] = sign


@kernel
def _judge_tracking(
    metrics: Record, q_wpm2: float, port: Record, dt_s: float, is_first: bool
) -> None:
    """Time and error of the tracker, and how far it moved the command since the frame before."""
    bank_rad = port["bank_cmd_rad"]
    tracking = port["tracking"]
    if tracking == 1:
        metrics["activated"] = 1
        metrics["tracking_time_s"] += dt_s
        if metrics["heat_flux_limit_wpm2"] < math.inf:
            error_wpm2 = abs(q_wpm2 - metrics["heat_flux_limit_wpm2"])
            metrics["heat_flux_error_jpm2"] += error_wpm2 * dt_s
    if tracking == 1 and metrics["tracked_before"] == 1:
        step_rad = bank_rad - metrics["bank_prev_rad"]
        metrics["bank_step_sq_rad2"] += step_rad * step_rad
        metrics["bank_steps"] += 1
    if not is_first:
        metrics["bank_travel_rad"] += abs(bank_rad - metrics["bank_prev_rad"])
    metrics["bank_prev_rad"] = bank_rad
    metrics["tracked_before"] = tracking


@kernel
def judge_frame(metrics: Record, truth: Record, port: Record, dt_s: float) -> None:
    """Account for one minor frame, before it is flown: truth at its start, command as received."""
    q_wpm2 = truth["heat_flux_wpm2"]
    load_g = truth["load_factor_g"]
    _judge_tracking(metrics, q_wpm2, port, dt_s, truth["minor_frames"] == 0)
    if metrics["activated"] == 1:
        metrics["heat_flux_max_after_wpm2"] = max(metrics["heat_flux_max_after_wpm2"], q_wpm2)
    else:
        metrics["heat_flux_max_before_wpm2"] = max(metrics["heat_flux_max_before_wpm2"], q_wpm2)
    if q_wpm2 > metrics["heat_flux_limit_wpm2"]:
        metrics["heat_flux_over_s"] += dt_s
    if load_g > metrics["load_factor_limit_g"]:
        metrics["load_factor_over_s"] += dt_s
        metrics["load_factor_over_gs"] += (load_g - metrics["load_factor_limit_g"]) * dt_s
    if truth["dynamic_pressure_pa"] > metrics["dynamic_pressure_limit_pa"]:
        metrics["dynamic_pressure_over_s"] += dt_s
    _judge_command(metrics, port, dt_s)
