"""The live view: a listener of a flight that shows it in Rerun while it is flown.

What the flight hands over is copied into a bounded queue; a thread of low priority draws it. A
viewer that is slow makes the queue fill: what finds no room is dropped, counted, and told. A viewer
that is gone ends the view, not the flight.
"""

import copy
import os
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from sim_harness.flight.flight import FlightRun
from sim_harness.telemetry.decode import NO_SLOT, Decoder
from sim_harness.telemetry.events import Events
from sim_harness.telemetry.records import BUS_LOG, LogLevel, LogLine
from sim_harness.world.assembly import truth_of, world_of
from tools.review import globe, layout, plots
from tools.review.chart import Chart, Scale
from tools.review.columns import target_of, thinned
from tools.review.palette import palette
from tools.review.panels import PANELS, TO_GO, Panel, bus_panels, telemetry_panels
from tools.review.review import ends_from_zero
from tools.review.source import FlightData, limits_of
from tools.review.stage import Stage
from tools.tracks import Tracks

Rows = npt.NDArray[np.void]
F8 = npt.NDArray[np.float64]

EVERY_S = 0.5  # of the clock, between two looks at the queue
QUEUE_BYTES = 32 * 1024 * 1024  # three lockstep flights of a quarter of an hour
SENT_WITHIN_S, LAST_WITHIN_S = 1.0, 10.0
CORRIDOR_EVERY = 4  # looks: corridor and track are drawn anew
NICE = 10
GONE = "live view: the viewer is gone, the flight goes on"
ROOM_KM, DRAG_ROOM = 5.0, 1.05


class LiveRecording:
    """A piece of a flight, with what the plots ask of a recording."""

    missing_minor_frames = 0

    def __init__(self, decoder: Decoder, manifest: Mapping[str, str]) -> None:
        self.decoder = decoder
        self.manifest = manifest
        self.bus: Rows = np.zeros(0, BUS_LOG)
        self.truth: Rows = np.zeros(0, np.dtype([("t_s", "f8")]))
        self.log: list[LogLine] = []

    def message(self, name: str) -> tuple[F8, Mapping[str, Any]]:
        """Every good frame of a message."""
        slot = self.decoder.slot(name)
        rows = self.bus[self.slots == slot]
        return rows["t_s"], self.decoder.columns(slot, rows["frame"]["data"])

    @property
    def slots(self) -> npt.NDArray[np.int64]:
        """The message in each frame."""
        return self.decoder.slots(self.bus) if len(self.bus) else np.zeros(0, np.int64)


class LiveFlight(FlightData):
    """A flight in the air."""

    def __init__(self, run: FlightRun, manifest: Mapping[str, str]) -> None:
        from flight_sw import icd

        mission = run.plan.mission
        self.label = mission.name
        self.gaps: list[str] = []
        self.mission = mission
        self.limits = limits_of(mission)
        self.world = world_of(mission)[0]
        self.planet_radius_m = mission.planet.radius_km * 1e3
        self.tables = mission.model_dump()
        self.planned = Tracks()  # found out from a recording, not while the flight goes on
        self.recording = LiveRecording(Decoder(icd.LAYOUT), manifest)  # type: ignore[assignment]

    def piece(self, bus: Rows, truth: Rows, log: list[LogLine]) -> "LiveFlight":
        """The same flight with these rows alone."""
        found = copy.copy(self)
        found.recording = copy.copy(self.recording)
        found.messages = {}
        found.recording.bus, found.recording.truth, found.recording.log = bus, truth, log
        return found


