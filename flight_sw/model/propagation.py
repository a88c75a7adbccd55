"""A flight ahead along a control profile, with what its end changes by over the profile's knots.

Classical RK4 that lands on every break of the profile and on the end, by the Illinois rule on the
step: between two breaks everything is smooth, so the order stays four through kinks of the bank.
Sensitivities to the values at the bank's knots are integrated beside the motion, [JOSHI] Eqs.
31-35: where the profile runs over energy, the control changes with the state too, and Eq. 33 gains
the terms of that. The excess over a heat-flux limit is integrated squared, with its sensitivities.

One call of `advance` makes one step: a job makes so many of them in a minor frame.

Limits: no wind. A step's landing takes at most LANDINGS_MAX steps more.
"""

import math

import numpy as np

from flight_sw.model.motion import (
    ALPHA,
    BANK,
    LAMBDA,
    MOTION,
    N_STATES,
    PHI,
    PSI,
    RADIUS,
    V,
    motion_partials,
    motion_rates,
)
from flight_sw.model.onboard import heat_flux
from flight_sw.model.profile import (
    KNOTS_MAX,
    index_of,
    index_slopes,
    on_line,
    segment_at,
    weight_of,
)
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel, seldom_kernel

STAGES = 4
LANDINGS_MAX = 12
LANDED_RATIO = 1e-13  # of the index' unit, or of the altitude in 1e6 m: nearer is there
POLE_RATIO = 0.2  # of the way to a pole's axis: no step is longer
POLE_STEP_S = 1e-5  # nor shorter for the sake of a pole: a plan goes by one at a metre
GOING, ENDED, FAILED = 0, 1, 2
TO_NOTHING, TO_BREAK, TO_END = 0, 1, 2

PATH = np.dtype(
    [
        ("x", "f8", (N_STATES,)),  # motion.STATES
        ("t_s", "f8"),
        ("next_break", "i8"),
        ("bank_segment", "i8"),
        ("alpha_segment", "i8"),
        ("by_knot", "f8", (N_STATES, KNOTS_MAX)),  # of the state by the bank at each knot
        ("excess", "f8"),  # integral of the squared excess of heat flux over its limit
        ("excess_by_knot", "f8", (KNOTS_MAX,)),
        ("heat_flux_peak_wpm2", "f8"),
        ("steps", "i8"),
    ],
    align=True,
)
"""Where a flight ahead stands."""

CONDITIONS = np.dtype(
    [
        ("step_s", "f8"),
        ("end_alt_m", "f8"),  # the flight ends when it comes down to it
        ("heat_flux_limit_wpm2", "f8"),  # of the excess
        ("heat_flux_unit_wpm2", "f8"),  # in which the excess is squared
        ("has_sensitivities", "u4"),
    ],
    align=True,
)
"""How it is integrated and where it ends."""

WORK = np.dtype(
    [
        ("x", "f8", (N_STATES,)),  # of a stage, then of the end of a step
        ("by_knot", "f8", (N_STATES, KNOTS_MAX)),
        ("excess", "f8"),
        ("excess_by_knot", "f8", (KNOTS_MAX,)),
        ("x_rate", "f8", (STAGES, N_STATES)),
        ("by_knot_rate", "f8", (STAGES, N_STATES, KNOTS_MAX)),
        ("excess_rate", "f8", (STAGES,)),
        ("excess_by_knot_rate", "f8", (STAGES, KNOTS_MAX)),
        ("slopes", "f8", (N_STATES,)),
        ("motion", MOTION),
    ],
    align=True,
)
"""Room for the stages of a step: the caller's, so that nothing is allocated."""


@seldom_kernel
def begin(path: Record, profile: Record, planet: Record, x: F8, t_s: float) -> None:
    """Puts a path to its start: state of shape (6,), no sensitivity, the first segments."""
    for i in range(N_STATES):
        path["x"][i] = x[i]
        for k in range(KNOTS_MAX):
            path["by_knot"][i, k] = 0.0
    for k in range(KNOTS_MAX):
        path["excess_by_knot"][k] = 0.0
    path["excess"] = 0.0
    path["heat_flux_peak_wpm2"] = 0.0
    path["t_s"] = t_s
    path["steps"] = 0
    index = index_of(profile, planet, path["x"], t_s)
    _enter_segments(path, profile, index)
    path["next_break"] = 0
    for i in range(np.int64(profile["n_breaks"])):
        if profile["breaks"][i] <= index:
            path["next_break"] = i + 1


