"""How the report's figures look: sizes, colours that colour-blind readers tell apart, SVG."""

import base64
import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tools.spans import widened

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#B38600", "#444444", "#882255")
"""Okabe and Ito's, in an order that tells neighbours apart in grey too."""
STYLES = ("-", "--", "-.", ":")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
LIMIT = "#A00000"
GRID = "#d8dce0"
INK = "#20262c"
BACKED = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
WIDTH_IN = 10.6
SETTINGS: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana"],
    "font.size": 8.5,
    "axes.titlesize": 9.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 8.5,
    "axes.edgecolor": "#7a828a",
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "svg.fonttype": "none",
    "svg.hashsalt": "aeroshell",
    "path.simplify": True,
}


def marker_of(index: int) -> str:
    """The marker of a series."""
    return MARKERS[index % len(MARKERS)]


def colour(index: int) -> str:
    """Of the campaign with this place."""
    return COLOURS[index % len(COLOURS)]


def style(index: int) -> str:
    """Its line, for prints without colour."""
    return STYLES[index % len(STYLES)]


@contextmanager
def figure(height_in: float, rows: int = 1, columns: int = 1) -> Iterator[tuple[Any, Any]]:
    """A figure and its axes as an array, drawn in our style."""
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with mpl.rc_context(SETTINGS):
        drawn = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
        FigureCanvasSVG(drawn)
        yield drawn, drawn.subplots(rows, columns, squeeze=False)


def image(drawn: Any) -> str:
    """The figure as the source of an `img`: nothing is fetched from anywhere."""
    raw = io.BytesIO()
    drawn.savefig(raw, format="svg", metadata={"Date": None, "Creator": None}, dpi=150)
    return "data:image/svg+xml;base64," + base64.b64encode(raw.getvalue()).decode("ascii")


def limit_line(axes: Any, value: float, text: str, *, upright: bool) -> None:
    """A limit, named beside it."""
    draw = axes.axvline if upright else axes.axhline
    draw(value, color=LIMIT, linewidth=1.3, linestyle=(0, (5, 2)), zorder=3)
    if upright:
        axes.annotate(
            text, (value, 0.03), xycoords=("data", "axes fraction"), xytext=(-3, 0),
            textcoords="offset points", rotation=90, ha="right", va="bottom", fontsize=7.5,
            color=LIMIT,
        )  # fmt: skip
    else:
        axes.annotate(
            text, (0.015, value), xycoords=("axes fraction", "data"), xytext=(0, 3),
            textcoords="offset points", fontsize=7.5, color=LIMIT, bbox=BACKED,
        )  # fmt: skip


def off_panel(axes: Any, text: str, at: str = "top") -> None:
    """Say of a limit that lies outside the panel."""
    axes.annotate(
        text, (0.99, 0.99 if at == "top" else 0.02), xycoords="axes fraction", ha="right", va=at,
        fontsize=7.5, color=LIMIT,
    )  # fmt: skip


def spread_axis(axes: Any, which: str, unit: str) -> None:
    """Keep an axis from showing round-off: the least span of its unit, around what is drawn."""
    low, high = axes.dataLim.intervalx if which == "x" else axes.dataLim.intervaly
    if (ends := widened(float(low), float(high), unit)) is not None:
        axes.set(**{f"{which}lim": ends})


def blank(axes: Any) -> None:
    """A place in the grid that has no panel."""
    axes.set_visible(False)
