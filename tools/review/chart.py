"""A chart of one quantity over another, drawn: Rerun plots over time alone.

A chart is a drawing of 1,600 by 1,000 units with frame, grid, ticks and titles; its scales turn
values into places on it. The vertical axis of a drawing points down.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tools.review.palette import AXIS_RGBA, GRID_RGBA, TEXT, Rgba, faded
from tools.review.stage import Stage

F8 = npt.NDArray[np.float64]

WIDTH, HEIGHT = 1600.0, 1000.0
TICKS_WANTED = 7
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
HATCH_STEP = 11.0
LABEL_DROP, LABEL_SHIFT, TITLE_DROP = 26.0, 46.0, 84.0
POINTS_MAX = 3000
LETTER_ACROSS, LETTER_UP = 27.0, 75.0  # of a name, in a window of the usual size
SHARES_TRIED = (0.15, 0.3, 0.45, 0.6, 0.75, 0.9)
FAR = 1e7  # outside the drawing: no line is followed there


class Scale(NamedTuple):
    """One axis: what it shows, and its ends in the unit shown."""

    title: str
    low: float
    high: float

    def ticks(self) -> list[float]:
        """Round numbers along it."""
        rough = (self.high - self.low) / TICKS_WANTED
        power = 10.0 ** math.floor(math.log10(rough))
        step = power * next(s for s in STEPS if s * power >= rough * 0.999)
        first = math.ceil(self.low / step - 1e-9)
        last = math.floor(self.high / step + 1e-9)
        return [number * step for number in range(first, last + 1)]

    def share(self, values: F8 | float) -> F8:
        """Where values lie, from 0 to 1."""
        return (np.asarray(values, float) - self.low) / (self.high - self.low)


class Chart(NamedTuple):
    """The two scales, and where the chart stands among the entities."""

    path: str
    x: Scale
    y: Scale

    def places(self, x: F8, y: F8) -> F8:
        """Places on the drawing, one row a point."""
        return np.stack([self.x.share(x) * WIDTH, (1.0 - self.y.share(y)) * HEIGHT], axis=-1)

    def strips(self, x: F8, y: F8) -> list[F8]:
        """A line as far as it is inside the frame; one that leaves it is cut at its edge."""
        found = []
        places = self.places(x, np.where(np.isfinite(y), y, np.nan))
        good = np.all(np.isfinite(places) & (np.abs(places) < FAR), axis=-1).tolist()
        for run in np.split(
            np.arange(len(places)), np.flatnonzero(np.diff(np.array(good, int))) + 1
        ):
            if len(run) > 1 and good[run[0]]:
                found += _clipped(places[run])
        return found

    def draw_axes(self, stage: Stage) -> None:
        """Frame, grid, ticks with their numbers, titles with their units."""
        rr = stage.rr
        xs, ys = self.x.ticks(), self.y.ticks()
        across = [self.places(np.full(2, x), np.array([self.y.low, self.y.high])) for x in xs]
        along = [self.places(np.array([self.x.low, self.x.high]), np.full(2, y)) for y in ys]
        grid = rr.LineStrips2D(
            across + along, colors=[GRID_RGBA], radii=rr.Radius.ui_points(0.5), draw_order=-20.0
        )
        stage.still(f"{self.path}/axes/grid", grid)
        frame = np.array([[0, 0], [WIDTH, 0], [WIDTH, HEIGHT], [0, HEIGHT], [0, 0]], float)
        edge = rr.LineStrips2D([frame], colors=[AXIS_RGBA], radii=rr.Radius.ui_points(0.8))
        stage.still(f"{self.path}/axes/frame", edge)
        places = [[float(self.x.share(x)) * WIDTH, HEIGHT + LABEL_DROP] for x in xs]
        places += [[-LABEL_SHIFT, (1.0 - float(self.y.share(y))) * HEIGHT] for y in ys]
        self._texts(stage, "ticks", places, [f"{value:z,.10g}" for value in xs + ys], AXIS_RGBA)
        titles = [[WIDTH / 2.0, HEIGHT + TITLE_DROP], [WIDTH * 0.03, -LABEL_DROP * 2.0]]
        self._texts(stage, "titles", titles, [self.x.title, self.y.title], TEXT)

    def _texts(
        self, stage: Stage, name: str, places: list[list[float]], texts: list[str], colour: Rgba
    ) -> None:
        rr = stage.rr
        points = rr.Points2D(
            places,
            labels=texts,
            show_labels=True,
            colors=[colour],
            radii=rr.Radius.ui_points(0.01),
            draw_order=30.0,
        )
        stage.still(f"{self.path}/axes/{name}", points)

    def draw_line(self, stage: Stage, name: str, x: F8, y: F8, look: "Look") -> None:
        """A line with its name at its middle."""
        rr = stage.rr
        thin = max(len(x) // POINTS_MAX, 1)
        strips = self.strips(x[::thin], y[::thin])
        drawn = rr.LineStrips2D(
            strips,
            colors=[look.colour],
            radii=rr.Radius.ui_points(look.width / 2.0),
            draw_order=look.order,
        )
        stage.still(f"{self.path}/{name}", drawn)
        if look.label and strips:
            strip = max(strips, key=_length)
            label = rr.Points2D(
                [self._free_place(stage, name, strip, look)],
                labels=[look.label],
                show_labels=True,
                colors=[look.colour],
                radii=rr.Radius.ui_points(0.01),
                draw_order=25.0,
            )
            stage.still(f"{self.path}/{name}/name", label)

    def _free_place(self, stage: Stage, name: str, strip: F8, look: "Look") -> F8:
        """Where a line's name stands: where it is wanted, or else where it covers no other's."""
        boxes = stage.names_at.setdefault(self.path, {})
        half = np.array([len(look.label) * LETTER_ACROSS, LETTER_UP]) / 2.0
        wanted = _place_along(strip, look.label_share)
        for share in (look.label_share, *SHARES_TRIED):
            at = _place_along(strip, share)
            others = [box for line, box in boxes.items() if line != name]
            if all(np.any(np.abs(at - there) > half + size) for there, size in others):
                wanted = at
                break
        boxes[name] = wanted, half
        return wanted

    def draw_hatching(self, stage: Stage, name: str, x: F8, bounds: tuple[F8, F8]) -> None:
        """Shade what lies between two lines, in the colour of what is forbidden."""
        rr = stage.rr
        low, high = bounds
        grid = np.linspace(0.0, WIDTH, int(WIDTH / HATCH_STEP))
        at = self.x.share(x) * WIDTH
        order = np.argsort(at)
        ends = []
        for line in (low, high):
            y = (1.0 - self.y.share(line[order])) * HEIGHT
            ends.append(np.clip(np.interp(grid, at[order], y, np.nan, np.nan), 0.0, HEIGHT))
        bottom, top = ends
        strokes = [
            np.array([[x0, y0], [x0, y1]])
            for x0, y0, y1 in zip(grid, bottom, top, strict=True)
            if math.isfinite(y0) and math.isfinite(y1) and y0 - y1 > 1.0
        ]
        shade = rr.LineStrips2D(
            strokes,
            colors=[faded(FORBIDDEN, 45)],
            radii=rr.Radius.ui_points(0.7),
            draw_order=-10.0,
        )
        stage.still(f"{self.path}/{name}", shade)

    def view_bounds(self) -> dict[str, Any]:
        """The part of the drawing to be seen: the frame and what stands around it."""
        return {"x_range": (-110.0, WIDTH + 80.0), "y_range": (-85.0, HEIGHT + 120.0)}


FORBIDDEN: Rgba = (242, 84, 91, 255)


class Look(NamedTuple):
    """How a line is drawn."""

    colour: Rgba
    width: float = 1.6
    order: float = 0.0
    label: str = ""
    label_share: float = 0.5
    """Where along the length of the line its name stands."""


def _clipped(points: F8) -> list[F8]:
    """The pieces of a line inside the frame, each with the points where it crosses the edge."""
    inside = np.all((points >= 0.0) & (points <= (WIDTH, HEIGHT)), axis=-1).tolist()
    pieces: list[list[F8]] = []
    for i in range(len(points)):
        if inside[i]:
            if i == 0 or not inside[i - 1]:
                pieces.append([] if i == 0 else [_edge(points[i], points[i - 1])])
            pieces[-1].append(points[i])
        elif i > 0 and inside[i - 1]:
            pieces[-1].append(_edge(points[i - 1], points[i]))
    return [np.array(piece) for piece in pieces if len(piece) > 1]


def _distances(strip: F8) -> F8:
    """How far along a line each of its points lies."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(strip, axis=0), axis=1)))


def _length(strip: F8) -> float:
    return float(_distances(strip)[-1])


def _place_along(strip: F8, share: float) -> F8:
    """The place at a share of a line's length, however its points are spread."""
    at = _distances(strip)
    return np.array([np.interp(share * at[-1], at, column) for column in strip.T])


def _edge(inner: F8, outer: F8) -> F8:
    """Where the way from a point inside to one outside meets the frame."""
    way = outer - inner
    ends = np.where(way > 0.0, (WIDTH, HEIGHT), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(way != 0.0, (ends - inner) / way, np.inf)
    return np.asarray(inner + way * min(float(shares.min()), 1.0))
