"""Nominal guidance: bank that keeps rho V^n constant, heat flux first, then load factor.

Source: [MOOIJ18] Eqs. 9-23 with the corrections listed in docs/laws/heat_flux.md. Before the
heat-flux peak bank and the first angle of attack are held; at the peak the second angle of attack
is taken; tracking starts when the heat flux falls through its set point, or at the peak if that is
lower.

Three things beside the source are off unless the design asks for them: forces scaled by what is
sensed over what is modelled, a path-angle loop of its own, a floor under the heat-flux peak.

Limits: one-signed bank (no lateral guidance); exponential density in the path law, with the scale
height of the load; heat flux peak found by two falling samples of the heat flux handed in: sensed
noise wants an estimate of it and a floor. By the source that is all; by the design's choice the
model of the heat flux must be at its peak too, or a low-passed heat flux have fallen.
"""

import math

from flight_sw.guidance.heat_flux.peak import crosses_set_point, low_pass, passes_peak
from flight_sw.model.onboard import FORCES, modelled_forces
from flight_sw.records import status
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

PRE_PEAK, POST_PEAK, HEAT_FLUX, TRANSITION = 0, 1, 2, 3
PHASES = ("pre-peak", "post-peak", "heat-flux", "transition")

Flow = tuple[float, float]  # rho V^n to hold now, and as it is

N_LOAD = 2.0  # rho V^2 is constant on a load limit
LIFT_MIN_MPS2 = 1e-6  # no bank command is formed below this lift
V_MIN_MPS = 1.0  # floor of the speed in divisions, no effect above it
SIN_GAMMA_MAX = 0.99  # a steeper path is asked for only where the law has no meaning
ALPHA_MATCH_RAD = 0.01  # flown and modelled angle of attack closer than this are the same one

TELEMETRY = (
    "bank_nominal_rad",
    "flight_path_angle_cmd_rad",
    "flow_exponent",
    "tracking_constant_ratio",
)
BANK_NOMINAL, GAMMA_CMD, FLOW_EXPONENT, CONSTANT_RATIO = 0, 1, 2, 3

FIRST_PHASE = {"flight_path_angle_cmd_rad": HEAT_FLUX, "tracking_constant_ratio": HEAT_FLUX}
"""Telemetry that is not formed before a phase."""

DESIGN = RecordSpec(
    "nominal",
    Field("heat_flux_max_wpm2", 1e3, 1e9, "set point"),
    Field("load_factor_max_g", 0.1, 1e3, "set point"),
    Field("alpha_before_peak_rad", -math.pi, math.pi, "large: low peak"),
    Field("alpha_after_peak_rad", -math.pi, math.pi, "largest L/D"),
    Field("bank_before_tracking_rad", -math.pi, math.pi, "full lift up"),
    Field("scale_height_m", 1e2, 1e5, "of the path law"),
    Field("k_gamma_p_mps2prad", -1e4, 1e4, "m/s2 per rad, Eq. 17 as printed"),
    Field("k_gamma_i_mps3prad", -1e4, 1e4, "m/s3 per rad"),
    Field("k_gamma_d_mpsprad", -1e4, 1e4, "m/s per rad"),
    Field("k_flow_p_rad", -10.0, 10.0, "Eq. 23"),
    Field("k_flow_d_heat_flux_rads", -10.0, 10.0, "Eq. 23, heat-flux phase"),
    Field("k_flow_d_load_rads", -10.0, 10.0, "Eq. 23, load phase"),
    Field("transition_start_ratio", 0.01, 0.99, "share of the load limit, Eq. 18"),
    Field("transition_duration_s", 0.1, 1e3, "Eq. 21"),
    Field("heat_flux_exponent", 2.01, 100.0, "rho V^n on a heat-flux limit, below Eq. 9: 6"),
    Field("release_exponent", N_LOAD, 100.0, "heat-flux tracking ends below this n"),
    Field("k_gamma_p_1ps", -2e2, 2e2, "times the speed: a path-angle loop with a rate of its own"),
    Field("k_gamma_i_1ps2", -1e2, 1e2, "times the speed"),
    Field("peak_floor_ratio", 0.0, 1.0, "of the set point: no heat-flux peak below it"),
    Field("peak_drop_wpm2", 0.0, 1e9, "below the highest sample: falling samples before are noise"),
    Field("peak_by", 0, 1, "heat_flux_peak.PEAK_BY", kind="u4"),
    Field("peak_scale_exponent", 1.0, 10.0, "of set point over a lower peak, on the constant"),
    Field("adaptation_share_ratio", 0.0, 1.0, "of the error in sensed over modelled, a step"),
    Field("adaptation_load_min_g", 0.0, 10.0, "sensed: nothing is learnt below it"),
    Field("adaptation_max_ratio", 0.0, 0.95, "largest departure from the model"),
)

