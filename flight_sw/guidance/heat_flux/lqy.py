"""Nominal guidance with the inner loop: output feedback on heat flux and load factor (LQY).

Source: [MOOIJ18] Eqs. 28-32; gains from tools/gains/heat_flux/lqy.py, scheduled over specific
energy. The heat-flux output is taken at the pseudo altitude h* = h + c_gamma V gamma of Eq. 30: its
deviation from the commanded path leads the measured error, without it the loop is a double
integrator.

Limits: bank only; load-factor error one-sided, so the loop never drives the load up to its limit.
"""

import math

from flight_sw.guidance.heat_flux import nominal
from flight_sw.model.onboard import specific_energy
from flight_sw.model.tables import between, locate
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

GAIN_ROWS = 32

TELEMETRY = (*nominal.TELEMETRY, "bank_correction_rad", "heat_flux_error_wpm2")
BANK_CORRECTION, HEAT_FLUX_ERROR = len(nominal.TELEMETRY), len(nominal.TELEMETRY) + 1
PHASES = nominal.PHASES
FIRST_PHASE = {
    **nominal.FIRST_PHASE,
    "bank_correction_rad": nominal.HEAT_FLUX,
    "heat_flux_error_wpm2": nominal.HEAT_FLUX,
}

Gains = tuple[float, float]

INNER_LOOP = RecordSpec(
    "inner_loop",
    Field("n_rows", 2, GAIN_ROWS, "rows in use", kind="u4"),
    Field("energy_jpkg", 0.0, 1e9, "grid", shape=(GAIN_ROWS,), rows="n_rows"),
    Field("k_heat_flux_radm2pw", 0.0, 1.0, "bank per heat-flux error", shape=(GAIN_ROWS,)),
    Field("k_load_radpg", 0.0, 100.0, "bank per load-factor error", shape=(GAIN_ROWS,)),
    Field("lead_s", 0.0, 1e3, "c_gamma of Eq. 30"),
    Field("band_ratio", 0.0, 10.0, "of the set point: no heat-flux tracking beyond it"),
    Field("decay_s", 0.01, 1e3, "Eq. 31"),
    Field("guard_ratio", 0.0, 1.0, "of the set point; above 0: too hot is fed back after release"),
)

DESIGN = RecordSpec(
    "lqy", Field("nominal", record=nominal.DESIGN), Field("inner_loop", record=INNER_LOOP)
)

STATE = RecordSpec(
    "lqy_state",
    Field("nominal", record=nominal.STATE),
    Field("correction_rad"),
    Field("heat_flux_error_wpm2", why="with lead and decay, as fed back"),
)


@kernel
def tracking_weight(design: Record, loop: Record, inner: Record, error_wpm2: float) -> float:
    """Share of the heat-flux error that is fed back: 0 outside the band, Eq. 31 after the release.

    With a guard the share after the release grows from 0 below the set point to 1 on it instead.
    """
    set_point_wpm2 = design["heat_flux_max_wpm2"]
    if inner["released"] == 1 and loop["guard_ratio"] > 0.0:
        return min(max(1.0 + error_wpm2 / (loop["guard_ratio"] * set_point_wpm2), 0.0), 1.0)
    if not abs(error_wpm2) < loop["band_ratio"] * set_point_wpm2:
        return 0.0
    # Eq. 31 as printed runs from 0 to 1; one minus it.
    return 1.0 - nominal.smooth_step(inner["released_s"] / loop["decay_s"])


@kernel
def heat_flux_error(
    design: Record, loop: Record, onboard: Record, inner: Record, nav: Record, q_wpm2: float
) -> float:
    """Heat-flux error with the lead of h* and the decay of Eqs. 31-32; zero outside the band."""
    error_wpm2 = q_wpm2 - design["heat_flux_max_wpm2"]
    weight = tracking_weight(design, loop, inner, error_wpm2)
    if weight == 0.0:
        return 0.0
    lead_m = (
        loop["lead_s"] * nav["v_rel_mps"] * (nav["flight_path_angle_rad"] - inner["gamma_cmd_rad"])
    )
    rho_exponent = onboard["heating"]["rho_exponent"]
    # dq/dh = -m q / Hs for q = k rho^m V^n, of C in [MOOIJ18] Eq. 29, applied to the lead.
    led_wpm2 = error_wpm2 - rho_exponent * q_wpm2 * lead_m / design["scale_height_m"]
    if inner["released"] == 1 and loop["guard_ratio"] > 0.0:
        return max(led_wpm2 * weight, 0.0)
    return led_wpm2 * weight


@kernel
def gains(loop: Record, onboard: Record, nav: Record) -> Gains:
    """Bank per heat-flux error and per load-factor error at the present energy."""
    energy_jpkg = specific_energy(onboard["planet"], nav["alt_m"], nav["v_rel_mps"])
    n_rows = int(loop["n_rows"])
    grid = loop["energy_jpkg"]
    row, share = locate(energy_jpkg, grid, n_rows)
    k_heat_flux = between(loop["k_heat_flux_radm2pw"], row, share)
    k_load = between(loop["k_load_radpg"], row, share)
    return k_heat_flux, k_load


@kernel
def correction(
    design: Record,
    loop: Record,
    onboard: Record,
    state: Record,
    nav: Record,
    q_wpm2: float,
    present_gains: Gains,
) -> float:
    """Bank increment of the inner loop: the larger of the two parallel trackers."""
    inner = state["nominal"]
    k_heat_flux, k_load = present_gains
    error_wpm2 = heat_flux_error(design, loop, onboard, inner, nav, q_wpm2)
    state["heat_flux_error_wpm2"] = error_wpm2
    for_heat_flux_rad = -k_heat_flux * error_wpm2
    for_load_rad = -k_load * max(inner["load_factor_g"] - design["load_factor_max_g"], 0.0)
    if abs(for_load_rad) > abs(for_heat_flux_rad):
        return for_load_rad
    return for_heat_flux_rad


@kernel
def step(load: Record, state: Record, nav: Record, out: Record) -> int:
    """One guidance step of law `lqy`."""
    design = load["law"]
    onboard = load["onboard"]
    inner = state["nominal"]
    q_wpm2 = nav["heat_flux_wpm2"]
    code = nominal.advance(
        design["nominal"],
        onboard,
        load["atmosphere"],
        inner,
        nav,
        q_wpm2,
        load["guidance_dt_s"],
    )
    nominal.report(inner, out)
    if inner["phase"] >= nominal.HEAT_FLUX:
        loop = design["inner_loop"]
        state["correction_rad"] = correction(
            design["nominal"], loop, onboard, state, nav, q_wpm2, gains(loop, onboard, nav)
        )
        out["bank_cmd_rad"] = min(max(inner["bank_rad"] + state["correction_rad"], 0.0), math.pi)
    telemetry = out["telemetry"]
    telemetry[BANK_CORRECTION] = state["correction_rad"]
    telemetry[HEAT_FLUX_ERROR] = state["heat_flux_error_wpm2"]
    return code
