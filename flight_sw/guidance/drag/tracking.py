"""What the laws that follow a drag profile share: reference, activation, control, telemetry.

Source: [YANHE] Eqs. 14 and 24, the reference indexed by Jacobi energy; departures in
docs/laws/drag.md, section 21. Until the sensed drag is enough, the bank of the nominal flight is
held, a straight line over speed.

Limits: magnitude of bank alone, positive; constant angle of attack.
"""

import math

from flight_sw import icd
from flight_sw.guidance.drag.bank_profile import BANK_PROFILE, nominal_bank
from flight_sw.guidance.drag.dynamics import DYNAMICS, drag_dynamics, jacobi_energy
from flight_sw.guidance.drag.reference import BY_ENERGY, BY_SPEED, NOMINAL, REFERENCE, look_up
from flight_sw.model.great_circle import GROUND_TRACK, range_flown
from flight_sw.model.onboard import FORCES, modelled_forces
from flight_sw.records import status
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

WAITING, TRACKING = 0, 1
PHASES = ("waiting", "tracking")

DRAG_MIN_MPS2 = (
    1e-3  # floor of drag and modelled drag in divisions, no effect where a law is active
)
AUTHORITY_MIN_MPS4 = 1e-9  # no control is formed below this authority
COS_WANTED_MAX = 30.0  # of the unlimited control that is told

TELEMETRY = (
    "drag_ref_mps2",
    "drag_error_mps2",
    "drag_rate_mps3",
    "drag_rate_ref_mps3",
    "drag_rate_model_mps3",
    "cos_bank_wanted",
    "energy_jpkg",
    "range_error_m",
)
(DRAG_REF, DRAG_ERROR, DRAG_RATE, RATE_REF, RATE_MODEL, COS_WANTED, ENERGY, RANGE_ERROR) = range(8)

FIRST_PHASE = dict.fromkeys(TELEMETRY, TRACKING)
"""Telemetry that is not formed before a phase; the reference begins where tracking does."""

DESIGN = RecordSpec(
    "drag_tracking",
    Field("reference", record=REFERENCE),
    Field("ground_track", record=GROUND_TRACK),
    Field("alpha_rad", -math.pi, math.pi, "held throughout"),
    Field("profile", record=BANK_PROFILE),
    Field(
        "active_drag_mps2",
        *icd.signal_range("NAV_AERO", "drag_mps2"),
        "sensed drag that starts tracking",
    ),
    Field("k_drag_1ps2", 0.0, 1e6, "a / eps0^2"),
    Field("k_rate_1ps", 0.0, 1e6, "b / eps0"),
    Field("authority_min_mps4", 0.0, 1e3, "floor of |g0| for the feedback; 0: as the source"),
    Field("cos_bank_low", -1.0, 1.0, "control at the largest bank"),
    Field("cos_bank_high", -1.0, 1.0, "control at the smallest bank"),
    Field("uses_sensed_lift", 0, 1, "lift of the model, scaled by what is sensed", kind="u4"),
    Field("lift_share_ratio", 0.0, 1.0, "of a sensed lift ratio taken in a step"),
)

STATE = RecordSpec(
    "drag_tracking_state",
    Field("phase", kind="u4"),
    Field("steps_count", kind="u4", why="since tracking began"),
    Field("energy_jpkg"),
    Field("index_rate", why="of the reference's index, per second"),
    Field("range_m"),
    Field("drag_mps2", why="as the law takes it"),
    Field("drag_rate_mps3", why="as the law takes it"),
    Field("rate_model_mps3", why="from the motion, [YANHE] Eq. 8"),
    Field("drag_error_mps2", why="x1"),
    Field("error_rate_mps3", why="x2"),
    Field("rate_ref_mps3"),
    Field("accel_ref_mps4"),
    Field("lift_ratio", why="sensed lift over the load's, smoothed"),
    Field("lift_started", kind="u4"),
    Field("cos_bank_wanted", why="control before its limits"),
    Field("cos_bank"),
    Field("bank_rad", why="command of this step"),
    Field("forces", record=FORCES),
    Field("nominal", record=NOMINAL),
    Field("dynamics", record=DYNAMICS),
)


