"""The blueprint: which views there are, and where they stand."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tools.review import globe
from tools.review.chart import Chart
from tools.review.panels import BUS, ENTRY, FLIGHTS, GUIDANCE, TRAJECTORY, Panel
from tools.review.stage import TIMELINE

F8 = npt.NDArray[np.float64]
COLUMNS = 3
BACKGROUND = (14, 17, 22)
TIME_ROOM = 1.01
LOG_COLUMNS: list[Any] = ["entitypath", "loglevel", "body"]
STATES_LEAST, STATES_MOST, SHARE_PER_LANE, LOG_SHARE = 3.0, 4.2, 0.46, 2.0
CORNERS = ("RightTop", "LeftTop", "RightBottom", "LeftBottom")
TABS = (ENTRY, TRAJECTORY, GUIDANCE, BUS, FLIGHTS)


Ends = tuple[float, float] | None


class Shape(NamedTuple):
    """What there is to be laid out."""

    panels: Sequence[tuple[Panel, Ends]]
    """With the ends of each one's axis in the unit shown; None where the viewer may choose."""
    charts: tuple[Chart, Chart] | None
    planet: tuple[globe.Body, tuple[F8, F8, F8]] | None
    until_s: float
    """End of the time axes; infinite while the flight goes on."""
    flights: int = 1
    planned: frozenset[str] = frozenset()
    """Paths of the panels that have planned lines."""
    lanes: int = 5
    """Of states."""
    corners: Mapping[str, str] = {}
    """Where in a panel there is room for its legend, by its path."""


def time_axis(until_s: float) -> Any:
    """The whole flight; while it is flown, as much as there is."""
    import rerun as rr
    import rerun.blueprint as rrb

    boundary = rr.TimeRangeBoundary
    is_over = np.isfinite(until_s)
    end = boundary.absolute(seconds=until_s * TIME_ROOM) if is_over else boundary.infinite()
    whole = rr.TimeRange(start=boundary.absolute(seconds=0.0), end=end)
    return rrb.archetypes.TimeAxis(view_range=whole)


def time_view(panel: Panel, ends: Ends, shape: Shape) -> Any:
    """A plot over time."""
    import rerun.blueprint as rrb

    axis = rrb.ScalarAxis(range=ends) if ends else None
    corner = rrb.Corner2D[shape.corners.get(panel.path, CORNERS[0])]
    has_limit = bool(panel.limit) and ends is not None and ends[0] == 0.0
    has_others = has_limit or panel.path in shape.planned
    is_told_apart = shape.flights > 1 or len(panel.lines) > 1 or has_others
    return rrb.TimeSeriesView(
        origin=f"/{panel.path}",
        name=panel.heading,
        axis_y=axis,
        axis_x=time_axis(shape.until_s),
        plot_legend=rrb.PlotLegend(corner=corner, visible=bool(is_told_apart)),
        background=rrb.archetypes.PlotBackground(color=BACKGROUND, show_grid=True),
    )


def chart_view(chart: Chart) -> Any:
    """A chart over speed."""
    import rerun.blueprint as rrb

    return rrb.Spatial2DView(
        origin=f"/{chart.path}",
        name=f"{chart.y.title}, over speed",
        background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(**chart.view_bounds()),
    )


def globe_view(body: globe.Body, eye: tuple[F8, F8, F8]) -> Any:
    """The planet with the flights over it."""
    import rerun.blueprint as rrb

    position, target, up = eye
    return rrb.Spatial3DView(
        origin=f"/{globe.PATH}",
        name=f"Track over {body.name}, in the axes of the planet",
        background=BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=position, look_target=target, eye_up=up
        ),
    )


def _shares(lanes: int) -> list[float]:
    """Of the globe, the states and the log: as many lanes are to be seen as leave it its room."""
    states = min(max(STATES_LEAST, SHARE_PER_LANE * (lanes + 1)), STATES_MOST)
    return [10.0 - LOG_SHARE - states, states, LOG_SHARE]


def _grid(name: str, views: Sequence[Any]) -> Any:
    import rerun.blueprint as rrb

    return rrb.Grid(*views, name=name, grid_columns=COLUMNS if len(views) > 2 else len(views))


def blueprint(shape: Shape, tab: str = ENTRY) -> Any:
    """The whole review, open at one of its tabs."""
    import rerun.blueprint as rrb

    play: Any = "paused" if np.isfinite(shape.until_s) else "following"
    plots = {
        name: [time_view(panel, ends, shape) for panel, ends in shape.panels if panel.tab == name]
        for name in (ENTRY, TRAJECTORY, GUIDANCE, BUS)
    }
    states = rrb.StateTimelineView(
        origin="/states",
        name="Modes and states",
        time_view=time_axis(shape.until_s),
    )
    log = rrb.TextLogView(
        origin="/log",
        name="Events",
        columns=rrb.TextLogColumns(
            timeline_columns=(TIMELINE,), text_log_columns=LOG_COLUMNS[shape.flights == 1 :]
        ),
    )
    sheet = rrb.TextDocumentView(origin="/sheet", name=FLIGHTS)
    left = [globe_view(*shape.planet)] if shape.planet else [sheet]
    middle = [chart_view(chart) for chart in shape.charts or ()]
    first = rrb.Horizontal(
        rrb.Vertical(*left, states, log, row_shares=_shares(shape.lanes)),
        *([rrb.Vertical(*middle)] if middle else []),
        rrb.Vertical(*plots[ENTRY]),
        column_shares=[5, 4, 4] if middle else [1, 1],
        name=ENTRY,
    )
    tabs: list[Any] = [first]
    tabs += [_grid(name, plots[name]) for name in (TRAJECTORY, GUIDANCE, BUS) if plots[name]]
    if shape.planet:
        tabs.append(rrb.Vertical(sheet, name=FLIGHTS))
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=[t.name for t in tabs].index(tab)),
        rrb.TopPanel(state="expanded"),  # on Linux the window's own buttons stand in it
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state=play),
        auto_views=False,
        auto_layout=False,
    )
