"""From the keys of `[navigation]` to its record: units turn to SI here."""

import math

import numpy as np

from flight_sw.errors import MissionError
from sim_harness.mission.mission import Mission
from sim_harness.mission.navigation_keys import Navigation
from sim_harness.world.navigation import CHANNELS, DRAG, HEAT_FLUX, LATENCY_MAX_REPORTS, LIFT

DROPOUT_KEYS = {"dropout_ratio", "dropout_s", "dropout_of"}


def sigmas(keys: Navigation) -> tuple[float, ...]:
    """Standard deviations in the order of CHANNELS."""
    attitude = math.radians(keys.attitude_noise_deg)
    return (
        keys.position_noise_m,
        keys.position_noise_m,
        keys.altitude_noise_m,
        keys.speed_noise_mps,
        math.radians(keys.path_angle_noise_deg),
        math.radians(keys.heading_noise_deg),
        keys.accel_noise_mps2,
        keys.accel_noise_mps2,
        attitude,
        attitude,
        keys.heat_flux_noise_kwpm2 * 1e3,
    )


def biases(keys: Navigation) -> tuple[float, ...]:
    """Constant errors in the order of CHANNELS."""
    return (
        keys.north_bias_m,
        keys.east_bias_m,
        keys.altitude_bias_m,
        keys.speed_bias_mps,
        math.radians(keys.path_angle_bias_deg),
        math.radians(keys.heading_bias_deg),
        keys.drag_bias_mps2,
        keys.lift_bias_mps2,
        math.radians(keys.bank_bias_deg),
        math.radians(keys.alpha_bias_deg),
        keys.heat_flux_bias_kwpm2 * 1e3,
    )


def share(dt_s: float, time_s: float) -> float:
    """1 - exp(-dt/time), 1 for a time of zero."""
    return 1.0 if time_s == 0.0 else -math.expm1(-dt_s / time_s)


def latency_reports(mission: Mission) -> int:
    """Latency in whole reports."""
    latency_s = mission.navigation.latency_s
    reports = round(latency_s / mission.dt_s)
    if reports > LATENCY_MAX_REPORTS:
        raise MissionError(
            f"{mission.path.name}: navigation.latency_s is {latency_s:.12g}, allowed up to "
            f"{LATENCY_MAX_REPORTS} reports, {LATENCY_MAX_REPORTS * mission.dt_s:.12g} s"
        )
    return reports


def fill_navigation(record: np.ndarray, mission: Mission) -> None:
    """Writes the NAVIGATION record, shape (1,)."""
    keys, dt_s = mission.navigation, mission.dt_s
    record["has_errors"] = bool(set(keys.errors()) - DROPOUT_KEYS)
    record["sigma"][0], record["bias"][0] = sigmas(keys), biases(keys)
    record["slope"], record["lag_gain"] = 1.0, 1.0
    for signal, slope, lag_s in (
        (DRAG, keys.accel_scale_factor, keys.accel_lag_s),
        (LIFT, keys.accel_scale_factor, keys.accel_lag_s),
        (HEAT_FLUX, keys.heat_flux_scale_factor, keys.heat_flux_lag_s),
    ):
        channel = CHANNELS.index(signal)
        record["slope"][0, channel] = slope
        record["lag_gain"][0, channel] = share(dt_s, lag_s)
    state, accel, attitude, heating = (
        1.0 - share(dt_s, time_s)
        for time_s in (
            keys.state_correlation_s,
            keys.accel_correlation_s,
            keys.attitude_correlation_s,
            keys.heat_flux_correlation_s,
        )
    )
    record["memory"][0] = (state, state, state, accel, attitude, heating)
    pairs = np.append(record["sigma"][0], 0.0).reshape(-1, 2)
    record["noisy"][0] = (pairs > 0.0).any(axis=1)
    record["latency_reports"] = latency_reports(mission)
    record["dropout_ratio"] = keys.dropout_ratio
    record["dropout_reports"] = max(round(keys.dropout_s / dt_s), 1)
    record["dropout_of_message"] = keys.dropout_of == "message"
