"""Fills the body of a load image from a design and the mission it is for."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.guidance import MARKER
from flight_sw.limits import UNLIMITED
from flight_sw.load_image import body_spec
from flight_sw.model.onboard import ALPHA_ROWS, MACH_ROWS
from flight_sw.records.types_ import Record
from sim_harness.mission.aero_keys import SAMPLED_ALPHA_DEG
from sim_harness.mission.mission import Mission
from sim_harness.world.aerodynamics import areas
from sim_harness.world.assembly import world_of
from sim_harness.world.records import AERO_POLYNOMIAL, AERO_TABLE
from tools.gains.design import FAMILIES, Design
from tools.gains.schema import Axis

Filler = Callable[[Record, Design, Mission, str], dict[str, Any]]

AGREEING_CYCLES_MIN = 3  # however long a minor frame is


class Filled(NamedTuple):
    """A body record, shape (1,), and what its provenance tells of the design."""

    body: npt.NDArray[np.void]
    report: dict[str, Any]


def _aero_table(aero: Record, world: Record) -> None:
    """The mission's coefficients as the computer's table: on their own grid, or sampled."""
    truth = world["aerodynamics"]
    if truth["model"] == AERO_POLYNOMIAL:
        aero["is_polynomial"] = 1
        aero["cl_powers"] = truth["lift_powers"].ravel()
        aero["cd_powers"] = truth["drag_powers"].ravel()
    if truth["model"] == AERO_TABLE:
        alphas = np.array(truth["alpha_rad"][: truth["n_alpha"]])
        machs = np.array(truth["mach"][: truth["n_mach"]])
        if alphas.size == 1:
            alphas = np.array([alphas[0], alphas[0] + math.radians(1.0)])
    else:
        alphas = np.radians(SAMPLED_ALPHA_DEG)
        machs = np.zeros(1)
    area_m2 = float(truth["area_m2"])
    lift, drag = np.zeros((ALPHA_ROWS, MACH_ROWS)), np.zeros((ALPHA_ROWS, MACH_ROWS))
    for i, alpha_rad in enumerate(alphas):
        for j, mach in enumerate(machs):
            lift_m2, drag_m2 = areas(truth, float(alpha_rad), float(mach))
            lift[i, j], drag[i, j] = lift_m2 / area_m2, drag_m2 / area_m2
    aero["n_alpha"], aero["n_mach"] = alphas.size, machs.size
    aero["alpha_rad"][: alphas.size] = alphas
    aero["mach"][: machs.size] = machs
    aero["cl"], aero["cd"] = lift.ravel(), drag.ravel()


def fill_onboard(onboard: Record, world: Record) -> None:
    """What the computer believes of planet and vehicle, from a world as it is modelled."""
    planet, heating = world["planet"], world["heating"]
    for name in ("radius_m", "mu_m3ps2", "rotation_radps", "g0_mps2", "j2"):
        onboard["planet"][name] = planet[name]
    onboard["heating"]["coefficient"] = heating["factor_si"]
    onboard["heating"]["rho_exponent"] = heating["density_exponent"]
    onboard["heating"]["v_exponent"] = heating["velocity_exponent"]
    onboard["vehicle"]["mass_kg"] = world["aerodynamics"]["mass_kg"]
    onboard["vehicle"]["reference_area_m2"] = world["aerodynamics"]["area_m2"]
    _aero_table(onboard["vehicle"]["aero"], world)


def _axis(record: Record, axis: Axis) -> None:
    record["low_rad"] = math.radians(axis.low_deg)
    record["high_rad"] = math.radians(axis.high_deg)
    record["rate_max_radps"] = min(math.radians(axis.rate_max_degps), UNLIMITED)
    record["accel_max_radps2"] = min(math.radians(axis.accel_max_degps2), UNLIMITED)


def _common(body: Record, law: str, design: Design, mission: Mission) -> None:
    """Everything of the body that is not the law's."""
    world = world_of(mission)[0]
    dt_s = float(world["dt_s"])
    g0_mps2 = float(world["planet"]["g0_mps2"])
    timing, modes, gates = design.timing, design.modes, design.gates
    body[MARKER + law] = 1
    body["dt_s"] = dt_s
    body["guidance_divider"] = timing.guidance_divider
    body["guidance_dt_s"] = dt_s * timing.guidance_divider
    fill_onboard(body["onboard"], world)
    body["atmosphere"] = world["atmosphere"]
    _axis(body["bank_limits"], design.limits.bank)
    _axis(body["alpha_limits"], design.limits.alpha)
    body["modes"]["entry_load_mps2"] = modes.entry_load_g * g0_mps2
    body["modes"]["terminal_speed_mps"] = modes.terminal_speed_mps
    body["modes"]["nav_timeout_cycles"] = max(round(modes.nav_timeout_s / dt_s), 1)
    body["modes"]["nav_return_cycles"] = max(round(modes.nav_return_s / dt_s), 1)
    body["modes"]["coast_bank_rad"] = math.radians(modes.coast_bank_deg)
    body["modes"]["coast_alpha_rad"] = math.radians(modes.coast_alpha_deg)
    body["gates"]["distance_margin_m"] = gates.distance_margin_m
    body["gates"]["accel_max_mps2"] = gates.accel_max_mps2
    body["gates"]["turn_rate_max_radps"] = math.radians(gates.turn_rate_max_degps)
    body["gates"]["sensed_ratio"] = gates.sensed_ratio
    body["gates"]["sensed_margin_mps2"] = gates.sensed_margin_mps2
    body["gates"]["heat_flux_ratio_ps"] = gates.heat_flux_ratio_ps
    body["gates"]["heat_flux_margin_wpm2"] = gates.heat_flux_margin_kwpm2 * 1e3
    body["gates"]["attitude_margin_rad"] = math.radians(gates.attitude_margin_deg)
    agreeing = round(gates.agreement_s / dt_s)
    body["gates"]["agreeing_cycles"] = max(agreeing, AGREEING_CYCLES_MIN)


def _fillers() -> dict[str, Filler]:
    """How each law's own record is filled, from all families."""
    return {law: filler for family in FAMILIES.values() for law, filler in family.FILLERS.items()}


FILLERS = _fillers()


def fill_body(law: str, design: Design, mission: Mission) -> Filled:
    """The body of the load image of one law; raises DesignError where it cannot be designed."""
    mission = mission.as_modelled()
    body = np.zeros(1, body_spec(law).dtype)
    _common(body[0], law, design, mission)
    return Filled(body, FILLERS[law](body[0], design, mission, law))
