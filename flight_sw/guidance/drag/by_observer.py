"""Drag tracking without drag rate: [YANHE] Eq. 24 on the high-gain observer of Eq. 25.

Two forms, chosen in the design. As printed the observer follows the error x1 = D - D*, from the
moment tracking begins. The other follows the sensed drag over the load's: a ratio that constant
errors of density, mass and coefficients leave at rest, so that the observer can be slow enough for
a real accelerometer; it starts before tracking does.

Limits: as `drag_tracking`; a ratio that moves faster than the observer's eps is followed late.
"""

from flight_sw import icd
from flight_sw.estimation import observers
from flight_sw.guidance.drag import tracking as drag_tracking
from flight_sw.guidance.drag.tracking import DRAG_MIN_MPS2
from flight_sw.records import status
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

OBSERVES_ERROR, OBSERVES_RATIO = 0, 1

TELEMETRY = (*drag_tracking.TELEMETRY, "observed_value", "observed_rate")
OBSERVED, OBSERVED_RATE = len(drag_tracking.TELEMETRY), len(drag_tracking.TELEMETRY) + 1
PHASES = drag_tracking.PHASES
FIRST_PHASE = dict.fromkeys(TELEMETRY, drag_tracking.TRACKING)

WATCH = RecordSpec(
    "drag_watch",
    Field("observer", record=observers.DESIGN),
    Field("observes", OBSERVES_ERROR, OBSERVES_RATIO, "what the observer follows", kind="u4"),
    Field(
        "observed_drag_mps2",
        *icd.signal_range("NAV_AERO", "drag_mps2"),
        "sensed drag that starts the observer of the ratio",
    ),
    Field("uses_estimate", 0, 1, "1: estimate, 0: sensed drag in the law", kind="u4"),
    Field("knows_flown_bank", 0, 1, "1: model of the flown bank, 0: Eq. 25b", kind="u4"),
)

DESIGN = RecordSpec(
    "drag_observer",
    Field("tracking", record=drag_tracking.DESIGN),
    Field("watch", record=WATCH),
)

STATE = RecordSpec(
    "drag_observer_state",
    Field("tracking", record=drag_tracking.STATE),
    Field("observer", record=observers.STATE),
)


@kernel
def observe_ratio(watch: Record, observer: Record, tracking: Record, nav: Record) -> None:
    """Follow the sensed drag over the load's, from `observed_drag_mps2` on."""
    sensed_mps2 = nav["drag_mps2"]
    if observer["started"] == 0 and sensed_mps2 < watch["observed_drag_mps2"]:
        return
    modelled_mps2 = max(tracking["forces"]["drag_mps2"], DRAG_MIN_MPS2)
    observers.observe(watch["observer"], observer, nav["t_s"], sensed_mps2 / modelled_mps2)


@kernel
def _step_on_ratio(load: Record, state: Record, nav: Record) -> int:
    """Drag and its rate from the observed ratio and the load's drag at this place and speed."""
    law = load["law"]
    design, watch = law["tracking"], law["watch"]
    own, observer = state["tracking"], state["observer"]
    observe_ratio(watch, observer, own, nav)
    if own["phase"] != drag_tracking.TRACKING:
        return status.OK
    modelled_mps2 = max(own["forces"]["drag_mps2"], DRAG_MIN_MPS2)
    drag_mps2 = nav["drag_mps2"]
    if watch["uses_estimate"] == 1:
        drag_mps2 = observer["value"] * modelled_mps2
    drag_tracking.take_drag(load, design, own, nav, drag_mps2)
    of_ratio = observer["value_rate"] * modelled_mps2
    drag_tracking.take_rate(design, own, nav, own["rate_model_mps3"] + of_ratio)
    return drag_tracking.control(design, own)


@kernel
def _step_on_error(load: Record, state: Record, nav: Record) -> int:
    """[YANHE] Eqs. 24-25: the error is observed, its model is what the control makes of it."""
    law = load["law"]
    design, watch = law["tracking"], law["watch"]
    own, observer = state["tracking"], state["observer"]
    if own["phase"] != drag_tracking.TRACKING:
        return status.OK
    sensed_mps2 = nav["drag_mps2"]
    drag_ref_mps2 = own["nominal"]["drag_mps2"]
    observers.observe(watch["observer"], observer, nav["t_s"], sensed_mps2 - drag_ref_mps2)
    drag_mps2 = sensed_mps2
    if watch["uses_estimate"] == 1:
        drag_mps2 = drag_ref_mps2 + observer["value"]
    drag_tracking.take_drag(load, design, own, nav, drag_mps2)
    drag_tracking.take_rate(design, own, nav, own["rate_ref_mps3"] + observer["value_rate"])
    code = drag_tracking.control(design, own)
    accel_mps4 = -design["k_drag_1ps2"] * (sensed_mps2 - drag_ref_mps2)
    accel_mps4 -= design["k_rate_1ps"] * observer["value_rate"]
    if watch["knows_flown_bank"] == 1:
        accel_mps4 = drag_tracking.accel_flown(load, own, nav) - own["accel_ref_mps4"]
    observers.expect(observer, accel_mps4)
    return code


@kernel
def step(load: Record, state: Record, nav: Record, out: Record) -> int:
    """One guidance step of law `drag-observer`."""
    design = load["law"]["tracking"]
    own = state["tracking"]
    drag_tracking.sense(load, design, own, nav)
    if load["law"]["watch"]["observes"] == OBSERVES_RATIO:
        code = _step_on_ratio(load, state, nav)
    else:
        code = _step_on_error(load, state, nav)
    drag_tracking.report(design, own, out)
    out["telemetry"][OBSERVED] = state["observer"]["value"]
    out["telemetry"][OBSERVED_RATE] = state["observer"]["value_rate"]
    return code
