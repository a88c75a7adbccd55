"""Fills the stage: lines over time, charts over speed, states, log, and the sheet of facts."""

from collections.abc import Collection

import numpy as np
import numpy.typing as npt

from tools.flight_facts import named, phases_of
from tools.review import columns
from tools.review.chart import Chart, Look, Scale
from tools.review.corridor import UPPER, Corridor, corridor, flown_by_speed
from tools.review.palette import LIMIT, SATURATED, SOFT_LIMITS, Palette, mixed
from tools.review.panels import GUIDANCE, LIMIT_UNITS, SATURATION, Panel
from tools.review.signals import shown
from tools.review.source import FlightData
from tools.review.stage import Stage, part

F8 = npt.NDArray[np.float64]

MARGIN_HZ, MARGIN_STROKES = 2.0, 800  # strokes of the shade: a second, and at least in a flight
MARGIN_STEP_S = 1e-3  # from the lower end of a stroke to its upper end
NAMED_AT = (0.88, 0.8, 0.72, 0.64, 0.56, 0.48)  # along a flight's line in a chart
BENEATH = "as_"  # of an entity: Rerun draws them in the order of their names
WIDEST, WIDE, THIN = 6.0, 3.6, 1.5
"""Planned, commanded and flown: what lies beneath shows on both sides of what lies above."""
PLANNED_NAMED_AT = 0.3  # along its line
DRAG_CHART, ALTITUDE_CHART = "charts/drag", "charts/altitude"


def draw_panel(stage: Stage, panel: Panel, flight: FlightData, look: Palette) -> bool:
    """The lines of a panel for one flight; False where it holds none."""
    any_line, spare = False, 0
    for line in panel.lines:
        t_s, values = columns.column(flight, line.message, line.field)
        if not len(t_s):
            continue
        any_line = True
        if line.is_flown:
            colour = look.flown
        elif line.is_commanded:
            colour = look.commanded
        else:
            colour, spare = look.other(spare), spare + 1
        name = line.name if look.is_alone else f"{flight.label}: {line.name}"
        is_beneath = line.is_commanded or (panel.tab == GUIDANCE and not line.is_flown)
        wide = is_beneath and look.is_alone and panel.lines[-1].is_flown
        is_behind = wide and part(line.name) > part(panel.lines[-1].name)
        path = f"{panel.path}/{part(flight.label)}/{BENEATH if is_behind else ''}{part(line.name)}"
        stage.line_style(path, name, colour, WIDE if wide else THIN)
        stage.scalars(path, t_s, values * shown(line.field).factor)
    any_line |= _draw_planned(stage, panel, flight, look)
    if panel.path in SATURATION:
        _draw_saturation(stage, panel, flight, look)
    if panel.limit and any_line:
        _draw_margin(stage, panel, flight, look)
    return any_line


def planned_of(panel: Panel, flight: FlightData) -> list[columns.Planned]:
    """What was planned of what a panel shows as flown; telemetry has panels of its own."""
    flown = [line.field for line in panel.lines if line.is_flown and panel.tab != GUIDANCE]
    return [found for field in flown for found in columns.planned(flight, field)]


def flown_factor(panel: Panel) -> float:
    """From SI to the unit of what a panel shows as flown."""
    return next(shown(line.field).factor for line in panel.lines if line.is_flown)


def _draw_planned(stage: Stage, panel: Panel, flight: FlightData, look: Palette) -> bool:
    found = planned_of(panel, flight)
    for number, (name, t_s, values) in enumerate(found):
        path = f"{panel.path}/{part(flight.label)}/{BENEATH}{part(name)}"
        title = name if look.is_alone else f"{flight.label}: {name}"
        stage.line_style(path, title, look.plan_of(number), WIDEST if look.is_alone else WIDE)
        stage.scalars(path, t_s, values * flown_factor(panel))
    return bool(found)


def limit_of(panel: Panel, flight: FlightData) -> float:
    """A panel's limit in the unit shown; infinite where there is none."""
    field = LIMIT_UNITS[panel.limit]
    return float(getattr(flight.limits, field)) * shown(field).factor