class LiveView:
    """The listener; `open` it before the flight, `close` it after."""

    def __init__(
        self,
        run: FlightRun,
        manifest: Mapping[str, str],
        url: str,
        tell: Callable[[str], None],
        process: "subprocess.Popen[bytes] | None" = None,
        queue_bytes: int = QUEUE_BYTES,
    ) -> None:
        self._flight = LiveFlight(run, manifest)
        self._tell = tell
        self._process = process
        self._url = url
        self._queue: deque[tuple[Rows, Rows, list[LogLine]]] = deque()
        self._queue_bytes = queue_bytes
        self._waiting_bytes = 0
        self.dropped_rows = 0
        self._is_over = False
        self.failure = ""
        self._law_telemetry = _telemetry_of(run.image.law)
        self._wake, self._done = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="live view", daemon=True)
        self._thread.start()

    # --- the flight's side: nothing here waits --------------------------------------------------

    def rows(self, bus: Rows, truth: Rows) -> None:
        """Take copies of what was logged, if there is room for them."""
        size = bus.nbytes + truth.nbytes
        if self.failure or not size:
            return
        if self._waiting_bytes + size > self._queue_bytes:
            self.dropped_rows += len(bus) + len(truth)
            return
        self._waiting_bytes += size
        self._queue.append((bus.copy(), truth.copy(), []))

    def progress(self, run: FlightRun) -> None:
        """Nothing: the rows tell."""

    def waiting(self, text: str) -> None:
        """Nothing of the time before the flight is shown."""

    def warn(self, t_s: float, text: str) -> None:
        """Into the log of the view."""
        none = np.zeros(0, BUS_LOG), np.zeros(0, np.dtype([("t_s", "f8")]))
        self._queue.append((*none, [LogLine(t_s, LogLevel.WARNING, text)]))

    def close(self) -> None:
        """Show what waits, then leave the viewer to its user."""
        self._is_over = True
        self._wake.set()
        self._done.wait(LAST_WITHIN_S + SENT_WITHIN_S + EVERY_S)
        self.dropped_rows += sum(len(bus) + len(truth) for bus, truth, _ in [*self._queue])
        if self.dropped_rows and not self.failure:
            self._tell(
                f"live view: {self.dropped_rows:,} rows are not shown, the viewer was too slow; "
                "the recording has them"
            )

    # --- the thread's side ----------------------------------------------------------------------

    def _run(self) -> None:
        try:
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
        except OSError:
            pass
        try:
            painter = Painter(self._flight, self._law_telemetry, self._url)
            painter.paint(self._next)
        except ConnectionError:
            self._fail(GONE)
        except Exception as error:  # the flight goes on whatever the view does
            self._fail(f"live view: ended, the flight goes on ({error!r})")
        self._done.set()
        # Rerun waits without limit for a viewer that does not read, when its stream is collected or
        # the process ends. This thread keeps the stream, and ends with the process.
        threading.Event().wait()

    def _next(self, is_sent: bool) -> tuple[Rows, Rows, list[LogLine]] | None:
        """What has come in since the last look, if the viewer is ready for it; None at the end."""
        while True:
            self._wake.wait(EVERY_S)
            if self._process is not None and self._process.poll() is not None:
                self._fail(GONE)
                return None
            if not is_sent:
                return None if self._is_over else EMPTY
            is_last = self._is_over
            taken = [self._queue.popleft() for _ in range(len(self._queue))]
            if taken:
                return self._joined(taken)
            if is_last:
                return None

    def _joined(self, taken: list[tuple[Rows, Rows, list[LogLine]]]) -> Any:
        bus = [rows for rows, _, _ in taken if len(rows)]
        truth = [rows for _, rows, _ in taken if len(rows)]
        self._waiting_bytes -= sum(rows.nbytes for rows in (*bus, *truth))
        lines = [line for _, _, log in taken for line in log]
        return (
            np.concatenate(bus) if bus else EMPTY[0],
            np.concatenate(truth) if truth else EMPTY[1],
            lines,
        )

    def _fail(self, sentence: str) -> None:
        if self.failure:
            return
        self.failure = sentence
        self._queue.clear()
        self._tell(sentence)


EMPTY: tuple[Rows, Rows, list[LogLine]] = (
    np.zeros(0, BUS_LOG),
    np.zeros(0, np.dtype([("t_s", "f8")])),
    [],
)