STATE = RecordSpec(
    "nominal_state",
    Field("phase", kind="u4"),
    Field("falling", kind="u4", why="falling heat-flux samples in a row"),
    Field("heat_flux_prev_wpm2"),
    Field("heat_flux_peak_wpm2"),
    Field("heat_flux_slow_wpm2", why="low-passed, for a peak that the model does not expect"),
    Field("heat_flux_slow_peak_wpm2", why="its highest"),
    Field("tracking_constant", why="rho V^n held, at n of the phase"),
    Field("gamma_integral_rads"),
    Field("gamma_error_prev_rad"),
    Field("gamma_started", kind="u4", why="0 until an error has been seen"),
    Field("gamma_held", kind="u4", why="1: the integral waits"),
    Field("transition_time_s", why="since the transition began"),
    Field("released", kind="u4", why="1 once heat-flux tracking has been given up"),
    Field("released_s", why="time since then"),
    Field("gamma_cmd_rad"),
    Field("flow_exponent", why="n of rho V^n"),
    Field("constant_ratio", why="rho V^n over the constant held"),
    Field("load_factor_g", why="modelled"),
    Field("drag_excess_ratio", why="sensed over modelled, less one, as learnt"),
    Field("lift_excess_ratio", why="sensed over modelled, less one, as learnt"),
    Field("path_bank_rad", why="bank of the path law alone, without Eq. 23"),
    Field("bank_rad", why="command of this step"),
    Field("alpha_rad", why="command of this step"),
    Field("forces", record=FORCES),
)


@kernel
def smooth_step(x: float) -> float:
    """Fifth-order step from 0 to 1, flat to second order at both ends.  [MOOIJ18] before Eq. 18"""
    u = min(max(x, 0.0), 1.0)
    return u * u * u * (u * (6.0 * u - 15.0) + 10.0)


@kernel
def path_angle_command(
    constant: float, n: float, v_mps: float, k_kgpm2: float, g_mps2: float, h_s_m: float
) -> tuple[float, float]:
    """Flight-path angle that keeps rho V^n, and its slope over speed.

    [MOOIJ18] Eq. 12 with V^2 + n g Hs (printed with a minus and an a), Eq. 13 as printed.
    """
    v_n3 = math.pow(v_mps, n - 3.0)
    v_n = v_n3 * v_mps * (v_mps * v_mps + n * g_mps2 * h_s_m)
    sin_gamma = -constant * n * h_s_m / (2.0 * k_kgpm2 * v_n)
    sin_gamma = min(max(sin_gamma, -SIN_GAMMA_MAX), SIN_GAMMA_MAX)
    gamma_rad = math.asin(sin_gamma)
    slope = (
        constant
        * n
        * n
        * h_s_m
        * v_n3
        * (v_mps * v_mps + g_mps2 * h_s_m * (n - 2.0))
        / (2.0 * k_kgpm2 * v_n * v_n * math.cos(gamma_rad))
    )
    return gamma_rad, slope


@kernel
def _start_tracking(design: Record, state: Record, flow_now: float) -> None:
    """Hold rho V^n as it is; a set point above the natural peak scales it.

    By its first power in [MOOIJ18]; exact is one over the density's exponent in the heat flux.
    """
    scale = max(design["heat_flux_max_wpm2"] / state["heat_flux_peak_wpm2"], 1.0)
    state["tracking_constant"] = flow_now * math.pow(scale, design["peak_scale_exponent"])
    state["phase"] = HEAT_FLUX


