"""Nominal guidance with the outer loop alone: simple adaptive guidance (SAG).

Source: [MOOIJ18] Eqs. 33-41 and Table 3; errors scaled with the gains of the inner loop, the band
and the decay as for the inner loop (lqy.py). What the source leaves out is chosen by the design:
where the error's rate and the heat flux itself come from, what the path-angle integral does while a
tracker is active, and how the tracker's standing correction is handed over when it is released.

Limits: bank only; load-factor error one-sided; no guard against heat after the release.
"""

import math

from flight_sw.estimation import observers
from flight_sw.guidance.heat_flux import lqy, nominal
from flight_sw.guidance.heat_flux.adaptive import (
    DIFFERENCE,
    OBSERVER,
    TRACKER,
    TRACKER_STATE,
    adapted,
    rate_by_difference,
)
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

PHASES = nominal.PHASES
TELEMETRY = (
    *nominal.TELEMETRY,
    "bank_adaptive_rad",
    "adaptive_gain_ratio",
    "heat_flux_used_wpm2",
    "heat_flux_rate_wpm2ps",
    "drag_excess_ratio",
    "lift_excess_ratio",
)
FIRST_PHASE = {
    **nominal.FIRST_PHASE,
    "bank_adaptive_rad": nominal.HEAT_FLUX,
    "adaptive_gain_ratio": nominal.HEAT_FLUX,
}
FIRST = len(nominal.TELEMETRY)
BANK_ADAPTIVE, GAIN, HEAT_FLUX, RATE, DRAG_EXCESS, LIFT_EXCESS = range(FIRST, FIRST + 6)
GAIN_TOLD_MAX = 60e3  # of the signal

TRACKING = RecordSpec(
    "tracking",
    Field("heat_flux", record=TRACKER),
    Field("load", record=TRACKER),
    Field("rate_source", 0, 2, "adaptive.RATES", kind="u4"),
    Field("holds_integral", 0, 1, "the path-angle integral waits for a tracker", kind="u4"),
    Field("hands_over", 0, 1, "the standing correction goes into that integral", kind="u4"),
    Field("observer", record=observers.DESIGN),
)

DESIGN = RecordSpec(
    "sag",
    Field("nominal", record=nominal.DESIGN),
    Field("inner_loop", record=lqy.INNER_LOOP),
    Field("tracking", record=TRACKING),
)

STATE = RecordSpec(
    "sag_state",
    Field("nominal", record=nominal.STATE),
    Field("correction_rad", why="of the inner loop, where there is one"),
    Field("heat_flux_error_wpm2", why="of the inner loop, with lead and decay"),
    Field("adaptive_rad", why="of the outer loop"),
    Field("heat_flux_wpm2", why="sensed, or as the observer has it"),
    Field("heat_flux_rate_wpm2ps", why="sensed path angle and modelled drag, or the observer's"),
    Field("model_rate_wpm2ps"),
    Field("model_started", kind="u4"),
    Field("heat_flux", record=TRACKER_STATE),
    Field("load", record=TRACKER_STATE),
    Field("observer", record=observers.STATE),
)


@kernel
def model_rate(onboard: Record, inner: Record, nav: Record, q_wpm2: float, h_s_m: float) -> float:
    """Rate of q = k rho^m V^n along the flight, density exponential, drag as believed."""
    v_mps = max(nav["v_rel_mps"], nominal.V_MIN_MPS)
    forces = inner["forces"]
    heating = onboard["heating"]
    sin_gamma = math.sin(nav["flight_path_angle_rad"])
    v_rate_mps2 = -forces["drag_mps2"] - forces["gravity_mps2"] * sin_gamma
    return q_wpm2 * (
        heating["v_exponent"] * v_rate_mps2 / v_mps
        - heating["rho_exponent"] * v_mps * sin_gamma / h_s_m
    )


@kernel
def _sense(design: Record, state: Record, nav: Record, dt_s: float) -> int:
    """The heat flux to fly by, into `state`; where it is observed, its fall is the rate's sign."""
    if design["tracking"]["rate_source"] != OBSERVER:
        state["heat_flux_wpm2"] = nav["heat_flux_wpm2"]
        return 0
    observer = state["observer"]
    code = observers.observe(
        design["tracking"]["observer"], observer, nav["t_s"], nav["heat_flux_wpm2"]
    )
    state["heat_flux_wpm2"] = observer["value"]
    # A difference of two estimates holds the noise of a sample, the estimated rate does not.
    state["nominal"]["heat_flux_prev_wpm2"] = observer["value"] - observer["value_rate"] * dt_s
    return code


@kernel
def _expect_rate(load: Record, state: Record, nav: Record) -> None:
    """The model's rate, and where an observer runs, its change as that observer's model."""
    design = load["law"]
    rate = model_rate(
        load["onboard"],
        state["nominal"],
        nav,
        state["heat_flux_wpm2"],
        design["nominal"]["scale_height_m"],
    )
    if design["tracking"]["rate_source"] == OBSERVER:
        change = 0.0
        if state["model_started"] == 1:
            change = rate - state["model_rate_wpm2ps"]
        observers.expect(state["observer"], change / load["guidance_dt_s"])
        state["heat_flux_rate_wpm2ps"] = state["observer"]["value_rate"]
    else:
        state["heat_flux_rate_wpm2ps"] = rate
    state["model_started"] = 1
    state["model_rate_wpm2ps"] = rate