class Painter:
    """Draws pieces of a flight as they come."""

    def __init__(self, flight: LiveFlight, telemetry: tuple[str, ...], url: str) -> None:
        self._flight = flight
        self._look = palette(0, 1)
        self._body = globe.body_of(float(flight.planet_radius_m or 0.0))
        self._charts = charts_for(flight)
        self._panels = panels_for(flight, telemetry)
        self._events = Events(flight.recording.decoder)
        self._pieces: list[Rows] = []
        self._stage = Stage(flight.label)
        self._stage.is_live = True
        self._url = url

    def paint(self, next_rows: Callable[[bool], tuple[Rows, Rows, list[LogLine]] | None]) -> None:
        """Draw until there is no more."""
        stage = self._stage
        assert self._flight.mission is not None
        ahead = globe.track_ahead(truth_of(self._flight.mission), self._body)
        eye = globe.eye(ahead, self._body)
        shape = layout.Shape(self._panels, self._charts, (self._body, eye), np.inf)
        stage.connect(self._url, layout.blueprint(shape))
        stage.name()
        globe.draw_body(stage, self._body)
        places = globe.sites_of(self._flight.tables, self._body.radius_km)
        globe.draw_sites(stage, places, self._body)
        for chart in self._charts:
            chart.draw_axes(stage)
        looks, is_sent = 0, stage.is_sent(LAST_WITHIN_S)
        while (rows := next_rows(is_sent)) is not None:
            if len(rows[0]) or len(rows[1]) or rows[2]:
                self._draw(*rows, is_whole=looks % CORRIDOR_EVERY == 0)
                looks += 1
            is_sent = stage.is_sent(SENT_WITHIN_S)
        if is_sent:
            self._draw(*EMPTY, is_whole=True)
            if stage.is_sent(LAST_WITHIN_S):
                stage.stream.disconnect()  # or the viewer shows its user an error

    def _draw(self, bus: Rows, truth: Rows, log: list[LogLine], *, is_whole: bool) -> None:
        stage, look = self._stage, self._look
        decoder = self._flight.recording.decoder
        if len(bus):
            slots = decoder.slots(bus)
            log = [*self._events.lines(bus, slots), *log]
            bus = bus[slots != NO_SLOT]
        piece = self._flight.piece(bus, truth, log)
        for panel, _ in self._panels:
            plots.draw_panel(stage, panel, piece, look)
        plots.draw_states(stage, piece, look)
        plots.draw_log(stage, piece)
        if len(truth):
            self._pieces.append(truth[thinned(truth["t_s"])])
            if len(truth) > 1:
                globe.draw_vehicle(stage, piece.label, truth, self._body, look)
        if is_whole and self._pieces:
            whole = self._flight.piece(EMPTY[0], np.concatenate(self._pieces), [])
            if len(whole.truth) > 1:
                globe.draw_track(stage, whole.label, whole.truth, self._body, look)
                plots.draw_flight_in_charts(stage, self._charts, whole, look)
                if (found := plots.corridor_of(whole)) is not None:
                    plots.draw_corridor(stage, self._charts, found)


def _telemetry_of(law: str) -> tuple[str, ...]:
    """The signals that a law telemeters."""
    from flight_sw.guidance import LAWS

    return tuple(getattr(LAWS.get(law), "TELEMETRY", ()))


def panels_for(flight: LiveFlight, telemetry: tuple[str, ...]) -> list[tuple[Panel, layout.Ends]]:
    """Every panel that a flight of this law will have something for."""
    messages = flight.recording.decoder.messages
    sent = [
        message
        for message in messages
        if not message.name.startswith("TM_")
        or {s.name for s in message.signals[2:]} <= set(telemetry)
    ]
    fields = tuple(truth_of(flight.mission).dtype.names or ()) if flight.mission else ()
    panels = [*PANELS, *(TO_GO if target_of(flight) else ())]
    panels += [*telemetry_panels(sent, fields), *bus_panels(sent)]
    return [(panel, ends_from_zero(panel, [flight]) if panel.limit else None) for panel in panels]


def charts_for(flight: LiveFlight) -> tuple[Chart, Chart]:
    """The charts, scaled by the mission: nothing has been flown yet."""
    mission = flight.mission
    assert mission is not None
    fast = float(truth_of(mission)["v_rel_mps"][0])
    speed = Scale("speed relative to the air, m/s", mission.end.speed_mps * 0.9, fast * 1.03)
    drag = mission.limits.load_factor_max_g * mission.planet.g0_mps2 * DRAG_ROOM
    return (
        Chart(plots.DRAG_CHART, speed, Scale("drag, m/s²", 0.0, drag)),
        Chart(
            plots.ALTITUDE_CHART,
            speed,
            Scale("altitude, km", 0.0, mission.entry.altitude_km + ROOM_KM),
        ),
    )