@kernel
def _schedule(design: Record, state: Record, rho_kgpm3: float, v_mps: float, dt_s: float) -> Flow:
    """Exponent of the phase, into `state`; the constant and the flow.  [MOOIJ18] Eqs. 18-22"""
    n_heat_flux = design["heat_flux_exponent"]
    load_max = design["load_factor_max_g"]
    load_start = design["transition_start_ratio"] * load_max
    if state["phase"] == HEAT_FLUX and state["load_factor_g"] >= load_start:
        state["phase"] = TRANSITION
        state["transition_time_s"] = 0.0
    if state["phase"] != TRANSITION:
        state["flow_exponent"] = n_heat_flux
        return state["tracking_constant"], rho_kgpm3 * math.pow(v_mps, n_heat_flux)
    share = smooth_step((state["load_factor_g"] - load_start) / (load_max - load_start))
    state["flow_exponent"] = n_heat_flux - (n_heat_flux - N_LOAD) * share
    present = rho_kgpm3 * math.pow(v_mps, state["flow_exponent"])
    if state["released"] == 1:
        state["released_s"] += dt_s
    elif state["flow_exponent"] < design["release_exponent"]:
        state["released"] = 1
    # Eq. 22 gathered by terms, one minus its step being the step backwards: the constant of n = 6
    # is 10^12 times that of n = 2, and in the difference as printed the present one is lost.
    left = smooth_step(1.0 - state["transition_time_s"] / design["transition_duration_s"])
    state["transition_time_s"] += dt_s
    return left * state["tracking_constant"] + (1.0 - left) * present, present


@kernel
def integral_gain(design: Record, v_mps: float) -> float:
    """Vertical acceleration per integral of the path-angle error."""
    return design["k_gamma_i_mps3prad"] + v_mps * design["k_gamma_i_1ps2"]


@kernel
def _gamma_correction(
    design: Record, state: Record, gamma_rad: float, v_mps: float, dt_s: float
) -> float:
    """PID on the path angle, an acceleration: read as printed, not times V.  [MOOIJ18] Eq. 17

    Beside it the gains that are times V: a loop whose frequency does not change with speed.
    """
    error_rad = state["gamma_cmd_rad"] - gamma_rad
    rate_radps = 0.0
    if state["gamma_started"] == 1:
        rate_radps = (error_rad - state["gamma_error_prev_rad"]) / dt_s
    state["gamma_started"] = 1
    state["gamma_error_prev_rad"] = error_rad
    if state["gamma_held"] == 0:
        state["gamma_integral_rads"] += error_rad * dt_s
    k_p = design["k_gamma_p_mps2prad"] + v_mps * design["k_gamma_p_1ps"]
    return (
        k_p * error_rad
        + integral_gain(design, v_mps) * state["gamma_integral_rads"]
        + design["k_gamma_d_mpsprad"] * rate_radps
    )


@kernel
def _flow_correction(
    design: Record, state: Record, nav: Record, constant: float, present: float, v_rate_mps2: float
) -> float:
    """PD on rho V^n, in bank.  [MOOIJ18] Eq. 23, its rate taken at frozen n"""
    n = state["flow_exponent"]
    v_mps = nav["v_rel_mps"]
    sin_gamma = math.sin(nav["flight_path_angle_rad"])
    ratio = present / constant
    state["constant_ratio"] = ratio
    rate_ps = ratio * (-v_mps * sin_gamma / design["scale_height_m"] + n * v_rate_mps2 / v_mps)
    n_heat_flux = design["heat_flux_exponent"]
    share = (n_heat_flux - n) / (n_heat_flux - N_LOAD)
    k_d = design["k_flow_d_heat_flux_rads"] + share * (
        design["k_flow_d_load_rads"] - design["k_flow_d_heat_flux_rads"]
    )
    return design["k_flow_p_rad"] * (ratio - 1.0) + k_d * rate_ps