def _draw_saturation(stage: Stage, panel: Panel, flight: FlightData, look: Palette) -> None:
    flag, axis = SATURATION[panel.path]
    t_s, values = columns.saturated(flight, flag, axis)
    if len(t_s):
        path = f"{panel.path}/{part(flight.label)}/saturated"
        name = "saturated" if look.is_alone else f"{flight.label}: saturated"
        colour = SATURATED if look.is_alone else mixed(SATURATED, look.flown, 0.5)
        stage.dot_style(path, name, colour)
        stage.scalars(path, t_s, values * shown(f"{axis}_rad").factor)


def _draw_margin(stage: Stage, panel: Panel, flight: FlightData, look: Palette) -> None:
    """The limit, and for a flight alone the room below it: a zigzag line, so dense that it is a
    shade."""
    limit = limit_of(panel, flight)
    is_known = (panel.path, limit) in stage.drawn and not stage.is_live
    if not np.isfinite(limit) or is_known:
        return
    stage.drawn.add((panel.path, limit))
    t_s, values = columns.column(flight, "", LIMIT_UNITS[panel.limit])
    values = values * shown(LIMIT_UNITS[panel.limit]).factor
    path = f"{panel.path}/{part(flight.label)}"
    suffix = "" if look.is_alone else f", {flight.label}"
    stage.line_style(f"{path}/limit", f"limit{suffix}", LIMIT, 1.4)
    stage.scalars(f"{path}/limit", t_s[[0, -1]], np.full(2, limit))
    if not look.is_alone:
        return
    least = 0 if stage.is_live else MARGIN_STROKES
    strokes = max(int((t_s[-1] - t_s[0]) * MARGIN_HZ), least, 1) + 1
    at_s = np.linspace(t_s[0], t_s[-1], strokes)
    flown = np.minimum(np.interp(at_s, t_s, values), limit)
    shade = np.stack([flown, np.full_like(flown, limit)], axis=-1).ravel()
    step_s = min(MARGIN_STEP_S, (at_s[-1] - at_s[0]) / (2 * strokes))
    times = np.repeat(at_s, 2) + np.tile([0.0, step_s], strokes)
    stage.line_style(f"{path}/margin", "margin", look.margin, 1.0)
    stage.scalars(f"{path}/margin", times, shade)


def draw_states(stage: Stage, flight: FlightData, look: Palette) -> None:
    """One lane a state."""
    for lane in columns.lanes(flight):
        path = f"states/{part(lane.title)}"
        if not look.is_alone:
            path = f"states/{part(flight.label)}/{part(lane.title)}"
        stage.state_style(path, lane.colours)
        stage.states(path, lane.t_s, lane.names)


def draw_log(stage: Stage, flight: FlightData) -> None:
    """The log, in order of time."""
    names = phases_of(flight.recording.manifest)
    lines = [line._replace(text=named(line.text, names)) for line in flight.recording.log]
    lines = sorted(lines, key=lambda line: line.t_s)
    stage.log(f"log/{part(flight.label)}", lines)


def corridor_of(flight: FlightData) -> Corridor | None:
    """The corridor of a flight; None without a mission or without air."""
    flown = flown_by_speed(flight.truth)
    if flight.world is None or flown is None:
        return None
    return corridor(flight.world, flight.limits, flown, flight.end_speed_mps)


def charts_of(flights: list[FlightData]) -> tuple[Chart, Chart] | None:
    """The charts of drag and altitude over speed, scaled to hold all flights."""
    usable = [f for f in flights if f.has("v_rel_mps", "drag_mps2", "alt_m")]
    if not usable:
        return None
    fast = max(float(f.truth["v_rel_mps"].max()) for f in usable)
    slow = min(float(f.truth["v_rel_mps"].min()) for f in usable)
    if fast - slow < 1.0:
        return None
    room = 0.02 * (fast - slow)
    speed = Scale("speed relative to the air, m/s", max(slow - room, 0.0), fast + room)
    drag = max(float(f.truth["drag_mps2"].max()) for f in usable) * 1.35
    for flight in usable:
        found = corridor_of(flight)
        if found is not None and "load factor" in found.drag_mps2:
            drag = max(drag, 1.12 * float(np.nanmedian(found.drag_mps2["load factor"])))
    high = max(float(f.truth["alt_m"].max()) for f in usable) / 1e3
    low = min(float(f.truth["alt_m"].min()) for f in usable) / 1e3
    return (
        Chart(DRAG_CHART, speed, Scale("drag, m/s²", 0.0, max(drag, 1e-3))),
        Chart(ALTITUDE_CHART, speed, Scale("altitude, km", max(low - 12.0, 0.0), high + 3.0)),
    )


