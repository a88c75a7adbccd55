"""What a flight is judged by, over frames made by hand whose sums can be written down.

All steps are powers of two or small integers, so that sums are exact.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from sim_harness.flight.metrics import METRICS, judge_frame
from sim_harness.flight.port import PORT
from sim_harness.flight.summary import bank_step_rms_deg
from sim_harness.world.records import TRUTH

DT_S = 0.5
QUIET = {"fix_valid": 1}
LIMITS = {
    "heat_flux_limit_wpm2": 100.0,
    "load_factor_limit_g": 4.0,
    "dynamic_pressure_limit_pa": 1000.0,
}


def judged(frames: Sequence[dict[str, float]], **limits: float) -> Any:
    """The judgement of frames that say what differs from a quiet one."""
    metrics, truth, port = np.zeros(1, METRICS), np.zeros(1, TRUTH), np.zeros(1, PORT)
    for name, value in (LIMITS | limits).items():
        metrics[name] = value
    for i, frame in enumerate(frames):
        truth[:], port[:] = np.zeros((), TRUTH), np.zeros((), PORT)
        truth["minor_frames"] = i
        for name, value in (QUIET | frame).items():
            (truth if name in TRUTH.names else port)[name] = value  # type: ignore[operator]
        judge_frame(metrics[0], truth[0], port[0], DT_S)
    return metrics[0]


def banks(*commands_rad: float, **more: float) -> list[dict[str, float]]:
    """Frames with these bank commands."""
    return [{"bank_cmd_rad": bank_rad, **more} for bank_rad in commands_rad]


def test_a_quiet_flight_is_judged_with_nothing() -> None:
    metrics = judged([{}] * 4)
    assert all(metrics[name] == 0 for name in METRICS.names or () if name not in LIMITS)


@pytest.mark.parametrize(
    ("field", "limit", "time"),
    [
        ("heat_flux_wpm2", 100.0, "heat_flux_over_s"),
        ("load_factor_g", 4.0, "load_factor_over_s"),
        ("dynamic_pressure_pa", 1000.0, "dynamic_pressure_over_s"),
    ],
)
def test_time_over_a_limit_counts_frames_above_it_and_not_those_on_it(
    field: str, limit: float, time: str
) -> None:
    shares = (0.0, 0.9, 1.0, 1.25, 1.5, 1.0, 0.5, 2.0)
    metrics = judged([{field: share * limit} for share in shares])
    assert metrics[time] == 3 * DT_S
    others = {"heat_flux_over_s", "load_factor_over_s", "dynamic_pressure_over_s"} - {time}
    assert [metrics[other] for other in others] == [0.0, 0.0]


@pytest.mark.parametrize("field", ["heat_flux_wpm2", "load_factor_g", "dynamic_pressure_pa"])
def test_nothing_is_over_a_limit_that_does_not_exist(field: str) -> None:
    metrics = judged([{field: 1e12, "tracking": 1}] * 3, **dict.fromkeys(LIMITS, math.inf))
    for name in ("heat_flux_over_s", "load_factor_over_s", "dynamic_pressure_over_s"):
        assert metrics[name] == 0.0
    assert metrics["load_factor_over_gs"] == 0.0
    assert metrics["heat_flux_error_jpm2"] == 0.0
    assert metrics["tracking_time_s"] == 3 * DT_S


def test_the_load_over_its_limit_is_the_integral_of_the_excess_alone() -> None:
    metrics = judged([{"load_factor_g": g} for g in (3.0, 4.0, 4.5, 6.0, 5.0, 1.0)])
    assert metrics["load_factor_over_gs"] == (0.5 + 2.0 + 1.0) * DT_S


def test_the_heat_flux_error_is_counted_on_both_sides_while_tracking_alone() -> None:
    fluxes = (40.0, 90.0, 130.0, 100.0, 160.0)
    flags = (0, 1, 1, 1, 0)
    frames = [{"heat_flux_wpm2": q, "tracking": on} for q, on in zip(fluxes, flags, strict=True)]
    metrics = judged(frames)
    assert metrics["heat_flux_error_jpm2"] == (10.0 + 30.0) * DT_S
    assert metrics["tracking_time_s"] == 3 * DT_S


def test_peaks_are_kept_before_the_first_tracking_and_from_then_on() -> None:
    frames = [
        {"heat_flux_wpm2": 70.0},
        {"heat_flux_wpm2": 95.0},
        {"heat_flux_wpm2": 90.0, "tracking": 1},  # its frame belongs to the time after
        {"heat_flux_wpm2": 110.0, "tracking": 1},
        {"heat_flux_wpm2": 120.0},  # released: activated it stays
        {"heat_flux_wpm2": 30.0},
    ]
    metrics = judged(frames)
    assert metrics["activated"] == 1
    assert metrics["heat_flux_max_before_wpm2"] == 95.0
    assert metrics["heat_flux_max_after_wpm2"] == 120.0
    assert judged(frames[:3])["heat_flux_max_after_wpm2"] == 90.0
    assert judged(frames[:2])["activated"] == 0
    assert judged(frames[:2])["heat_flux_max_after_wpm2"] == 0.0


def test_the_bank_effort_is_the_integral_of_the_magnitude() -> None:
    assert judged(banks(0.0, 1.0, -2.0, 0.25))["bank_effort_rads"] == (1.0 + 2.0 + 0.25) * DT_S


def test_the_bank_travel_is_the_sum_of_the_steps_without_the_first_command() -> None:
    metrics = judged(banks(1.0, 1.5, -0.5, -0.5, 0.0))
    assert metrics["bank_travel_rad"] == 0.5 + 2.0 + 0.0 + 0.5


@pytest.mark.parametrize(
    ("commands_rad", "reversals"),
    [
        ((1.0, 2.0, 0.5), 0),
        ((1.0, -1.0), 1),
        ((-1.0, 1.0, -1.0, -2.0, 3.0), 3),
        ((1.0, 0.0, 0.0, 1.0), 0),  # through level and back is none
        ((1.0, 0.0, -1.0), 1),  # through level to the other side is one
        ((0.0, 0.0, -1.0), 0),  # the first side taken is none
        ((1.0, 0.01, -0.01, 0.01, -0.01, 1.0), 0),  # about level there is no side
        ((1.0, 0.01, -0.01, -0.02), 1),
    ],
)
def test_a_reversal_is_a_change_of_the_banks_side(
    commands_rad: tuple[float, ...], reversals: int
) -> None:
    assert judged(banks(*commands_rad))["bank_reversals"] == reversals


def test_steps_while_tracking_are_counted_between_two_tracked_frames() -> None:
    commands_rad = (0.0, 1.0, 1.5, 1.25, 3.0, 2.0, 2.5)
    flags = (0, 1, 1, 1, 0, 1, 1)
    frames = [
        {"bank_cmd_rad": bank_rad, "tracking": on}
        for bank_rad, on in zip(commands_rad, flags, strict=True)
    ]
    metrics = judged(frames)
    assert metrics["bank_steps"] == 3
    assert metrics["bank_step_sq_rad2"] == 0.5**2 + 0.25**2 + 0.5**2
    rms_rad = math.sqrt((0.5**2 + 0.25**2 + 0.5**2) / 3.0)
    assert bank_step_rms_deg(metrics) == pytest.approx(math.degrees(rms_rad), rel=1e-14)
    assert bank_step_rms_deg(judged(frames[:2])) == 0.0


@pytest.mark.parametrize(
    ("flag", "value", "time"),
    [
        ("bank_saturated", 1, "bank_saturated_s"),
        ("alpha_saturated", 1, "alpha_saturated_s"),
        ("fix_valid", 0, "without_fix_s"),
    ],
)
def test_times_of_a_state_count_its_frames(flag: str, value: int, time: str) -> None:
    metrics = judged([{}, {flag: value}, {}, {flag: value}, {flag: value}])
    assert metrics[time] == 3 * DT_S
    others = {"bank_saturated_s", "alpha_saturated_s", "without_fix_s"} - {time}
    assert [metrics[other] for other in others] == [0.0, 0.0]
