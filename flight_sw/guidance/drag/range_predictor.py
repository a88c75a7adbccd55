"""Range control: the rest of the flight is predicted, and the bank shifted until it ends on target.

Not in a source: what [YANHE]'s law lacks. A drag profile cannot be followed where lift does not
suffice, and the range lost then is lost; here the profile is given up and the range kept. The ratio
of sensed to modelled drag comes from the observer of `drag-observer`, that of lift is smoothed. Two
paths that differ a little in bank give the sensitivity; a guidance step takes one step of one of
them, so that a prediction is spread over about a second and no frame is longer than another.

Limits: one degree of freedom, so speed or altitude at the target is what it turns out to be.
"""

import math

from flight_sw.guidance.drag import by_observer as drag_observer
from flight_sw.guidance.drag import prediction
from flight_sw.guidance.drag import tracking as drag_tracking
from flight_sw.guidance.drag.bank_profile import nominal_bank
from flight_sw.guidance.drag.tracking import DRAG_MIN_MPS2
from flight_sw.records import status
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

RATIO_MIN = 0.1  # of sensed to modelled drag: less is not believed

TELEMETRY = (*drag_observer.TELEMETRY, "predicted_error_m", "cos_bank_shift")
PREDICTED_ERROR, COS_SHIFT = len(drag_observer.TELEMETRY), len(drag_observer.TELEMETRY) + 1
PHASES = drag_tracking.PHASES
FIRST_PHASE = dict.fromkeys(TELEMETRY, drag_tracking.TRACKING)

PREDICTOR = RecordSpec(
    "predictor",
    Field("aim", record=prediction.AIM),
    Field("steps_count", 1, 64, "of a path in one guidance step", kind="u4"),
    Field("cos_apart", 1e-6, 0.5, "shift of the second path from the first"),
    Field("gain_ratio", 0.01, 1.0, "share of Newton's step"),
    Field("cos_step_max", 1e-4, 2.0, "largest change of the shift"),
    Field("sensitivity_min_m", 1.0, 1e9, "range per cosine below which the largest step is taken"),
    Field("follow_ratio", 1e-6, 1.0, "share of a change of the shift that a step takes"),
)

DESIGN = RecordSpec(
    "range_predictor",
    Field("tracking", record=drag_tracking.DESIGN),
    Field("watch", record=drag_observer.WATCH),
    Field("predictor", record=PREDICTOR),
)

STATE = RecordSpec(
    "range_predictor_state",
    Field("watch", record=drag_observer.STATE),
    Field("plane", record=prediction.PLANE),
    Field("here", record=prediction.PATH),
    Field("beside", record=prediction.PATH),
    Field("running", kind="u4", why="1 while a pair of paths is under way"),
    Field("updates_count", kind="u4"),
    Field("predicted_error_m", why="target less predicted: short is positive"),
    Field("cos_shift", why="asked for by the last prediction"),
    Field("cos_shift_flown", why="follows it smoothly"),
)


@kernel
def _start_paths(load: Record, state: Record, nav: Record) -> None:
    """Both paths from this fix, with the vehicle as it shows itself now."""
    planet = load["onboard"]["planet"]
    own = state["watch"]["tracking"]
    forces, plane = own["forces"], state["plane"]
    pressure = max(forces["rho_kgpm3"] * nav["v_rel_mps"] * nav["v_rel_mps"], DRAG_MIN_MPS2)
    ratio = max(state["watch"]["observer"]["value"], RATIO_MIN)
    plane["drag_area_m2pkg"] = ratio * forces["drag_mps2"] / pressure
    plane["lift_area_m2pkg"] = own["lift_ratio"] * forces["lift_mps2"] / pressure
    cos_lat = math.cos(nav["lat_rad"])
    spin = planet["rotation_radps"]
    plane["turn_radps"] = 2.0 * spin * cos_lat * math.sin(nav["heading_rad"])
    plane["centrifugal_1ps2"] = spin * spin * cos_lat * cos_lat
    apart = load["law"]["predictor"]["cos_apart"]
    if state["cos_shift"] > 0.0:
        apart = -apart  # away from the limit that is nearer
    prediction.start_path(state["here"], nav, own["range_m"], state["cos_shift"])
    prediction.start_path(state["beside"], nav, own["range_m"], state["cos_shift"] + apart)
    state["running"] = 1