def draw_corridor(
    stage: Stage,
    charts: tuple[Chart, Chart],
    found: Corridor,
    label: str = "",
    known: Collection[str] = (),
) -> None:
    """Limits in both charts, and what they forbid; further ones, with a label, as lines alone and
    without those `known`."""
    drag_chart, alt_chart = charts
    group = f"limits_of_{part(label)}" if label else "limits"
    nothing = np.full(len(found.v_rel_mps), -1e9)
    for chart, lines in (
        (drag_chart, found.drag_mps2),
        (alt_chart, {name: line / 1e3 for name, line in found.alt_m.items()}),
    ):
        for number, (name, line) in enumerate(lines.items()):
            if name in known:
                continue
            title = f"{name}, {label}" if label else name
            share = (0.5, 0.35, 0.2, 0.6)[number] + (0.12 if label else 0.0)
            look = Look(SOFT_LIMITS[name], 1.0 if label else 2.0, 5.0, title, share)
            chart.draw_line(stage, f"{group}/{part(name)}", found.v_rel_mps, line, look)
        upper = [lines[name] for name in UPPER if name in lines]
        if not upper or label:
            continue
        if chart is drag_chart:
            edge = np.fmin.reduce(upper)
            bounds = edge, np.full_like(edge, 1e9)
        else:
            edge = np.fmax.reduce(upper)
            bounds = nothing, edge
        chart.draw_hatching(stage, f"{group}/forbidden", found.v_rel_mps, bounds)


def draw_flight_in_charts(
    stage: Stage, charts: tuple[Chart, Chart], flight: FlightData, look: Palette, number: int = 0
) -> None:
    """The flight's line in both charts, and the dot that moves along it."""
    rr, truth = stage.rr, flight.truth
    if not flight.has("v_rel_mps", "drag_mps2", "alt_m"):
        return
    kept = columns.thinned(truth["t_s"], 2.0)
    _draw_planned_in_charts(stage, charts, flight, look)
    for chart, values in zip(charts, (truth["drag_mps2"], truth["alt_m"] / 1e3), strict=True):
        path = f"flights/{part(flight.label)}"
        label = "" if look.is_alone else flight.label
        line = Look(look.flown, 2.6, 10.0, label, NAMED_AT[number % len(NAMED_AT)])
        chart.draw_line(stage, path, truth["v_rel_mps"], values, line)
        places = chart.places(truth["v_rel_mps"][kept], values[kept])
        stage.dots_2d(f"{chart.path}/{path}/now", truth["t_s"][kept], places)
        dot = rr.Points2D.from_fields(
            colors=[look.flown], radii=rr.Radius.ui_points(5.0), draw_order=20.0
        )
        stage.still(f"{chart.path}/{path}/now", dot)


def _draw_planned_in_charts(
    stage: Stage, charts: tuple[Chart, Chart], flight: FlightData, look: Palette
) -> None:
    """What was planned, beneath what was flown."""
    for number, track in enumerate(flight.planned.tracks):
        for chart, field, factor in zip(charts, ("drag_mps2", "alt_m"), (1.0, 1e-3), strict=True):
            if not {"v_rel_mps", field} <= track.path.keys():
                continue
            label = track.name if look.is_alone else ""
            share = PLANNED_NAMED_AT + 0.1 * number
            line = Look(look.plan_of(number), WIDEST, 8.0, label, share)
            path = f"flights/{part(flight.label)}/{part(track.name)}"
            chart.draw_line(stage, path, track.path["v_rel_mps"], track.path[field] * factor, line)
