"""Ties the recorder to a flight: what the loop logs is recorded, events go into its log."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from flight_sw.streams import say
from sim_harness.flight import FlightRun
from sim_harness.journal import Journal
from sim_harness.summary import results_of
from sim_harness.telemetry.recorder import Recorder
from sim_harness.telemetry.records import LogLevel


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
        if self.journal is None:
            return
        if self._recorder.failure is None:
            self.journal.remove()
        else:
            self.journal.close()

    @staticmethod
    def _tell(failure: str) -> None:
        say(f"aeroshell: {failure}")
