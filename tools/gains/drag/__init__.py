"""Design of the laws that track a drag profile or predict the range."""

from tools.gains.drag.choices import DragTracking, NominalFlight, RangePredictor
from tools.gains.drag.fill import fill_drag_observer, fill_drag_state, fill_range_predictor
from tools.gains.schema import Observer

TABLES = {
    "nominal_flight": (NominalFlight, NominalFlight()),
    "drag": (DragTracking | None, None),
    "drag_observer": (Observer | None, None),
    "range_predictor": (RangePredictor | None, None),
}
"""Tables of a design: type and default."""

FILLERS = {
    "drag-state": fill_drag_state,
    "drag-observer": fill_drag_observer,
    "range-predictor": fill_range_predictor,
}
"""How each law's own record is filled; returns what the provenance reports of the design."""