@kernel
def _smooth_lift(design: Record, state: Record, nav: Record) -> None:
    """The vehicle's lift over the load's, from what is sensed."""
    modelled = state["forces"]["lift_mps2"]
    if abs(modelled) < DRAG_MIN_MPS2:
        return
    ratio = nav["lift_mps2"] / abs(modelled)
    if not math.isfinite(ratio):
        return  # one that is no number would stay in the average for good
    if state["lift_started"] == 0:
        state["lift_started"] = 1
        state["lift_ratio"] = ratio
    else:
        state["lift_ratio"] += design["lift_share_ratio"] * (ratio - state["lift_ratio"])


@kernel
def sense(load: Record, design: Record, state: Record, nav: Record) -> bool:
    """Where the vehicle stands on the reference, and its modelled forces; True while tracking."""
    planet = load["onboard"]["planet"]
    v_mps = nav["v_rel_mps"]
    modelled_forces(
        load["onboard"], load["atmosphere"], nav["alt_m"], v_mps, design["alpha_rad"],
        state["forces"],
    )  # fmt: skip
    state["energy_jpkg"] = jacobi_energy(planet, nav["alt_m"], nav["lat_rad"], v_mps)
    state["range_m"] = range_flown(
        design["ground_track"], planet["radius_m"], nav["lon_rad"], nav["lat_rad"]
    )
    index = design["reference"]["index"]
    at = nav["t_s"]
    if index == BY_ENERGY:
        at = state["energy_jpkg"]
    elif index == BY_SPEED:
        at = v_mps
    look_up(design["reference"], at, state["nominal"])
    if state["phase"] == WAITING and nav["drag_mps2"] >= design["active_drag_mps2"]:
        state["phase"] = TRACKING
    if state["phase"] == TRACKING:
        state["steps_count"] += 1
        _smooth_lift(design, state, nav)
        return True
    state["bank_rad"] = nominal_bank(design["profile"], v_mps)
    return False


@kernel
def lift_taken(design: Record, state: Record, drag_mps2: float) -> float:
    """Lift that goes with a drag: by the load's ratio of the two, or as sensed."""
    forces = state["forces"]
    lift_mps2 = forces["lift_mps2"]
    if design["uses_sensed_lift"] == 1:
        return lift_mps2 * state["lift_ratio"]
    return lift_mps2 * drag_mps2 / max(forces["drag_mps2"], DRAG_MIN_MPS2)


@kernel
def take_drag(load: Record, design: Record, state: Record, nav: Record, drag_mps2: float) -> None:
    """The dynamics at this drag, and the first derivative of the reference over time."""
    drag = max(drag_mps2, DRAG_MIN_MPS2)
    state["drag_mps2"] = drag
    state["drag_error_mps2"] = drag - state["nominal"]["drag_mps2"]
    dynamics = state["dynamics"]
    drag_dynamics(
        load["onboard"]["planet"], load["atmosphere"], nav, drag,
        lift_taken(design, state, drag), dynamics,
    )  # fmt: skip
    state["rate_model_mps3"] = drag * dynamics["log_rate_1ps"]
    index = design["reference"]["index"]
    state["index_rate"] = 1.0
    if index == BY_ENERGY:
        state["index_rate"] = -nav["v_rel_mps"] * drag
    elif index == BY_SPEED:
        state["index_rate"] = dynamics["speed_rate_mps2"]
    state["rate_ref_mps3"] = state["nominal"]["slope"] * state["index_rate"]


