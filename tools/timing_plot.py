"""Histograms of a flight's timing as a picture, a panel a quantity."""

from pathlib import Path
from typing import Any

import numpy as np

from tools.flight_timing import PERCENTILES, FlightTiming, Measured, TimingError

FLOOR_US = 0.1  # what is shorter is drawn here: an axis of decades has no zero
BINS_PER_DECADE = 12
PANEL_HEIGHT_IN, WIDTH_IN, HEAD_IN = 1.9, 8.0, 1.0
DPI = 110
COUNT_FLOOR = 0.7
LINE_STYLES = {"p50": ":", "p99": "--", "p999": "-.", "max": "-"}
BAR_COLOUR, LINE_COLOUR, LIMIT_COLOUR = "#4878a8", "#222222", "#b03030"


def decades(measured: list[Measured], period_us: float) -> tuple[int, int]:
    """Powers of ten that hold all of it and the period."""
    told_us = [quantity.percentiles_us["max"] for quantity in measured]
    longest_us = max([*told_us, period_us, FLOOR_US])
    shortest_us = max(min(quantity.bins_us[0][0] for quantity in measured), FLOOR_US)
    low = int(np.floor(np.log10(shortest_us)))
    return low, max(int(np.ceil(np.log10(longest_us * 1.2))), low + 1)


def _draw(axes: Any, quantity: Measured, edges_us: Any, period_us: float) -> None:
    upper_us = np.maximum([edge_us for edge_us, _ in quantity.bins_us], edges_us[0])
    counts, _ = np.histogram(upper_us, bins=edges_us, weights=[n for _, n in quantity.bins_us])
    axes.bar(
        edges_us[:-1], counts, width=np.diff(edges_us), align="edge", color=BAR_COLOUR, alpha=0.85
    )
    for key, label in PERCENTILES.items():
        value_us = quantity.percentiles_us[key]
        axes.axvline(
            max(value_us, edges_us[0]),
            color=LINE_COLOUR,
            linestyle=LINE_STYLES[key],
            linewidth=1.1,
            label=f"{label} {value_us:z,.1f} us",
        )
    if period_us > 0.0:
        axes.axvline(
            period_us, color=LIMIT_COLOUR, linewidth=1.4, label=f"period {period_us:z,.0f} us"
        )
    axes.set_yscale("log")
    axes.set_ylim(COUNT_FLOOR, max(counts.max(), 1.0) * 3.0)
    axes.set_ylabel("minor frames")
    axes.set_title(quantity.title, loc="left", fontsize=10)
    axes.grid(visible=True, which="major", alpha=0.3)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)


def plot(timing: FlightTiming, period_us: float, title: str, path: Path) -> None:
    """Write the picture; its form is that of the file's ending."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    panels = len(timing.measured)
    figure = Figure(figsize=(WIDTH_IN, HEAD_IN + PANEL_HEIGHT_IN * panels), layout="constrained")
    FigureCanvasAgg(figure)
    all_axes = figure.subplots(panels, 1, sharex=True, squeeze=False)[:, 0]
    low, high = decades(timing.measured, period_us)
    edges_us = np.logspace(low, high, (high - low) * BINS_PER_DECADE + 1)
    for axes, quantity in zip(all_axes, timing.measured, strict=True):
        _draw(axes, quantity, edges_us, period_us)
    all_axes[-1].set_xscale("log")
    all_axes[-1].set_xlim(edges_us[0], edges_us[-1])
    all_axes[-1].set_xlabel("duration, us")
    figure.suptitle(title, fontsize=10)
    try:
        figure.savefig(path, dpi=DPI)
    except (OSError, ValueError) as error:
        raise TimingError(f"--png {path}: cannot be written ({error})") from error
