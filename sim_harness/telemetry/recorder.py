"""Records a flight beside it: a bounded queue, and a thread that writes.

The caller is never held up. When the queue is full, rows are dropped, counted, and the file says
so where they are missing. A write error ends the recording with one message, not the flight.
A chunk is written once a quarter of a second of flight waits, and at least twice a second of wall
time: whatever kills the process takes less than a second of either with it.
"""

import threading
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from flight_sw.errors import AeroshellError, RecordingError
from sim_harness.telemetry.records import LogLevel, LogLine
from sim_harness.telemetry.writer import RecordingWriter

Rows = npt.NDArray[np.void]

FLUSH_FLIGHT_S = 0.25
FLUSH_WALL_S = 0.5
QUEUE_BYTES = 64 * 1024 * 1024  # six flights of a quarter of an hour
CHUNK_BYTES = 1024 * 1024  # of rows as handed over
LINE_BYTES = 256  # what a line of the log counts in the queue


class Gap(NamedTuple):
    """Rows that found the queue full."""

    first_s: float
    last_s: float
    frames: int = 0
    minor_frames: int = 0
    truth_rows: int = 0
    lines: int = 0

    def plus(self, other: "Gap") -> "Gap":
        """Both gaps in one."""
        first_s, last_s = min(self.first_s, other.first_s), max(self.last_s, other.last_s)
        return Gap(first_s, last_s, *(a + b for a, b in zip(self[2:], other[2:], strict=True)))

    def line(self) -> LogLine:
        """What the log says of it."""
        text = (
            f"recorder overloaded from {self.first_s:.3f} s to {self.last_s:.3f} s: "
            f"{self.frames} frames of {self.minor_frames} minor frames, "
            f"{self.truth_rows} rows of truth and {self.lines} lines of the log are missing"
        )
        return LogLine(self.last_s, LogLevel.WARNING, text)


NO_GAP = Gap(np.inf, -np.inf)


class Batch(NamedTuple):
    """What one chunk is made of."""

    bus: list[Rows]
    truth: list[Rows]
    log: list[LogLine]
    gap: Gap
    size: int
    """Bytes that leave the queue when it is written."""


class Recorder:
    """Writes one flight to `path`; `failure` tells why recording ended early, if it did."""

    def __init__(
        self,
        path: Path,
        manifest: Mapping[str, str],
        attachments: Mapping[str, tuple[str, bytes]],
        telemetry_rate_hz: float = 10.0,
        *,
        on_failure: Callable[[str], None] | None = None,
        queue_bytes: int = QUEUE_BYTES,
    ) -> None:
        self.path = Path(path)
        self.failure: str | None = None
        self.dropped = NO_GAP
        self._on_failure = on_failure
        self._queue_bytes = queue_bytes
        self._queue: deque[tuple[str, Rows | LogLine | Gap, int]] = deque()
        self._waiting_bytes = 0
        self._gap = NO_GAP  # dropped, and not yet in the queue
        self._last_s = 0.0
        self._woken_s = 0.0
        self._outcome: dict[str, str] | None = None
        self._lock = threading.Lock()
        self._wake = threading.Event()
        try:
            self._writer = RecordingWriter(self.path, manifest, attachments, telemetry_rate_hz)
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be written, {error.strerror}") from error
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    # --- the caller's side: nothing here waits for the disk ----------------------------------

    def write_bus(self, rows: Rows) -> None:
        """Take frames in bus order, whole minor frames at a time; the rows are copied."""
        if len(rows):
            minor_frames = 1 + int(np.count_nonzero(np.diff(rows["t_s"])))
            first_s, last_s = float(rows["t_s"][0]), float(rows["t_s"][-1])
            gap = Gap(first_s, last_s, frames=len(rows), minor_frames=minor_frames)
            self._put("bus", rows, gap, rows.nbytes)

    def write_truth(self, rows: Rows) -> None:
        """Take rows of truth, every minor frame's or fewer; the rows are copied."""
        if len(rows):
            first_s, last_s = float(rows["t_s"][0]), float(rows["t_s"][-1])
            self._put("truth", rows, Gap(first_s, last_s, truth_rows=len(rows)), rows.nbytes)

    def log(self, t_s: float, level: LogLevel, text: str) -> None:
        """Take a line of the log."""
        self._put("log", LogLine(t_s, level, text), Gap(t_s, t_s, lines=1), LINE_BYTES)

    def close(self, outcome: str, results: Mapping[str, str] | None = None) -> None:
        """Write what waits, then the outcome with its results, and complete the file."""
        if self._outcome is None:
            self._outcome = {**(results or {}), "outcome": outcome}
        self._wake.set()
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close("finished" if kind is None else f"ended by {kind.__name__}")

    def _put(self, kind: str, rows: Rows | LogLine, gap: Gap, size: int) -> None:
        if self.failure is not None or self._outcome is not None:
            return
        with self._lock:
            if self._waiting_bytes + size > self._queue_bytes:
                self._gap = self._gap.plus(gap)
                self.dropped = self.dropped.plus(gap)
                return
            if self._gap is not NO_GAP:
                self._queue.append(("gap", self._gap, 0))
                self._gap = NO_GAP
            copied = rows if isinstance(rows, LogLine) else rows.copy()
            self._queue.append((kind, copied, size))
            self._waiting_bytes += size
        self._last_s = gap.last_s
        if self._last_s - self._woken_s >= FLUSH_FLIGHT_S:
            self._woken_s = self._last_s
            self._wake.set()

    # --- the thread's side -------------------------------------------------------------------

    def _run(self) -> None:
        reason = "the recorder itself failed"  # unless one of the following says better
        try:
            self._write_all()
            reason = ""
        except OSError as error:
            reason = error.strerror or str(error)
        except AeroshellError as error:
            reason = str(error)
        finally:
            self._writer.close()
            if reason:
                self._fail(reason)

    def _fail(self, reason: str) -> None:
        until_s = self._writer.until_s
        self.failure = f"{self.path.name}: recording ended at {until_s:.3f} s, {reason}"
        self._queue.clear()
        if self._on_failure:
            self._on_failure(self.failure)

    def _write_all(self) -> None:
        is_last = False
        while not is_last:
            self._wake.wait(FLUSH_WALL_S)
            self._wake.clear()
            is_last = self._outcome is not None
            while batch := self._take():
                self._writer.write(batch.bus, batch.truth, batch.log)
                self._writer.skip(batch.gap.minor_frames)
                with self._lock:
                    self._waiting_bytes -= batch.size
        counts = {
            "dropped_frames": str(self.dropped.frames),
            "dropped_minor_frames": str(self.dropped.minor_frames),
            "dropped_truth_rows": str(self.dropped.truth_rows),
            "dropped_log_lines": str(self.dropped.lines),
        }
        self._writer.finish({**(self._outcome or {}), **counts})

    def _take(self) -> Batch | None:
        """What one chunk can hold of the queue; a gap ends a chunk."""
        batch = Batch([], [], [], NO_GAP, 0)
        with self._lock:
            if not self._queue and self._gap is not NO_GAP:
                self._queue.append(("gap", self._gap, 0))
                self._gap = NO_GAP
            while self._queue and batch.size < CHUNK_BYTES:
                kind, item, size = self._queue.popleft()
                batch = batch._replace(size=batch.size + size)
                if isinstance(item, Gap):
                    batch.log.append(item.line())
                    batch = batch._replace(gap=item)
                    break
                getattr(batch, kind).append(item)
        return batch if batch.bus or batch.truth or batch.log else None