@kernel
def _enter_segments(path: Record, profile: Record, index: float) -> None:
    path["bank_segment"] = segment_at(profile["bank_index"], np.int64(profile["n_bank"]), index)
    path["alpha_segment"] = segment_at(profile["alpha_index"], np.int64(profile["n_alpha"]), index)


@seldom_kernel
def controls_of(path: Record, profile: Record, index: float) -> tuple[float, float, float, float]:
    """Angle of attack and bank on the path's segments at an index, and their slopes over it."""
    n_alpha, n_bank = np.int64(profile["n_alpha"]), np.int64(profile["n_bank"])
    alpha, alpha_slope = on_line(
        profile["alpha_index"], profile["alpha_rad"], n_alpha, path["alpha_segment"], index
    )
    bank, bank_slope = on_line(
        profile["bank_index"], profile["bank_rad"], n_bank, path["bank_segment"], index
    )
    return alpha, bank, alpha_slope, bank_slope


@seldom_kernel
def _sensitivity_rates(
    onboard: Record, profile: Record, path: Record, work: Record, stage: int, index: float
) -> None:
    """Rates of `by_knot` at a stage: the partials already stand in `work`."""
    motion = work["motion"]
    index_slopes(profile, onboard["planet"], work["x"], motion, work["slopes"])
    _, _, alpha_slope, bank_slope = controls_of(path, profile, index)
    a, b = motion["by_state"], motion["by_control"]
    n_bank = np.int64(profile["n_bank"])
    for k in range(n_bank):
        by_index = 0.0
        for j in range(N_STATES):
            by_index += work["slopes"][j] * work["by_knot"][j, k]
        bank = bank_slope * by_index + weight_of(
            profile["bank_index"], n_bank, path["bank_segment"], index, k
        )
        alpha = alpha_slope * by_index
        for i in range(N_STATES):
            total = b[i, ALPHA] * alpha + b[i, BANK] * bank
            for j in range(N_STATES):
                total += a[i, j] * work["by_knot"][j, k]
            work["by_knot_rate"][stage, i, k] = total


@seldom_kernel
def _excess_rates(
    onboard: Record, conditions: Record, profile: Record, work: Record, stage: int
) -> None:
    """Rates of the squared excess of heat flux and of its sensitivities at a stage."""
    forces = work["motion"]["forces"]
    v = work["x"][V]
    flux = heat_flux(onboard, forces["rho_kgpm3"], v)
    excess = max(flux - conditions["heat_flux_limit_wpm2"], 0.0) / conditions["heat_flux_unit_wpm2"]
    work["excess_rate"][stage] = excess * excess
    if conditions["has_sensitivities"] == 0:
        return
    heating = onboard["heating"]
    twice = 2.0 * excess * flux / conditions["heat_flux_unit_wpm2"]
    by_v = twice * heating["v_exponent"] / max(v, 1.0)
    by_radius = twice * heating["rho_exponent"] * forces["rho_slope_1pm"]
    for k in range(np.int64(profile["n_bank"])):
        work["excess_by_knot_rate"][stage, k] = (
            by_v * work["by_knot"][V, k] + by_radius * work["by_knot"][RADIUS, k]
        )


@seldom_kernel
def _stage(
    onboard: Record, atmosphere: Record, profile: Record, conditions: Record, path: Record,
    work: Record, stage: int, t_s: float,
) -> None:  # fmt: skip
    """All rates at the state that stands in `work`."""
    x = work["x"]
    index = index_of(profile, onboard["planet"], x, t_s)
    alpha, bank, _, _ = controls_of(path, profile, index)
    if conditions["has_sensitivities"] == 1:
        motion_partials(onboard, atmosphere, x, alpha, bank, work["motion"])
        _sensitivity_rates(onboard, profile, path, work, stage, index)
    else:
        motion_rates(onboard, atmosphere, x, alpha, bank, work["motion"])
    for i in range(N_STATES):
        work["x_rate"][stage, i] = work["motion"]["rate"][i]
    _excess_rates(onboard, conditions, profile, work, stage)