@kernel
def _index_accel(design: Record, state: Record, nav: Record) -> float:
    """Second derivative of the reference's index; that of the speed takes the bank flown."""
    dynamics = state["dynamics"]
    index = design["reference"]["index"]
    if index == BY_ENERGY:
        return -(
            dynamics["speed_rate_mps2"] * state["drag_mps2"]
            + nav["v_rel_mps"] * state["drag_rate_mps3"]
        )
    if index == BY_SPEED:
        lift = dynamics["speed_lift_mps3"] * math.cos(nav["bank_rad"])
        return dynamics["speed_accel_mps3"] + lift
    return 0.0


@kernel
def take_rate(design: Record, state: Record, nav: Record, drag_rate_mps3: float) -> None:
    """The drag rate that the law uses, and the second derivative of the reference over time."""
    nominal = state["nominal"]
    state["drag_rate_mps3"] = drag_rate_mps3
    state["error_rate_mps3"] = drag_rate_mps3 - state["rate_ref_mps3"]
    rate = state["index_rate"]
    state["accel_ref_mps4"] = nominal["bend"] * rate * rate + nominal["slope"] * _index_accel(
        design, state, nav
    )


@kernel
def control(design: Record, state: Record) -> int:
    """Bank that makes the drag error die out, into `state`; a status.  [YANHE] Eqs. 14, 24

    The feedback, not the model's part, is divided by at least `authority_min_mps4`: where little
    lift is left it would turn noise into full commands. Without authority the bank is held.
    """
    dynamics = state["dynamics"]
    authority = dynamics["authority_mps4"]
    if not abs(authority) > AUTHORITY_MIN_MPS4:
        return status.DOMAIN
    feedback = (
        design["k_drag_1ps2"] * state["drag_error_mps2"]
        + design["k_rate_1ps"] * state["error_rate_mps3"]
    )
    floor = math.copysign(max(abs(authority), design["authority_min_mps4"]), authority)
    cos_bank = (state["accel_ref_mps4"] - dynamics["free_mps4"]) / authority - feedback / floor
    if not math.isfinite(cos_bank):
        return status.NONFINITE
    state["cos_bank_wanted"] = cos_bank
    state["cos_bank"] = min(max(cos_bank, design["cos_bank_low"]), design["cos_bank_high"])
    state["bank_rad"] = math.acos(state["cos_bank"])
    return status.OK if state["cos_bank"] == cos_bank else status.SATURATED


@kernel
def accel_flown(load: Record, state: Record, nav: Record) -> float:
    """Second derivative of the drag in the coming step, with the bank that will be flown in it.

    The command moves from the bank flown as fast as its limit allows.
    """
    reach_rad = load["bank_limits"]["rate_max_radps"] * load["guidance_dt_s"]
    flown_rad = abs(nav["bank_rad"])
    bank_rad = min(max(state["bank_rad"], flown_rad - reach_rad), flown_rad + reach_rad)
    dynamics = state["dynamics"]
    return dynamics["free_mps4"] + dynamics["authority_mps4"] * math.cos(bank_rad)


@kernel
def report(design: Record, state: Record, out: Record) -> None:
    """Command, phase and telemetry into `out`."""
    out["bank_cmd_rad"] = state["bank_rad"]
    out["alpha_cmd_rad"] = design["alpha_rad"]
    out["phase"] = state["phase"]
    out["tracking"] = 1 if state["phase"] == TRACKING else 0
    telemetry = out["telemetry"]
    telemetry[DRAG_REF] = state["nominal"]["drag_mps2"]
    telemetry[DRAG_ERROR] = state["drag_error_mps2"]
    telemetry[DRAG_RATE] = state["drag_rate_mps3"]
    telemetry[RATE_REF] = state["rate_ref_mps3"]
    telemetry[RATE_MODEL] = state["rate_model_mps3"]
    telemetry[COS_WANTED] = min(max(state["cos_bank_wanted"], -COS_WANTED_MAX), COS_WANTED_MAX)
    telemetry[ENERGY] = state["energy_jpkg"]
    telemetry[RANGE_ERROR] = state["nominal"]["range_m"] - state["range_m"]
