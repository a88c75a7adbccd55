"""A review: flights laid over each other on one stage, with the blueprint that shows them."""

import numpy as np
import numpy.typing as npt

from tools.review import globe, plots
from tools.review.chart import Chart
from tools.review.columns import column, target_of, thinned, truth_fields
from tools.review.columns import lanes as all_lanes
from tools.review.corridor import EQUILIBRIUM, UPPER, PathLimits
from tools.review.layout import CORNERS, Ends, Shape
from tools.review.palette import palette
from tools.review.panels import (
    BUS,
    GUIDANCE,
    IDLE,
    PANELS,
    TO_GO,
    Panel,
    bus_panels,
    telemetry_panels,
)
from tools.review.sheet import sheet
from tools.review.signals import shown as signal
from tools.review.source import FlightData
from tools.review.stage import Stage
from tools.spans import widened

F8 = npt.NDArray[np.float64]

LEGEND_ACROSS, LEGEND_UP, LEGEND_UP_MAX = 0.25, 0.17, 0.7
"""What of a panel a legend takes, up by the line; two more than the panel has: plan, limit."""
ROOM = 1.12  # of a limit or a count: how far a plot reaches beyond it
LIMIT_INDEX = {name: index for index, name in enumerate(UPPER)}
"""Where in PathLimits a limit of the corridor stands."""


def plan(flights: list[FlightData]) -> Shape:
    """Panels, charts and planet that these flights have something for."""
    wanted: dict[str, Panel] = {panel.path: panel for panel in PANELS}
    for flight in flights:
        messages = flight.recording.decoder.messages
        if target_of(flight) is not None:
            wanted |= {panel.path: panel for panel in TO_GO}
        for panel in (*telemetry_panels(messages, truth_fields(flight)), *bus_panels(messages)):
            wanted.setdefault(panel.path, panel)
    shown = [panel for panel in wanted.values() if any(_has(panel, f) for f in flights)]
    panels = [(panel, ends_of(panel, flights)) for panel in shown]
    charts = plots.charts_of(flights)
    over = [f for f in flights if f.planet_radius_m is not None and f.has(*globe.POSITION)]
    body = globe.body_of(float(over[0].planet_radius_m or 0.0)) if over else None
    planet = (body, _eye(over[0], body)) if body is not None else None
    until_s = max(flight.recording.until_s for flight in flights)
    planned = {p.path for p in shown if any(plots.planned_of(p, f) for f in flights)}
    lanes = sum(len(all_lanes(flight)) for flight in flights)
    corners = {panel.path: _free_corner(panel, flights) for panel in shown}
    return Shape(panels, charts, planet, until_s, len(flights), frozenset(planned), lanes, corners)


def _free_corner(panel: Panel, flights: list[FlightData]) -> str:
    """The corner of a panel with the fewest points of its lines, for its legend."""
    lines = [column(f, line.message, line.field) for f in flights for line in panel.lines]
    lines = [(t_s[kept], values[kept]) for t_s, values in lines for kept in [np.isfinite(values)]]
    t_s, values = (np.concatenate([np.zeros(0), *axis]) for axis in zip(*lines, strict=True))
    if not len(t_s):
        return CORNERS[0]
    up = min((len(panel.lines) + 2) * LEGEND_UP, LEGEND_UP_MAX)
    x, y = (_share(axis) for axis in (t_s, values))
    is_at = {
        "Left": x < LEGEND_ACROSS, "Right": x > 1.0 - LEGEND_ACROSS,
        "Bottom": y < up, "Top": y > 1.0 - up,
    }  # fmt: skip
    taken = {
        f"{side}{end}": int(np.count_nonzero(is_at[side] & is_at[end]))
        for side in ("Left", "Right")
        for end in ("Bottom", "Top")
    }
    return min(CORNERS, key=lambda corner: taken[corner])


def _share(values: F8) -> F8:
    """Where values lie between the least and the greatest, from 0 to 1."""
    return (values - values.min()) / (float(np.ptp(values)) or 1.0)


def _has(panel: Panel, flight: FlightData) -> bool:
    """Whether there is something to see: of telemetry more than the truth beside it, and of an
    angle or a heat flux that the mission has more than zeros."""
    lines = [line for line in panel.lines if line.message or panel.tab != GUIDANCE]
    found = [column(flight, line.message, line.field)[1] for line in lines]
    if panel.path in IDLE:
        return any(values.any() for values in found)
    return any(len(values) for values in found)


