"""The figures over all flights of one or more campaigns: distributions, scatter, sensitivities."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sim_harness.flight.outcomes import CLASSES, NOMINAL
from sim_harness.mission.dispersion_keys import Requirement
from tools.report.drawing import (
    INK,
    blank,
    colour,
    figure,
    image,
    limit_line,
    marker_of,
    off_panel,
    spread_axis,
    style,
)
from tools.report.source import Source
from tools.report.statistics import F8, Sensitivity, distribution
from tools.report.words import Name, key_name, number

COLUMNS = 3
SHARES = ((0.05, 0.25, 0.5, 0.75, 0.95), ("5 %", "25 %", "50 %", "75 %", "95 %"))
PANEL_IN = 2.35
BARS_MAX = 10  # dispersed keys in one panel, those that matter most
MARKED_MAX = 3000  # flights drawn as vector points; more are drawn as pixels


class Plotted(NamedTuple):
    """A metric to be plotted, and what is required of it."""

    name: Name
    requirements: tuple[Requirement, ...]


def _legend(drawn: Any, axes: Any, sources: Sequence[Source]) -> None:
    if len(sources) > 1:
        handles, labels = axes.get_legend_handles_labels()
        kept = dict(zip(labels, handles, strict=True))
        drawn.legend(kept.values(), kept.keys(), loc="outside upper left", ncols=min(len(kept), 5))


def _near(value: float, values: F8) -> bool:
    """Whether a bound lies where it can be drawn without squeezing what was flown."""
    low, high = float(np.min(values)), float(np.max(values))
    room = 2.0 * max(high - low, 1e-12 * max(abs(low), abs(high), 1.0))
    return low - room <= value <= high + room


def _bounds(requirements: Sequence[Requirement]) -> dict[float, str]:
    found: dict[float, str] = {}
    for requirement in requirements:
        for value, sign in ((requirement.min, "≥"), (requirement.max, "≤")):
            if value is not None and math.isfinite(value):
                found.setdefault(value, f"required {sign} {number(value)}")
    return found


def distributions(sources: Sequence[Source], plotted: Sequence[Plotted]) -> str:
    """The empirical distribution of each metric, the campaigns laid over each other."""
    rows = -(-len(plotted) // COLUMNS)
    with figure(PANEL_IN * rows + 0.3 * (len(sources) > 1), rows, COLUMNS) as (drawn, grid):
        for axes, what in zip(grid.flat, plotted, strict=False):
            whole = []
            for i, source in enumerate(sources):
                x, share = distribution(source.values(what.name.key))
                if len(x):
                    axes.step(
                        x, share, where="post", color=colour(i), linestyle=style(i),
                        linewidth=1.5, label=source.label,
                    )  # fmt: skip
                    whole.append(x)
            spread_axis(axes, "x", what.name.unit)
            for value, text in _bounds(what.requirements).items():
                if whole and _near(value, np.concatenate(whole)):
                    limit_line(axes, value, text, upright=True)
                else:
                    off_panel(axes, f"{text}, off the panel", "bottom")
            axes.set_xlabel(what.name.label)
            axes.set_ylim(-0.02, 1.02)
            axes.set_yticks(*SHARES)
        for axes in grid.flat[len(plotted) :]:
            blank(axes)
        for axes in grid[:, 0]:
            axes.set_ylabel("share of flights")
        _legend(drawn, grid[0, 0], sources)
        return image(drawn)


def differences(sources: Sequence[Source], plotted: Sequence[Plotted]) -> str:
    """The distribution of each metric's difference to the first campaign, flight by flight."""
    first, others = sources[0], sources[1:]
    rows = -(-len(plotted) // COLUMNS)
    with figure(PANEL_IN * rows + 0.3, rows, COLUMNS) as (drawn, grid):
        for axes, what in zip(grid.flat, plotted, strict=False):
            for i, source in enumerate(others, start=1):
                a, b = in_pairs(first, source, what.name.key)
                x, share = distribution(b - a)
                if len(x):
                    axes.step(
                        x, share, where="post", color=colour(i), linestyle=style(i),
                        linewidth=1.5, label=f"{source.label} less {first.label}",
                    )  # fmt: skip
            spread_axis(axes, "x", what.name.unit)
            axes.axvline(0.0, color=INK, linewidth=0.9)
            unit = f", {what.name.unit}" if what.name.unit else ""
            axes.set_xlabel(f"Δ {what.name.title}{unit}")
            axes.set_ylim(-0.02, 1.02)
            axes.set_yticks(*SHARES)
        for axes in grid.flat[len(plotted) :]:
            blank(axes)
        for axes in grid[:, 0]:
            axes.set_ylabel("share of flights")
        _legend(drawn, grid[0, 0], sources)
        return image(drawn)


def in_pairs(first: Source, other: Source, key: str) -> tuple[F8, F8]:
    """A metric of the runs that both campaigns have flown, in the same order."""
    runs, mine, theirs = np.intersect1d(first.runs, other.runs, return_indices=True)
    del runs
    return first.values(key)[mine], other.values(key)[theirs]


def scatter(
    sources: Sequence[Source], pairs: Sequence[tuple[Name, Name]], with_target: bool
) -> str:
    """One metric against another, a point a flight: coloured by class, or by campaign."""
    with figure(3.7, 1, len(pairs)) as (drawn, grid):
        for axes, (across, up) in zip(grid[0], pairs, strict=True):
            for i, source in enumerate(sources):
                x, y = source.values(across.key), source.values(up.key)
                classes = source.classes
                groups = [(source.label, np.full(len(x), True), colour(i), marker_of(i))]
                if len(sources) == 1:
                    named = [NOMINAL, *sorted(set(classes.tolist()) - {NOMINAL}, key=_rank)]
                    groups = [
                        (
                            name,
                            classes == name,
                            colour(k),
                            marker_of(k),
                        )
                        for k, name in enumerate(named)
                    ]
                for label, chosen, shade, marker in groups:
                    there = chosen & np.isfinite(x) & np.isfinite(y)
                    if there.any():
                        axes.plot(
                            x[there], y[there], marker, color=shade, markersize=3.6, alpha=0.65,
                            markeredgewidth=0.0, label=f"{label} ({there.sum():,})",
                            rasterized=len(x) > MARKED_MAX,
                        )  # fmt: skip
            spread_axis(axes, "x", across.unit)
            spread_axis(axes, "y", up.unit)
            if with_target:
                axes.axvline(0.0, color=INK, linewidth=0.9)
                axes.axhline(0.0, color=INK, linewidth=0.9)
            axes.set_xlabel(across.label)
            axes.set_ylabel(up.label)
            axes.legend(loc="best", markerscale=1.4, handletextpad=0.2)
        return image(drawn)


def _rank(name: str) -> int:
    return CLASSES.index(name) if name in CLASSES else len(CLASSES)


def sensitivities(
    sources: Sequence[Source], plotted: Sequence[tuple[Name, list[Sensitivity | None]]]
) -> str:
    """Bars of the rank regression of each metric on the dispersed keys."""
    rows = -(-len(plotted) // COLUMNS)
    keys = max(len(_order(found)) for _, found in plotted)
    bars = min(keys, BARS_MAX) * max(len(sources), 1)
    with figure(rows * (0.75 + 0.17 * max(bars, 3)) + 0.3, rows, COLUMNS) as (drawn, grid):
        for axes, (name, found) in zip(grid.flat, plotted, strict=False):
            _bars(axes, name, found, sources)
        for axes in grid.flat[len(plotted) :]:
            blank(axes)
        _legend(drawn, grid[0, 0], sources)
        return image(drawn)


def _order(found: Sequence[Sensitivity | None]) -> list[str]:
    """Keys by the largest coefficient that any campaign shows, the largest first."""
    size: dict[str, float] = {}
    for one in found:
        for key, value in zip(one.keys, one.coefficients, strict=True) if one else ():
            size[key] = max(size.get(key, 0.0), abs(float(value)))
    return sorted(size, key=lambda key: -size[key])


def short_key(key: str) -> str:
    """The end of a dotted key that says what it is."""
    title = key_name(key).title
    return title.rpartition(".")[2].replace("_", " ")


def _bars(
    axes: Any, name: Name, found: Sequence[Sensitivity | None], sources: Sequence[Source]
) -> None:
    keys = _order(found)
    shown = keys[:BARS_MAX]
    short = [short_key(key) for key in shown]
    names = [
        key_name(key).title if short.count(s) > 1 else s
        for key, s in zip(shown, short, strict=True)
    ]
    height = 0.8 / len(sources)
    for i, one in enumerate(found):
        if one is None:
            continue
        at = [shown.index(key) for key in one.keys if key in shown]
        kept = [key in shown for key in one.keys]
        places = np.array(at) - 0.4 + height * (i + 0.5)
        axes.barh(
            places, one.coefficients[kept], height * 0.9, color=colour(i), alpha=0.85,
            xerr=one.half_widths[kept], error_kw={"elinewidth": 0.9, "ecolor": INK},
            label=sources[i].label,
        )  # fmt: skip
    axes.axvline(0.0, color=INK, linewidth=0.9)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(max(len(names), 3) - 0.4, -0.6)
    axes.set_xlim(-1.1, 1.1)
    axes.grid(visible=False, axis="y")
    told = ", ".join(f"{one.r2:z.2f}" for one in found if one is not None)
    axes.set_title(name.title)
    axes.set_xlabel(f"standard deviations of rank; R² {told}")
