"""Drag tracking with the drag rate from the state: [YANHE] Eq. 14.

The rate of the drag follows from the motion and the load's density slope (Eq. 8): what the vehicle
could only know with exact air. It is the law that `drag-observer` is measured against.
"""

from flight_sw.guidance.drag import tracking as drag_tracking
from flight_sw.records import status
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

TELEMETRY = drag_tracking.TELEMETRY
PHASES = drag_tracking.PHASES
FIRST_PHASE = drag_tracking.FIRST_PHASE

DESIGN = RecordSpec("drag_state", Field("tracking", record=drag_tracking.DESIGN))
STATE = RecordSpec("drag_state_state", Field("tracking", record=drag_tracking.STATE))


@kernel
def step(load: Record, state: Record, nav: Record, out: Record) -> int:
    """One guidance step of law `drag-state`."""
    design = load["law"]["tracking"]
    own = state["tracking"]
    code = status.OK
    if drag_tracking.sense(load, design, own, nav):
        drag_tracking.take_drag(load, design, own, nav, nav["drag_mps2"])
        drag_tracking.take_rate(design, own, nav, own["rate_model_mps3"])
        code = drag_tracking.control(design, own)
    drag_tracking.report(design, own, out)
    return code