@kernel
def _hand_over(design: Record, state: Record, v_mps: float) -> None:
    """Bank stays where the trackers had it: their correction becomes path-angle integral."""
    inner = state["nominal"]
    gain = nominal.integral_gain(design["nominal"], v_mps)
    if gain == 0.0:
        return
    held_rad = inner["bank_rad"] + state["correction_rad"] + state["adaptive_rad"]
    held_rad = min(max(held_rad, 0.0), math.pi)
    path_rad = inner["path_bank_rad"] + held_rad - inner["bank_rad"]
    path_rad = min(max(path_rad, 0.0), math.pi)
    lift_mps2 = max(inner["forces"]["lift_mps2"], nominal.LIFT_MIN_MPS2)
    inner["gamma_integral_rads"] += (
        (math.cos(path_rad) - math.cos(inner["path_bank_rad"])) * lift_mps2 / gain
    )
    inner["bank_rad"] = held_rad
    inner["released_s"] = design["inner_loop"]["decay_s"]  # nothing is left to fade


@kernel
def prepare(load: Record, state: Record, nav: Record) -> int:
    """Sensing and the nominal guidance of a step, with the hand-over at the release."""
    design = load["law"]
    inner = state["nominal"]
    dt_s = load["guidance_dt_s"]
    _sense(design, state, nav, dt_s)
    q_wpm2 = state["heat_flux_wpm2"]
    released_before = inner["released"]
    if design["tracking"]["holds_integral"] == 1:
        weight = lqy.tracking_weight(
            design["nominal"],
            design["inner_loop"],
            inner,
            q_wpm2 - design["nominal"]["heat_flux_max_wpm2"],
        )
        tracked = inner["phase"] >= nominal.HEAT_FLUX and released_before == 0 and weight > 0.0
        inner["gamma_held"] = 1 if tracked else 0
    code = nominal.advance(
        design["nominal"], load["onboard"], load["atmosphere"], inner, nav, q_wpm2, dt_s
    )
    _expect_rate(load, state, nav)
    if design["tracking"]["hands_over"] == 1 and inner["released"] > released_before:
        _hand_over(design, state, nav["v_rel_mps"])
    return code


@kernel
def adaptive_bank(load: Record, state: Record, gains: lqy.Gains) -> float:
    """Bank increment of the outer loop: the larger of its two parallel trackers."""
    design = load["law"]
    chosen = design["nominal"]
    loop = design["inner_loop"]
    tracking = design["tracking"]
    inner = state["nominal"]
    dt_s = load["guidance_dt_s"]
    k_heat_flux, k_load = gains
    error_wpm2 = state["heat_flux_wpm2"] - chosen["heat_flux_max_wpm2"]
    weight = 0.0
    if inner["released"] == 0 or loop["guard_ratio"] == 0.0:
        weight = lqy.tracking_weight(chosen, loop, inner, error_wpm2)
    # [MOOIJ18] Eq. 39, a scalar: set point minus actual, scaled to bank.
    error_rad = -k_heat_flux * error_wpm2 * weight
    rate_radps = -k_heat_flux * state["heat_flux_rate_wpm2ps"] * weight
    if tracking["rate_source"] == DIFFERENCE:
        rate_radps = rate_by_difference(state["heat_flux"], error_rad, dt_s)
    for_heat_flux_rad = adapted(
        tracking["heat_flux"], state["heat_flux"], error_rad, rate_radps, dt_s
    )
    over_rad = -k_load * max(inner["load_factor_g"] - chosen["load_factor_max_g"], 0.0)
    over_rate_radps = rate_by_difference(state["load"], over_rad, dt_s)
    for_load_rad = adapted(tracking["load"], state["load"], over_rad, over_rate_radps, dt_s)
    if abs(for_load_rad) > abs(for_heat_flux_rad):
        return for_load_rad
    return for_heat_flux_rad


@kernel
def command(state: Record, out: Record) -> None:
    """Bank of nominal guidance and trackers together, and the outer loop's telemetry."""
    inner = state["nominal"]
    bank_rad = inner["bank_rad"]
    if inner["phase"] >= nominal.HEAT_FLUX:
        bank_rad += state["correction_rad"] + state["adaptive_rad"]
        out["bank_cmd_rad"] = min(max(bank_rad, 0.0), math.pi)
    telemetry = out["telemetry"]
    telemetry[BANK_ADAPTIVE] = min(max(state["adaptive_rad"], -math.pi), math.pi)
    telemetry[GAIN] = min(max(state["heat_flux"]["gain_ratio"], 0.0), GAIN_TOLD_MAX)
    telemetry[HEAT_FLUX] = state["heat_flux_wpm2"]
    telemetry[RATE] = state["heat_flux_rate_wpm2ps"]
    telemetry[DRAG_EXCESS] = inner["drag_excess_ratio"]
    telemetry[LIFT_EXCESS] = inner["lift_excess_ratio"]


@kernel
def step(load: Record, state: Record, nav: Record, out: Record) -> int:
    """One guidance step of law `sag`."""
    inner = state["nominal"]
    code = prepare(load, state, nav)
    nominal.report(inner, out)
    if inner["phase"] >= nominal.HEAT_FLUX:
        gains = lqy.gains(load["law"]["inner_loop"], load["onboard"], nav)
        state["adaptive_rad"] = adaptive_bank(load, state, gains)
    command(state, out)
    return code