def ends_of(panel: Panel, flights: list[FlightData]) -> Ends:
    """The ends of a panel's axis: from 0 where there is a limit or a count, wider than the values
    where these are all one but for round-off; None leaves both to the viewer."""
    if (from_zero := ends_from_zero(panel, flights)) is not None:
        return from_zero
    values = _values(panel, flights)
    return widened(values.min(), values.max(), panel.unit) if len(values) else None


def ends_from_zero(panel: Panel, flights: list[FlightData]) -> Ends:
    """From 0 to above a limit, or to above the highest count: the viewer alone would show a count
    of none between -1 and 1."""
    if panel.limit:
        limits = [plots.limit_of(panel, flight) for flight in flights]
        top = max((limit for limit in limits if np.isfinite(limit)), default=0.0)
        return (0.0, top * ROOM) if top > 0.0 else None
    values = _values(panel, flights) if panel.tab == BUS else np.zeros(0)
    if not len(values) or values.min() < 0.0:
        return None
    return 0.0, (float(values.max()) or 1.0) * ROOM


def _values(panel: Panel, flights: list[FlightData]) -> F8:
    """All finite values of a panel, in its unit."""
    found = [
        column(flight, line.message, line.field)[1] * signal(line.field).factor
        for flight in flights
        for line in panel.lines
    ]
    for flight in flights:
        for line in plots.planned_of(panel, flight):
            found.append(line.values * plots.flown_factor(panel))
    values = np.concatenate([np.zeros(0), *found])
    return values[np.isfinite(values)]


def _eye(flight: FlightData, body: globe.Body) -> tuple[F8, F8, F8]:
    return globe.eye(globe.track_km(flight.truth, body.radius_km), body)


def peak_s(flight: FlightData) -> float:
    """When the heat flux was highest, or the load; half-way where neither is known."""
    for name in ("heat_flux_wpm2", "load_factor_g"):
        if flight.has(name) and flight.truth[name].any():
            return float(flight.truth["t_s"][flight.truth[name].argmax()])
    return flight.recording.until_s / 2.0


def draw(stage: Stage, flights: list[FlightData], shape: Shape) -> None:
    """Everything of every flight."""
    stage.name()
    looks = [palette(number, len(flights)) for number in range(len(flights))]
    for flight, look in zip(flights, looks, strict=True):
        for panel, _ in shape.panels:
            plots.draw_panel(stage, panel, flight, look)
        plots.draw_states(stage, flight, look)
        plots.draw_log(stage, flight)
    if shape.charts is not None:
        _draw_charts(stage, flights, shape.charts)
    if shape.planet is not None:
        _draw_globe(stage, flights, shape.planet[0])
    stage.still("sheet", stage.rr.TextDocument(sheet(flights), media_type="text/markdown"))


def _draw_charts(stage: Stage, flights: list[FlightData], charts: tuple[Chart, Chart]) -> None:
    for chart in charts:
        chart.draw_axes(stage)
    drawn: list[PathLimits] = []
    for flight in flights:  # the first corridor, and of further ones what they limit otherwise
        found = plots.corridor_of(flight)
        if found is not None:
            known = {
                name
                for name, index in LIMIT_INDEX.items()
                for other in drawn
                if other[index] == flight.limits[index]
            }
            known |= {EQUILIBRIUM} if drawn else set()
            plots.draw_corridor(stage, charts, found, flight.label if drawn else "", known)
            drawn.append(flight.limits)
    for number, flight in enumerate(flights):
        look = palette(number, len(flights))
        plots.draw_flight_in_charts(stage, charts, flight, look, number)


def _draw_globe(stage: Stage, flights: list[FlightData], body: globe.Body) -> None:
    globe.draw_body(stage, body)
    for number, flight in enumerate(flights):
        if not flight.has(*globe.POSITION):
            continue
        look = palette(number, len(flights))
        tracks = flight.planned.tracks
        globe.draw_planned(stage, flight.label, tracks, body, look)
        target = target_of(flight)
        if tracks and target is not None and flight.has("heading_rad"):
            globe.draw_crossrange(stage, flight.label, flight.truth, target, body)
        globe.draw_track(stage, flight.label, flight.truth, body, look)
        moving = flight.truth[thinned(flight.truth["t_s"], globe.MOVING_HZ)]
        globe.draw_vehicle(stage, flight.label, moving, body, look)
        globe.draw_sites(stage, globe.sites_of(flight.tables, body.radius_km), body)