@kernel
def _tracking_bank(
    design: Record, onboard: Record, state: Record, nav: Record, flow: Flow, dt_s: float
) -> tuple[float, int]:
    """Bank that follows the path law, with the PD of [MOOIJ18] Eq. 23, and a status."""
    constant, present = flow
    forces = state["forces"]
    planet = onboard["planet"]
    n = state["flow_exponent"]
    v_mps = nav["v_rel_mps"]
    gamma_rad = nav["flight_path_angle_rad"]
    radius_m = planet["radius_m"] + nav["alt_m"]
    omega_radps = planet["rotation_radps"]
    g_mps2 = forces["gravity_mps2"]
    h_s_m = design["scale_height_m"]
    k_kgpm2 = onboard["vehicle"]["mass_kg"] / forces["drag_area_m2"]
    gamma_cmd_rad, slope = path_angle_command(constant, n, v_mps, k_kgpm2, g_mps2, h_s_m)
    state["gamma_cmd_rad"] = gamma_cmd_rad

    sin_lat = math.sin(nav["lat_rad"])
    cos_lat = math.cos(nav["lat_rad"])
    sin_gc = math.sin(gamma_cmd_rad)
    cos_gc = math.cos(gamma_cmd_rad)
    sin_heading = math.sin(nav["heading_rad"])
    cos_heading = math.cos(nav["heading_rad"])
    # [MOOIJ18] Eq. 1 at the actual path angle, its small centrifugal term left out as in Eq. 11.
    v_rate_mps2 = -forces["drag_mps2"] - g_mps2 * math.sin(gamma_rad)
    # [MOOIJ18] Eq. 15
    other_mps2 = (
        -g_mps2 * cos_gc
        + 2.0 * omega_radps * v_mps * cos_lat * sin_heading
        + v_mps * v_mps / radius_m * cos_gc
        + omega_radps
        * omega_radps
        * radius_m
        * cos_lat
        * (cos_lat * cos_gc + sin_gc * sin_lat * cos_heading)
    )
    # [MOOIJ18] Eq. 16 with the factor V it lacks on the slope; the PID without it (as printed).
    lift_mps2 = max(forces["lift_mps2"], LIFT_MIN_MPS2)
    vertical_mps2 = (
        v_mps * slope * v_rate_mps2
        - other_mps2
        + _gamma_correction(design, state, gamma_rad, v_mps, dt_s)
    )
    code = status.OK
    cos_bank = vertical_mps2 / lift_mps2
    if not abs(cos_bank) <= 1.0:
        code = status.SATURATED
    bank_rad = math.acos(min(max(cos_bank, -1.0), 1.0))
    state["path_bank_rad"] = bank_rad
    bank_rad += _flow_correction(design, state, nav, constant, present, v_rate_mps2)
    return min(max(bank_rad, 0.0), math.pi), code


@kernel
def _learn(design: Record, onboard: Record, state: Record, nav: Record, alpha_rad: float) -> None:
    """Drag and lift as sensed over those of the model, filtered, into `state`.

    Nothing is learnt below a load, nor while another angle of attack is flown than modelled.
    """
    forces = state["forces"]
    drag_mps2 = nav["drag_mps2"]
    lift_mps2 = nav["lift_mps2"]
    floor_mps2 = design["adaptation_load_min_g"] * onboard["planet"]["g0_mps2"]
    modelled_lift_mps2 = abs(forces["lift_mps2"])
    if (
        abs(nav["alpha_rad"] - alpha_rad) > ALPHA_MATCH_RAD
        or drag_mps2 * drag_mps2 + lift_mps2 * lift_mps2 < floor_mps2 * floor_mps2
        or min(forces["drag_mps2"], modelled_lift_mps2) < LIFT_MIN_MPS2
    ):
        return
    share = design["adaptation_share_ratio"]
    most = design["adaptation_max_ratio"]
    drag_excess = min(max(drag_mps2 / forces["drag_mps2"] - 1.0, -most), most)
    lift_excess = min(max(lift_mps2 / modelled_lift_mps2 - 1.0, -most), most)
    state["drag_excess_ratio"] += share * (drag_excess - state["drag_excess_ratio"])
    state["lift_excess_ratio"] += share * (lift_excess - state["lift_excess_ratio"])