@seldom_kernel
def _put(path: Record, work: Record, step_s: float, stage: int, with_sensitivities: bool) -> None:
    """The path's start plus a step along one stage's rates, into `work`."""
    for i in range(N_STATES):
        work["x"][i] = path["x"][i] + step_s * work["x_rate"][stage, i]
    if with_sensitivities:
        for i in range(N_STATES):
            for k in range(KNOTS_MAX):
                work["by_knot"][i, k] = (
                    path["by_knot"][i, k] + step_s * work["by_knot_rate"][stage, i, k]
                )


@seldom_kernel
def _rk4(
    onboard: Record, atmosphere: Record, profile: Record, conditions: Record, path: Record,
    work: Record, step_s: float,
) -> None:  # fmt: skip
    """The end of a step from where the path stands, left in `work`; the path stays."""
    sensed = conditions["has_sensitivities"] == 1
    t_s = path["t_s"]
    _put(path, work, 0.0, 0, sensed)
    _stage(onboard, atmosphere, profile, conditions, path, work, 0, t_s)
    _put(path, work, 0.5 * step_s, 0, sensed)
    _stage(onboard, atmosphere, profile, conditions, path, work, 1, t_s + 0.5 * step_s)
    _put(path, work, 0.5 * step_s, 1, sensed)
    _stage(onboard, atmosphere, profile, conditions, path, work, 2, t_s + 0.5 * step_s)
    _put(path, work, step_s, 2, sensed)
    _stage(onboard, atmosphere, profile, conditions, path, work, 3, t_s + step_s)
    sixth = step_s / 6.0
    rate = work["x_rate"]
    for i in range(N_STATES):
        work["x"][i] = path["x"][i] + sixth * (
            rate[0, i] + 2.0 * (rate[1, i] + rate[2, i]) + rate[3, i]
        )
    e = work["excess_rate"]
    work["excess"] = path["excess"] + sixth * (e[0] + 2.0 * (e[1] + e[2]) + e[3])
    if sensed:
        _sum_sensitivities(path, work, sixth)


@kernel
def _sum_sensitivities(path: Record, work: Record, sixth: float) -> None:
    rate = work["by_knot_rate"]
    e = work["excess_by_knot_rate"]
    for k in range(KNOTS_MAX):
        for i in range(N_STATES):
            work["by_knot"][i, k] = path["by_knot"][i, k] + sixth * (
                rate[0, i, k] + 2.0 * (rate[1, i, k] + rate[2, i, k]) + rate[3, i, k]
            )
        work["excess_by_knot"][k] = path["excess_by_knot"][k] + sixth * (
            e[0, k] + 2.0 * (e[1, k] + e[2, k]) + e[3, k]
        )


@seldom_kernel
def _beyond(
    profile: Record, conditions: Record, planet: Record, path: Record, work: Record, step_s: float,
    what: int,
) -> float:  # fmt: skip
    """How far the end of a step lies beyond the next break, or below the end, if above 0."""
    if what == TO_BREAK:
        at = index_of(profile, planet, work["x"], path["t_s"] + step_s)
        return at - profile["breaks"][path["next_break"]]
    return (conditions["end_alt_m"] - (work["x"][RADIUS] - planet["radius_m"])) * 1e-6


