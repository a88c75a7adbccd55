"""Ties the recorder to a flight: what the loop logs is recorded, events go into its log."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from flight_sw.runtime.streams import say
from sim_harness.flight.flight import FlightRun
from sim_harness.flight.summary import results_of
from sim_harness.telemetry.journal import Journal
from sim_harness.telemetry.recorder import Recorder
from sim_harness.telemetry.records import LogLevel


class FolderWatch:
    """A listener of a flight that says at once when the folder of its files is gone."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._inode: int | None = folder.stat().st_ino

    def rows(self, bus: npt.NDArray[np.void], truth: npt.NDArray[np.void]) -> None:
        """Nothing is kept here."""

    def waiting(self, text: str) -> None:
        """The time before the flight counts as well."""
        self._look(say)

    def progress(self, run: FlightRun) -> None:
        """Many times a second."""
        self._look(run.warn)

    def warn(self, t_s: float, text: str) -> None:
        """Its own words come back here."""

    def _look(self, tell: Callable[[str], None]) -> None:
        if self._inode is None:
            return
        try:
            is_there = self._folder.stat().st_ino == self._inode
        except OSError:
            is_there = False
        if not is_there:
            self._inode = None
            tell(f"the folder {self._folder} was removed, what is written there is lost")


class FlightRecorder:
    """A listener of a flight that writes flight.mcap."""

    def __init__(
        self,
        path: Path,
        manifest: dict[str, str],
        attachments: dict[str, tuple[str, bytes]],
        telemetry_rate_hz: float = 10.0,
    ) -> None:
        self._recorder = Recorder(
            path, manifest, attachments, telemetry_rate_hz, on_failure=self._tell
        )
        self.journal: Journal | None = None

    def rows(self, bus: npt.NDArray[np.void], truth: npt.NDArray[np.void]) -> None:
        """Hand what was logged on to the recorder."""
        if bus.size:
            self._recorder.write_bus(bus)
        if truth.size:
            self._recorder.write_truth(truth)

    def progress(self, run: FlightRun) -> None:
        """Nothing: the recorder finds the events in the frames."""

    def waiting(self, text: str) -> None:
        """Nothing of the time before the flight is recorded."""

    def warn(self, t_s: float, text: str) -> None:
        """Log it."""
        self._recorder.log(t_s, LogLevel.WARNING, text)

    def close(self, run: FlightRun) -> None:
        """Complete the file with how the flight ended and how it kept time."""
        self._recorder.close(run.outcome_text, results_of(run))
        run.unrecorded = self._recorder.failure or ""
        if self.journal is None:
            return
        if self._recorder.failure is None:
            self.journal.remove()
        else:
            self.journal.close()

    @staticmethod
    def _tell(failure: str) -> None:
        say(f"aeroshell: {failure}")
