"""The corridor figure: what all flights did over their speed, inside the limits."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from flight_sw.errors import AeroshellError
from sim_harness.mission.mission import Mission
from sim_harness.world.assembly import world_of
from tools.campaign.profiles import Profiles
from tools.report.drawing import INK, LIMIT, colour, figure, image, limit_line, off_panel, style
from tools.report.source import Source
from tools.report.statistics import F8, band
from tools.report.words import number
from tools.review.corridor import (
    DYNAMIC_PRESSURE,
    EQUILIBRIUM,
    HEAT_FLUX,
    LOAD_FACTOR,
    Corridor,
    Flown,
    PathLimits,
    corridor,
)

LOW, MEDIAN, HIGH = 1, 2, 3  # rows of a band
HEAD_ROOM = 1.25  # of a panel above what was flown; limits far above it are named in its title
DASHES: dict[str, Any] = {
    HEAT_FLUX: (0, (5, 2)),
    LOAD_FACTOR: (0, (1, 1.2)),
    DYNAMIC_PRESSURE: (0, (8, 2, 1, 2)),
    EQUILIBRIUM: "-.",
}


class Panel(NamedTuple):
    """One quantity over speed."""

    field: str
    label: str
    factor: float
    limit: float
    limit_key: str
    """Of the mission's limits; in the panel's unit."""


def panels(mission: Mission | None, profiles: Sequence[Profiles]) -> list[Panel]:
    """Drag first; a quantity that is nowhere is left out."""
    limits = mission.limits if mission else None
    flux = limits.heat_flux_max_kwpm2 if limits else math.inf
    load = limits.load_factor_max_g if limits else math.inf
    pressure = limits.dynamic_pressure_max_kpa if limits else math.inf
    wanted = [
        Panel("drag_mps2", "drag, m/s²", 1.0, math.inf, ""),
        Panel("heat_flux_wpm2", "heat flux, kW/m²", 1e-3, flux, "limits.heat_flux_max_kwpm2"),
        Panel("load_factor_g", "load factor, g", 1.0, load, "limits.load_factor_max_g"),
        Panel("alt_m", "altitude, km", 1e-3, math.inf, ""),
        Panel("dynamic_pressure_pa", "dynamic pressure, kPa", 1e-3, pressure,
              "limits.dynamic_pressure_max_kpa"),
    ]  # fmt: skip
    if not math.isfinite(pressure):
        wanted.pop()
    return [p for p in wanted if any((q.fields[p.field] > 0.0).any() for q in profiles)]


def limits_of(mission: Mission, profiles: Profiles) -> Corridor | None:
    """The limits as drag and altitude, for the vehicle that the median flight had."""
    median = {name: band(profiles.fields[name])[MEDIAN] for name in (
        "drag_mps2", "lift_mps2", "dynamic_pressure_pa", "lat_rad", "heading_rad")}  # fmt: skip
    there = np.isfinite(median["drag_mps2"]) & (median["dynamic_pressure_pa"] > 0.0)
    if there.sum() < 2:
        return None
    drag, lift = median["drag_mps2"][there], median["lift_mps2"][there]
    flown = Flown(
        profiles.speed_mps[there],
        drag / median["dynamic_pressure_pa"][there],
        lift / drag,
        median["lat_rad"][there],
        median["heading_rad"][there],
    )
    limits = PathLimits(
        mission.limits.heat_flux_max_kwpm2 * 1e3,
        mission.limits.load_factor_max_g,
        mission.limits.dynamic_pressure_max_kpa * 1e3,
    )
    with np.errstate(all="ignore"):
        return corridor(world_of(mission)[0], limits, flown, 0.0)


def _bands(axes: Any, panel: Panel, sources: Sequence[Source]) -> float:
    """Bands and medians of all campaigns; returns the most that was flown."""
    most = 0.0
    for i, source in enumerate(sources):
        if source.profiles is None:
            continue
        found = band(source.profiles.fields[panel.field]) * panel.factor
        if not np.isfinite(found).any():
            continue
        x = source.profiles.speed_mps / 1e3
        axes.fill_between(x, found[LOW], found[HIGH], color=colour(i), alpha=0.25, linewidth=0.0)
        axes.plot(x, found[MEDIAN], color=colour(i), linestyle=style(i), linewidth=1.5,
                  label=source.label)  # fmt: skip
        for row in (0, -1):
            axes.plot(x, found[row], color=colour(i), linewidth=0.6, alpha=0.8)
        most = max(most, float(np.nanmax(found)))
    return most


def _corridor_lines(axes: Any, lines: dict[str, F8], x: F8, factor: float, top: float) -> None:
    """Limits over speed, each named where it is in sight."""
    for name, line in lines.items():
        y = line * factor
        seen = np.isfinite(y) & (y < 1.3 * top)
        if seen.any():
            shade = INK if name == EQUILIBRIUM else LIMIT
            axes.plot(x, y, color=shade, linestyle=DASHES[name], linewidth=1.2, label=name)


def _named_limit(axes: Any, panel: Panel, source: Source, top: float) -> None:
    """The limit as a line, or as a stripe where the set varies it."""
    varied = source.varied().get(panel.limit_key)
    if varied is not None:
        low, high = float(varied.min()), float(varied.max())
        axes.axhspan(low, high, color=LIMIT, alpha=0.12, linewidth=0.0)
        text = f"limit, varied {number(low)} to {number(high)}"
        axes.annotate(text, (0.015, low), xycoords=("axes fraction", "data"), xytext=(0, 3),
                      textcoords="offset points", fontsize=7.5, color=LIMIT)  # fmt: skip
    elif panel.limit <= 2.0 * top:
        limit_line(axes, panel.limit, f"limit {number(panel.limit)}", upright=False)
    elif math.isfinite(panel.limit):
        off_panel(axes, f"limit {number(panel.limit)}, above")


def draw(sources: Sequence[Source], mission: Mission | None) -> str | None:
    """The figure; None where no campaign has profiles, or its flights were too short for any."""
    having = [source for source in sources if source.profiles is not None]
    profiles = [source.profiles for source in having if source.profiles is not None]
    if not profiles:
        return None
    shown = panels(mission, profiles)
    if not shown:
        return None
    rows = -(-len(shown) // 2)
    lines = limits_of(mission, profiles[0]) if mission else None
    with figure(3.1 * rows, rows, 2) as (drawn, grid):
        for axes, panel in zip(grid.flat, shown, strict=False):
            most = _bands(axes, panel, sources)
            axes.set_ylim(0.0, HEAD_ROOM * most if most > 0.0 else 1.0)
            over = {"drag_mps2": lines.drag_mps2, "alt_m": lines.alt_m} if lines else {}
            if lines and panel.field in over:
                _corridor_lines(axes, dict(over[panel.field]), lines.v_rel_mps / 1e3,
                                panel.factor, most)  # fmt: skip
            if panel.limit_key:
                _named_limit(axes, panel, having[0], most)
                if panel.limit <= 2.0 * most:
                    axes.set_ylim(0.0, max(HEAD_ROOM * most, 1.12 * panel.limit))
            axes.set_xlabel("speed, km/s (time runs to the right)")
            axes.set_ylabel(panel.label)
            axes.invert_xaxis()
            if panel.field in over or len(sources) > 1:
                axes.legend(loc="best")
        for axes in grid.flat[len(shown) :]:
            axes.set_visible(False)
        return image(drawn)


def mission_of_source(source: Source) -> tuple[Mission | None, str]:
    """The mission for its limits, or why it cannot be had."""
    try:
        return source.mission(), ""
    except AeroshellError as error:
        return None, f"limits are not drawn: {error}"
