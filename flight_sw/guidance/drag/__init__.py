"""A drag profile tracked, with the drag rate from state or observer; the range ahead.  [YANHE]"""

from flight_sw.guidance.drag import by_observer, by_state, range_predictor

LAWS = {
    "drag-state": (2, by_state),
    "drag-observer": (3, by_observer),
    "range-predictor": (4, range_predictor),
}
"""By name: the number that FSW_BOOT sends, never used again for another, and the module."""