@kernel
def _believe(state: Record) -> None:
    """The modelled forces scaled by what has been learnt of them."""
    forces = state["forces"]
    drag_ratio = 1.0 + state["drag_excess_ratio"]
    forces["drag_mps2"] *= drag_ratio
    forces["drag_area_m2"] *= drag_ratio
    forces["lift_mps2"] *= 1.0 + state["lift_excess_ratio"]


@kernel
def advance(
    design: Record,
    onboard: Record,
    atmosphere: Record,
    state: Record,
    nav: Record,
    heat_flux_wpm2: float,
    dt_s: float,
) -> int:
    """One step of the nominal guidance: leaves its command in `state`, returns a status.

    The heat flux is the sensed one or an estimate of it. The forces are the load's model at the
    angle of attack commanded last, scaled by what has been learnt.
    """
    v_mps = nav["v_rel_mps"]
    forces = state["forces"]
    alpha_rad = design["alpha_before_peak_rad"]
    if state["phase"] != PRE_PEAK:
        alpha_rad = design["alpha_after_peak_rad"]
    modelled_forces(onboard, atmosphere, nav["alt_m"], v_mps, alpha_rad, forces)
    if design["adaptation_share_ratio"] > 0.0:
        _learn(design, onboard, state, nav, alpha_rad)
    _believe(state)
    if v_mps < V_MIN_MPS:
        return status.DOMAIN
    rho_kgpm3 = forces["rho_kgpm3"]
    if state["phase"] < HEAT_FLUX:
        before = state["phase"]
        flow_now = rho_kgpm3 * math.pow(v_mps, design["heat_flux_exponent"])
        low_pass(state, heat_flux_wpm2, dt_s)
        if before == PRE_PEAK and passes_peak(
            design, onboard, atmosphere, state, nav, heat_flux_wpm2
        ):
            state["phase"] = POST_PEAK
        if state["phase"] == POST_PEAK and crosses_set_point(design, state, heat_flux_wpm2):
            _start_tracking(design, state, flow_now)
        state["heat_flux_prev_wpm2"] = heat_flux_wpm2
        if before == PRE_PEAK and state["phase"] != PRE_PEAK:
            alpha_rad = design["alpha_after_peak_rad"]
            modelled_forces(onboard, atmosphere, nav["alt_m"], v_mps, alpha_rad, forces)
            _believe(state)
    drag_mps2 = forces["drag_mps2"]
    lift_mps2 = forces["lift_mps2"]
    state["load_factor_g"] = (
        math.sqrt(drag_mps2 * drag_mps2 + lift_mps2 * lift_mps2) / onboard["planet"]["g0_mps2"]
    )
    state["alpha_rad"] = alpha_rad
    if state["phase"] < HEAT_FLUX:
        state["flow_exponent"] = design["heat_flux_exponent"]
        state["bank_rad"] = design["bank_before_tracking_rad"]
        return status.OK
    flow = _schedule(design, state, rho_kgpm3, v_mps, dt_s)
    bank_rad, code = _tracking_bank(design, onboard, state, nav, flow, dt_s)
    state["bank_rad"] = bank_rad
    return code


@kernel
def report(state: Record, out: Record) -> None:
    """Command, phase and telemetry of the nominal guidance into `out`."""
    out["bank_cmd_rad"] = state["bank_rad"]
    out["alpha_cmd_rad"] = state["alpha_rad"]
    out["phase"] = state["phase"]
    out["tracking"] = 1 if state["phase"] >= HEAT_FLUX and state["released"] == 0 else 0
    telemetry = out["telemetry"]
    telemetry[BANK_NOMINAL] = state["bank_rad"]
    telemetry[GAMMA_CMD] = state["gamma_cmd_rad"]
    telemetry[FLOW_EXPONENT] = state["flow_exponent"]
    telemetry[CONSTANT_RATIO] = state["constant_ratio"]


@kernel
def step(load: Record, state: Record, nav: Record, out: Record) -> int:
    """One guidance step of law `nominal`."""
    code = advance(
        load["law"],
        load["onboard"],
        load["atmosphere"],
        state,
        nav,
        nav["heat_flux_wpm2"],
        load["guidance_dt_s"],
    )
    report(state, out)
    return code
