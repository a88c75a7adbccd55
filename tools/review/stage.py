"""What the review shows, handed to Rerun: the one module that knows how Rerun takes data.

Everything goes by mission time on one timeline. Nothing of Rerun is imported before a stage is
made.
"""

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sim_harness.telemetry.records import LogLevel, LogLine
from tools.review.palette import Rgba

F8 = npt.NDArray[np.float64]

APPLICATION = "aeroshell"
TIMELINE = "mission_time"
NS_PER_S = 1e9
SLOW = "timed out"  # in what a flush says of a viewer that does not read
UNFIT = re.compile(r"[^A-Za-z0-9.-]+")  # for a part of an entity path
LEVELS = {
    LogLevel.DEBUG: "DEBUG",
    LogLevel.INFO: "INFO",
    LogLevel.WARNING: "WARN",
    LogLevel.ERROR: "ERROR",
    LogLevel.FATAL: "CRITICAL",
}


def quiet_rerun() -> Any:
    """Rerun's library, which is to write nothing of its own on stderr."""
    os.environ.setdefault("RUST_LOG", "off")
    import rerun

    return rerun


def part(text: str) -> str:
    """A text as one part of an entity path."""
    return UNFIT.sub("_", text).strip("_") or "_"


class Stage:
    """A recording of Rerun's that is being filled."""

    def __init__(self, name: str, recording_id: str | None = None) -> None:
        self.rr = rr = quiet_rerun()
        self.stream = rr.RecordingStream(APPLICATION, recording_id=recording_id)
        self.drawn: set[tuple[str, float]] = set()  # limits, by panel: one line for all flights
        self.names_at: dict[str, dict[str, tuple[F8, F8]]] = {}
        """By chart and line: where the line's name stands, and half of what it takes."""
        self._name = name
        self.is_live = False
        self._last_state: dict[str, str] = {}
        self._styled: set[str] = set()
        self._coloured: dict[str, set[str]] = {}

    def name(self) -> None:
        """Say what the recording is called; after the sink is chosen."""
        self.stream.send_recording_name(self._name)

    def save(self, path: Path, blueprint: Any) -> None:
        """Write to a file what comes."""
        self.stream.save(path, default_blueprint=blueprint)

    def connect(self, url: str, blueprint: Any) -> None:
        """Send what comes to a viewer; the process does not wait for it in the end."""
        self.rr.unregister_shutdown()
        self.stream.connect_grpc(url)
        self.stream.send_blueprint(blueprint, make_active=True)

    def close(self, timeout_s: float = 60.0) -> None:
        """Have everything written or sent."""
        self.stream.flush(timeout_sec=timeout_s)
        self.stream.disconnect()

    def still(self, path: str, *content: Any) -> None:
        """Something that does not depend on time."""
        self.stream.log(path, *content, static=True)

    def _is_styled(self, path: str) -> bool:
        """Whether the look of a path has been told before."""
        is_told = path in self._styled
        self._styled.add(path)
        return is_told

    def is_sent(self, within_s: float) -> bool:
        """Whether the viewer has taken everything; a viewer that is gone is an error."""
        try:
            self.stream.flush(timeout_sec=within_s)
        except RuntimeError as error:
            if SLOW in str(error):
                return False
            raise ConnectionError(str(error)) from error
        return True

    def _columns(self, path: str, t_s: F8, columns: Any) -> None:
        exact = np.rint(np.asarray(t_s, float) * NS_PER_S).astype("timedelta64[ns]")
        times = self.rr.TimeColumn(TIMELINE, duration=exact)
        self.stream.send_columns(path, indexes=[times], columns=columns)

    def line_style(self, path: str, name: str, colour: Rgba, width: float = 1.6) -> None:
        """How a line over time looks."""
        if self._is_styled(path):
            return
        style = self.rr.SeriesLines(
            colors=[colour], widths=[width], names=[name], aggregation_policy="MinMax"
        )
        self.still(path, style)

    def dot_style(self, path: str, name: str, colour: Rgba, size: float = 3.0) -> None:
        """How dots over time look."""
        if self._is_styled(path):
            return
        style = self.rr.SeriesPoints(
            colors=[colour], marker_sizes=[size], names=[name], markers=["Circle"]
        )
        self.still(path, style)

    def scalars(self, path: str, t_s: F8, values: F8) -> None:
        """Values of a line or of dots; a line ends at what is not a number."""
        good = ~np.isinf(values)
        if good.any():
            self._columns(path, t_s[good], self.rr.Scalars.columns(scalars=values[good]))

    def states(self, path: str, t_s: F8, names: Sequence[str]) -> None:
        """Changes of a state; a first one that is what it was is none."""
        if len(names) and self._last_state.get(path) == names[0]:
            t_s, names = t_s[1:], names[1:]
        if len(names):
            self._last_state[path] = names[-1]
            self._columns(path, t_s, self.rr.StateChange.columns(state=list(names)))

    def state_style(self, path: str, colours: Mapping[str, Rgba]) -> None:
        """The colours of a lane of states."""
        if set(colours) <= self._coloured.setdefault(path, set()):
            return
        self._coloured[path] |= set(colours)
        packed = [
            (red << 24) + (green << 16) + (blue << 8) + alpha
            for red, green, blue, alpha in colours.values()
        ]
        colours_32 = np.array(packed, np.uint32)
        self.still(path, self.rr.StateConfiguration(values=list(colours), colors=colours_32))

    def arrows(self, path: str, t_s: F8, origins: F8, vectors: F8) -> None:
        """One arrow that moves."""
        columns = self.rr.Arrows3D.columns(origins=origins, vectors=vectors)
        self._columns(path, t_s, columns)

    def dots_3d(self, path: str, t_s: F8, places: F8) -> None:
        """One dot that moves in space."""
        self._columns(path, t_s, self.rr.Points3D.columns(positions=places))

    def dots_2d(self, path: str, t_s: F8, places: F8) -> None:
        """One dot that moves in a plane."""
        self._columns(path, t_s, self.rr.Points2D.columns(positions=places))

    def log(self, path: str, lines: Sequence[LogLine]) -> None:
        """Lines of the log."""
        if lines:
            t_s = np.array([line.t_s for line in lines])
            columns = self.rr.TextLog.columns(
                text=[line.text for line in lines], level=[LEVELS[line.level] for line in lines]
            )
            self._columns(path, t_s, columns)