@seldom_kernel
def _land(
    onboard: Record, atmosphere: Record, profile: Record, conditions: Record, path: Record,
    work: Record, step_s: float, what: int,
) -> float:  # fmt: skip
    """The step that ends just there, by the Illinois rule; its end stands in `work`."""
    planet = onboard["planet"]
    low, high = 0.0, step_s
    at_high = _beyond(profile, conditions, planet, path, work, high, what)
    _put(path, work, 0.0, 0, False)
    at_low = _beyond(profile, conditions, planet, path, work, low, what)
    now = high
    side = 0
    for _ in range(LANDINGS_MAX):
        if not at_high > at_low:
            break
        now = (low * at_high - high * at_low) / (at_high - at_low)
        _rk4(onboard, atmosphere, profile, conditions, path, work, now)
        at_now = _beyond(profile, conditions, planet, path, work, now, what)
        if abs(at_now) <= LANDED_RATIO:
            break
        if at_now > 0.0:
            high, at_high = now, at_now
            at_low = 0.5 * at_low if side > 0 else at_low
            side = 1
        else:
            low, at_low = now, at_now
            at_high = 0.5 * at_high if side < 0 else at_high
            side = -1
    return now


@kernel
def _step(conditions: Record, path: Record) -> float:
    """The length of a step: shorter near a pole, where latitude and longitude turn fast."""
    x = path["x"]
    from_axis_s = x[RADIUS] * math.cos(x[PHI]) / max(x[V], 1.0)
    return max(
        min(conditions["step_s"], POLE_RATIO * from_axis_s), min(POLE_STEP_S, conditions["step_s"])
    )


@seldom_kernel
def advance(
    onboard: Record, atmosphere: Record, profile: Record, conditions: Record, path: Record,
    work: Record,
) -> int:  # fmt: skip
    """One step of the path: to `step_s` ahead (less near a pole), or to a break or the end before.

    Returns GOING, ENDED (it stands on the end) or FAILED (a value is no longer finite: the path
    stays where it was).
    """
    planet = onboard["planet"]
    step_s = _step(conditions, path)
    _rk4(onboard, atmosphere, profile, conditions, path, work, step_s)
    lands_on = TO_NOTHING
    if path["next_break"] < np.int64(profile["n_breaks"]):
        if _beyond(profile, conditions, planet, path, work, step_s, TO_BREAK) > 0.0:
            lands_on = TO_BREAK
            step_s = _land(onboard, atmosphere, profile, conditions, path, work, step_s, TO_BREAK)
    if _beyond(profile, conditions, planet, path, work, step_s, TO_END) > 0.0:
        lands_on = TO_END
        step_s = _land(onboard, atmosphere, profile, conditions, path, work, step_s, TO_END)
    total = work["excess"]
    for i in range(N_STATES):
        total += work["x"][i]
    if not math.isfinite(total) or work["x"][V] <= 0.0:
        return FAILED
    _commit(onboard, profile, conditions, path, work, step_s)
    if lands_on == TO_BREAK:
        _enter_segments(path, profile, profile["breaks"][path["next_break"]])
        path["next_break"] += 1
    return ENDED if lands_on == TO_END else GOING


@seldom_kernel
def _commit(
    onboard: Record, profile: Record, conditions: Record, path: Record, work: Record, step_s: float
) -> None:
    """The end of the step becomes where the path stands."""
    forces = work["motion"]["forces"]
    flux = heat_flux(onboard, forces["rho_kgpm3"], work["x"][V])
    path["heat_flux_peak_wpm2"] = max(path["heat_flux_peak_wpm2"], flux)
    path["t_s"] += step_s
    path["steps"] += 1
    path["excess"] = work["excess"]
    for i in range(N_STATES):
        path["x"][i] = work["x"][i]
    if conditions["has_sensitivities"] == 1:
        for k in range(np.int64(profile["n_bank"])):
            path["excess_by_knot"][k] = work["excess_by_knot"][k]
            for i in range(N_STATES):
                path["by_knot"][i, k] = work["by_knot"][i, k]
    if abs(path["x"][PHI]) > 0.5 * math.pi:
        _turn_over(path)


@kernel
def _turn_over(path: Record) -> None:
    """A latitude beyond a pole: the same place on the meridian opposite."""
    x = path["x"]
    x[PHI] = math.copysign(math.pi, x[PHI]) - x[PHI]
    x[LAMBDA] += math.pi
    x[PSI] += math.pi
    for k in range(KNOTS_MAX):
        path["by_knot"][PHI, k] = -path["by_knot"][PHI, k]
