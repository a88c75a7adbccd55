"""A nominal flight as a table over energy: drag, its slope and bend, and the range flown.

Limits: outside its rows the end rows are held and drag has no slope there.
"""

from flight_sw.fields import Field, RecordSpec
from flight_sw.jit import kernel
from flight_sw.tables import bracket
from flight_sw.types_ import Record

ROWS = 512

REFERENCE = RecordSpec(
    "energy_reference",
    Field("n_rows", 2, ROWS, "rows in use", kind="u4"),
    Field("energy_jpkg", -1e9, 1e9, "grid, Jacobi energy", shape=(ROWS,), rows="n_rows"),
    Field("drag_mps2", 0.0, 1e4, "nominal", shape=(ROWS,)),
    Field("slope_1pm", why="of drag over energy", shape=(ROWS,)),
    Field("bend_s2pm3", why="of drag over energy: second derivative", shape=(ROWS,)),
    Field("range_m", -1e9, 1e9, "flown along the way to the target", shape=(ROWS,)),
)

NOMINAL = RecordSpec(
    "nominal_point",
    Field("drag_mps2"),
    Field("slope_1pm"),
    Field("bend_s2pm3"),
    Field("range_m"),
)
"""The table at one energy."""


@kernel
def look_up(reference: Record, energy_jpkg: float, out: Record) -> None:
    """Fills `out` (NOMINAL): cubic through values and slopes, linear in bend and range."""
    n = int(reference["n_rows"])
    grid = reference["energy_jpkg"]
    i = bracket(energy_jpkg, grid, n)
    width = grid[i + 1] - grid[i]
    w = (energy_jpkg - grid[i]) / width
    inside = w >= 0.0 and w <= 1.0
    w = min(max(w, 0.0), 1.0)
    q = 1.0 - w
    drag, slope, bend = reference["drag_mps2"], reference["slope_1pm"], reference["bend_s2pm3"]
    along = reference["range_m"]
    # Hermite's cubic: weights of the values, then those of the slopes
    left, right = q * q * (1.0 + 2.0 * w), w * w * (1.0 + 2.0 * q)
    rise, fall = width * q * q * w, width * w * w * q
    out["drag_mps2"] = left * drag[i] + right * drag[i + 1] + rise * slope[i] - fall * slope[i + 1]
    out["slope_1pm"] = left * slope[i] + right * slope[i + 1] + rise * bend[i] - fall * bend[i + 1]
    out["bend_s2pm3"] = q * bend[i] + w * bend[i + 1]
    out["range_m"] = q * along[i] + w * along[i + 1]
    if not inside:
        out["slope_1pm"] = 0.0
        out["bend_s2pm3"] = 0.0
