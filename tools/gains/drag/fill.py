"""Loads of the laws that track a drag profile or predict the range, filled from a design."""

import math
from typing import Any

import numpy as np

from flight_sw.errors import DesignError
from flight_sw.guidance.drag import by_observer as drag_observer
from flight_sw.records.types_ import Record
from sim_harness.mission.mission import Mission
from sim_harness.world.ground_track import fill_ground_track
from tools.gains.drag.choices import DragTracking, NominalFlight, RangePredictor
from tools.gains.drag.nominal_flight import INDEXES, Nominal, Reference, Row, solved
from tools.gains.observer import fill_observer
from tools.gains.rounding import rounded
from tools.gains.schema import CommonDesign, Observer


def share_of(lag_s: float, step_s: float) -> float:
    """Share of a difference that a first-order lag takes in a step; 1 without lag."""
    return -math.expm1(-step_s / lag_s) if lag_s > 0.0 else 1.0


def _controls(record: Record, design: CommonDesign) -> None:
    """Range of the cosine of bank within the command limits, for a positive bank."""
    axis = design.limits.bank
    low, high = max(axis.low_deg, 0.0), min(axis.high_deg, 180.0)
    if not low < high:
        raise DesignError(
            f"limits.bank is {axis.low_deg:g} to {axis.high_deg:g} deg, allowed to reach above 0"
        )
    record["cos_bank_low"] = math.cos(math.radians(high))
    record["cos_bank_high"] = math.cos(math.radians(low))


def _reference(record: Record, rows: list[Row]) -> None:
    n = len(rows)
    record["n_rows"] = n
    for name in Row._fields:
        record[name][:n] = [rounded(getattr(row, name)) for row in rows]


def _told(nominal: Nominal, rows: list[Row]) -> dict[str, Any]:
    """What the provenance tells of the nominal flight."""
    last, log = nominal.flown.log[-1], nominal.flown.log
    miss_m = nominal.flown.miss_m
    return {
        "bank_at_entry_deg": round(nominal.banks_deg[0], 6),
        "bank_at_target_deg": round(nominal.banks_deg[1], 6),
        "flight_time_s": round(float(last["t_s"]), 3),
        "final_flight_path_angle_deg": round(math.degrees(last["flight_path_angle_rad"]), 4),
        "drag_max_mps2": round(float(log["drag_mps2"].max()), 4),
        "load_factor_max_g": round(float(last["load_factor_max_g"]), 4),
        "miss_below_1_m": bool(np.abs(miss_m).max() < 1.0),
        "rows": len(rows),
    }


def fill_tracking(
    record: Record, body: Record, design: CommonDesign, mission: Mission, law: str
) -> dict[str, Any]:
    """Reference, gains and limits; returns what the provenance tells."""
    choice = design.table(DragTracking, "drag", law)
    if float(body["onboard"]["vehicle"]["mass_kg"]) <= 0.0:
        raise DesignError("vehicle.mass_kg is not above 0")
    believed = mission.model_copy(
        update={"entry": mission.entry.model_copy(update={"angle_of_attack_deg": choice.alpha_deg})}
    )
    flight = design.table(NominalFlight, "nominal_flight", law)
    nominal = solved(believed, flight)
    fill_ground_track(record["ground_track"], mission)
    rows = Reference(body, record["ground_track"], nominal, flight).rows()
    _reference(record["reference"], rows)
    record["reference"]["index"] = INDEXES[flight.index]
    fill_profile(record["profile"], nominal)
    record["alpha_rad"] = math.radians(choice.alpha_deg)
    record["active_drag_mps2"] = choice.active_drag_mps2
    record["k_drag_1ps2"] = choice.a / choice.eps0_s**2
    record["k_rate_1ps"] = choice.b / choice.eps0_s
    record["authority_min_mps4"] = choice.authority_min_mps4
    record["uses_sensed_lift"] = choice.lift == "sensed"
    record["lift_share_ratio"] = share_of(choice.lift_lag_s, float(body["guidance_dt_s"]))
    _controls(record, design)
    return {"nominal_flight": _told(nominal, rows)}


def fill_profile(record: Record, nominal: Nominal) -> None:
    """The nominal bank over speed."""
    for name in record.dtype.names or ():
        record[name] = rounded(float(nominal.profile[0][name]))


def fill_watch(record: Record, body: Record, design: CommonDesign, law: str) -> dict[str, Any]:
    """The observer of the drag."""
    choice = design.table(DragTracking, "drag", law)
    observer = design.table(Observer, "drag_observer", law)
    step_s = float(body["guidance_dt_s"])
    told = fill_observer(record["observer"], observer, step_s)
    told["poles_radps"] = [[round(part, 6) for part in pole] for pole in told["poles_radps"]]
    told["rate_noise_1ps"] = rounded(told["rate_noise_1ps"])
    follows = {"error": drag_observer.OBSERVES_ERROR, "ratio": drag_observer.OBSERVES_RATIO}
    record["observes"] = follows[choice.observes]
    record["observed_drag_mps2"] = choice.observed_drag_mps2
    record["uses_estimate"] = choice.takes == "estimate"
    record["knows_flown_bank"] = choice.model == "flown"
    return {"observer": told}


def _fill_predictor(record: Record, body: Record, choice: RangePredictor, mission: Mission) -> None:
    target, tracking = mission.target, body["law"]["tracking"]
    assert target is not None  # without one there is no nominal flight
    aim = record["aim"]
    aim["step_s"] = choice.step_s
    aim["end_speed_mps"] = target.speed_mps if choice.end == "speed or altitude" else 0.0
    aim["end_alt_m"] = target.altitude_km * 1e3
    for name in ("profile", "cos_bank_low", "cos_bank_high"):
        aim[name] = tracking[name]
    if choice.steps_a_frame != int(choice.steps_a_frame):
        raise DesignError(
            f"range_predictor.steps_a_frame is {choice.steps_a_frame:g}, allowed a whole number"
        )
    record["steps_count"] = int(choice.steps_a_frame)
    record["cos_apart"] = choice.cos_apart
    record["gain_ratio"] = choice.gain
    record["cos_step_max"] = choice.cos_step_max
    record["sensitivity_min_m"] = choice.sensitivity_min_km * 1e3
    record["follow_ratio"] = share_of(choice.lag_s, float(body["guidance_dt_s"]))


def fill_drag_state(
    body: Record, design: CommonDesign, mission: Mission, law: str
) -> dict[str, Any]:
    """Law `drag-state`."""
    return fill_tracking(body["law"]["tracking"], body, design, mission, law)


def fill_drag_observer(
    body: Record, design: CommonDesign, mission: Mission, law: str
) -> dict[str, Any]:
    """Law `drag-observer`."""
    told = fill_tracking(body["law"]["tracking"], body, design, mission, law)
    return told | fill_watch(body["law"]["watch"], body, design, law)


def fill_range_predictor(
    body: Record, design: CommonDesign, mission: Mission, law: str
) -> dict[str, Any]:
    """Law `range-predictor`."""
    choice = design.table(RangePredictor, "range_predictor", law)
    told = fill_tracking(body["law"]["tracking"], body, design, mission, law)
    told |= fill_watch(body["law"]["watch"], body, design, law)
    _fill_predictor(body["law"]["predictor"], body, choice, mission)
    return told
