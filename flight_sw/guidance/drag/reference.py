"""A nominal flight as a table over an index: drag, its slope and bend, and the range flown.

The index is the Jacobi energy; speed and time are there to compare with.

Limits: outside its rows the end rows are held and drag has no slope there.
"""

from flight_sw.model.tables import bracket
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

ROWS = 512
BY_ENERGY, BY_SPEED, BY_TIME = 0, 1, 2

REFERENCE = RecordSpec(
    "drag_reference",
    Field("index", BY_ENERGY, BY_TIME, "what the grid is of", kind="u4"),
    Field("n_rows", 2, ROWS, "rows in use", kind="u4"),
    Field("grid", -1e9, 1e9, "J/kg, m/s or s", shape=(ROWS,), rows="n_rows"),
    Field("drag_mps2", 0.0, 1e4, "nominal", shape=(ROWS,)),
    Field("slope", why="of drag over the index", shape=(ROWS,)),
    Field("bend", why="of drag over the index: second derivative", shape=(ROWS,)),
    Field("range_m", -1e9, 1e9, "flown along the way to the target", shape=(ROWS,)),
)

NOMINAL = RecordSpec(
    "nominal_point",
    Field("drag_mps2"),
    Field("slope"),
    Field("bend"),
    Field("range_m"),
)
"""The table at one value of its index."""


@kernel
def look_up(reference: Record, at: float, out: Record) -> None:
    """Fills `out` (NOMINAL): cubic through values and slopes, linear in bend and range."""
    n = int(reference["n_rows"])
    grid = reference["grid"]
    i = bracket(at, grid, n)
    width = grid[i + 1] - grid[i]
    w = (at - grid[i]) / width
    inside = w >= 0.0 and w <= 1.0
    w = min(max(w, 0.0), 1.0)
    q = 1.0 - w
    drag, slope, bend = reference["drag_mps2"], reference["slope"], reference["bend"]
    along = reference["range_m"]
    # Hermite's cubic: weights of the values, then those of the slopes
    left, right = q * q * (1.0 + 2.0 * w), w * w * (1.0 + 2.0 * q)
    rise, fall = width * q * q * w, width * w * w * q
    out["drag_mps2"] = left * drag[i] + right * drag[i + 1] + rise * slope[i] - fall * slope[i + 1]
    out["slope"] = left * slope[i] + right * slope[i + 1] + rise * bend[i] - fall * bend[i + 1]
    out["bend"] = q * bend[i] + w * bend[i + 1]
    out["range_m"] = q * along[i] + w * along[i + 1]
    if not inside:
        out["slope"] = 0.0
        out["bend"] = 0.0