@kernel
def _correct(design: Record, target_m: float, state: Record) -> None:
    """Newton's step on the shift, from where both paths ended."""
    here, beside = state["here"], state["beside"]
    error_m = target_m - here["range_m"]
    state["running"] = 0
    if not math.isfinite(error_m + beside["range_m"]):
        return
    state["predicted_error_m"] = error_m
    state["updates_count"] += 1
    sensitivity_m = (beside["range_m"] - here["range_m"]) / (
        beside["cos_shift"] - here["cos_shift"]
    )
    largest = design["cos_step_max"]
    step = math.copysign(largest, error_m)
    if sensitivity_m > design["sensitivity_min_m"]:
        step = min(max(design["gain_ratio"] * error_m / sensitivity_m, -largest), largest)
    # No further than from one limit to the other, so that it comes back at once.
    profile = design["aim"]["profile"]
    low = design["aim"]["cos_bank_low"] - math.cos(profile["bank_slow_rad"])
    high = design["aim"]["cos_bank_high"] - math.cos(profile["bank_fast_rad"])
    state["cos_shift"] = min(max(state["cos_shift"] + step, low), high)


@kernel
def _predict(load: Record, state: Record, nav: Record) -> None:
    """The next steps of the paths; a pair that has ended corrects the shift."""
    design = load["law"]["predictor"]
    planet, air = load["onboard"]["planet"], load["atmosphere"]
    if state["running"] == 0:
        _start_paths(load, state, nav)
    for _ in range(design["steps_count"]):
        if state["here"]["ended"] == 0:
            prediction.step_path(planet, air, design["aim"], state["plane"], state["here"])
        elif state["beside"]["ended"] == 0:
            prediction.step_path(planet, air, design["aim"], state["plane"], state["beside"])
    if state["here"]["ended"] == 1 and state["beside"]["ended"] == 1:
        _correct(design, load["law"]["tracking"]["ground_track"]["target_m"], state)


@kernel
def step(load: Record, state: Record, nav: Record, out: Record) -> int:
    """One guidance step of law `range-predictor`."""
    law = load["law"]
    design, own = law["tracking"], state["watch"]["tracking"]
    observer = state["watch"]["observer"]
    tracks = drag_tracking.sense(load, design, own, nav)
    drag_observer.observe_ratio(law["watch"], observer, own, nav)
    code = status.OK
    if tracks:
        modelled_mps2 = max(own["forces"]["drag_mps2"], DRAG_MIN_MPS2)
        drag_tracking.take_drag(load, design, own, nav, observer["value"] * modelled_mps2)
        of_ratio = observer["value_rate"] * modelled_mps2
        drag_tracking.take_rate(design, own, nav, own["rate_model_mps3"] + of_ratio)
        _predict(load, state, nav)
        share = law["predictor"]["follow_ratio"]
        state["cos_shift_flown"] += share * (state["cos_shift"] - state["cos_shift_flown"])
        aim = law["predictor"]["aim"]
        nominal_rad = nominal_bank(aim["profile"], nav["v_rel_mps"])
        own["cos_bank_wanted"] = math.cos(nominal_rad) + state["cos_shift_flown"]
        own["cos_bank"] = prediction.shifted_cos_bank(
            aim, nav["v_rel_mps"], state["cos_shift_flown"]
        )
        own["bank_rad"] = math.acos(own["cos_bank"])
        if own["cos_bank"] != own["cos_bank_wanted"]:
            code = status.SATURATED
    drag_tracking.report(design, own, out)
    telemetry = out["telemetry"]
    telemetry[drag_observer.OBSERVED] = observer["value"]
    telemetry[drag_observer.OBSERVED_RATE] = observer["value_rate"]
    telemetry[PREDICTED_ERROR] = state["predicted_error_m"]
    telemetry[COS_SHIFT] = state["cos_shift_flown"]
    return code
