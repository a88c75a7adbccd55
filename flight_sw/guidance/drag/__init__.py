"""A drag profile tracked, with the drag rate from state or observer; the range ahead.  [YANHE]"""

from types import ModuleType

from flight_sw.guidance.drag import by_observer, by_state, range_predictor

LAWS: dict[str, ModuleType] = {
    "drag-state": by_state,
    "drag-observer": by_observer,
    "range-predictor": range_predictor,
}
