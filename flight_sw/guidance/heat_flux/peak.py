"""The heat-flux peak: told by falling samples, and by more than a few of them where asked for.

As printed in [MOOIJ18] two falling samples are the peak: so are three false ones. By the model's
consent the heat flux that the load expects of this fix, from path angle, speed and sensed drag,
must be at its peak too; or the low-passed heat flux has fallen, which takes seconds, not samples.

Limits: a model whose peak comes late delays it until the low pass is 2 % of the set point down.
"""

import math

from flight_sw.model.atmosphere import log_density_slopes
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

PEAK_BY = ("samples", "model")
BY_SAMPLES, BY_MODEL = 0, 1

FALLING_SAMPLES = 2  # in a row, make a peak
RISE_MAX_1PS = 1e-3  # relative rate that the model may still expect at a peak
SLOW_S = 1.0  # low pass on the heat flux: three false samples move it by a few parts in 1,000
SLOW_DROP_RATIO = 0.02  # of the set point: a low-passed heat flux so far down needs no consent
SLOW_PEAK_RATIO = 1.01  # of its highest: a sample above is no peak
SLOW_OVER_RATIO = 1.03  # of the set point: a sample below it, the low pass above, is no crossing


@kernel
def _expects_fall(onboard: Record, atmosphere: Record, nav: Record, gravity_mps2: float) -> bool:
    """Whether the heat flux k rho^m V^n of the model is at its peak or beyond, at this fix."""
    v_mps = nav["v_rel_mps"]
    heating = onboard["heating"]
    sin_gamma = math.sin(nav["flight_path_angle_rad"])
    slope_pm, _ = log_density_slopes(atmosphere, nav["alt_m"])
    v_rate_mps2 = -nav["drag_mps2"] - gravity_mps2 * sin_gamma
    rate_1ps = heating["rho_exponent"] * slope_pm * v_mps * sin_gamma
    rate_1ps += heating["v_exponent"] * v_rate_mps2 / v_mps
    return rate_1ps <= RISE_MAX_1PS


@kernel
def low_pass(state: Record, q_wpm2: float, dt_s: float) -> None:
    """The heat flux without what single samples do to it, and its highest."""
    if state["heat_flux_slow_peak_wpm2"] == 0.0:
        state["heat_flux_slow_wpm2"] = q_wpm2
    share = dt_s / (SLOW_S + dt_s)
    state["heat_flux_slow_wpm2"] += share * (q_wpm2 - state["heat_flux_slow_wpm2"])
    state["heat_flux_slow_peak_wpm2"] = max(
        state["heat_flux_slow_peak_wpm2"], state["heat_flux_slow_wpm2"]
    )


@kernel
def _is_peak(
    design: Record, onboard: Record, atmosphere: Record, state: Record, nav: Record
) -> bool:
    """Whether falling samples are a peak: alone, by the model's consent, or by a lasting fall."""
    if state["falling"] < FALLING_SAMPLES:
        return False
    if design["peak_by"] == BY_SAMPLES:
        return True
    slow_peak_wpm2 = state["heat_flux_slow_peak_wpm2"]
    fallen_wpm2 = slow_peak_wpm2 - state["heat_flux_slow_wpm2"]
    lasting = fallen_wpm2 >= SLOW_DROP_RATIO * design["heat_flux_max_wpm2"]
    gravity_mps2 = state["forces"]["gravity_mps2"]
    if not lasting and not _expects_fall(onboard, atmosphere, nav, gravity_mps2):
        return False
    state["heat_flux_peak_wpm2"] = min(
        state["heat_flux_peak_wpm2"], SLOW_PEAK_RATIO * slow_peak_wpm2
    )
    return True


@kernel
def passes_peak(
    design: Record, onboard: Record, atmosphere: Record, state: Record, nav: Record, q_wpm2: float
) -> bool:
    """Whether this sample, the second or a later one that falls, lies behind the peak."""
    state["heat_flux_peak_wpm2"] = max(state["heat_flux_peak_wpm2"], q_wpm2)
    floor_wpm2 = design["peak_floor_ratio"] * design["heat_flux_max_wpm2"]
    is_down = q_wpm2 <= state["heat_flux_peak_wpm2"] - design["peak_drop_wpm2"]
    if is_down and q_wpm2 < state["heat_flux_prev_wpm2"] and q_wpm2 >= floor_wpm2:
        state["falling"] += 1
    else:
        state["falling"] = 0
    return _is_peak(design, onboard, atmosphere, state, nav)


@kernel
def crosses_set_point(design: Record, state: Record, q_wpm2: float) -> bool:
    """Whether the heat flux has come down to its set point."""
    set_point_wpm2 = design["heat_flux_max_wpm2"]
    if design["peak_by"] == BY_MODEL:
        over = state["heat_flux_slow_wpm2"] > SLOW_OVER_RATIO * set_point_wpm2
        return q_wpm2 <= set_point_wpm2 and not over
    return q_wpm2 <= set_point_wpm2
