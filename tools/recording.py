"""Ties the recorder to a flight: what the loop logs is recorded, events go into its log."""

import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sim_harness.telemetry.recorder import Recorder


class FlightRecorder:
    """A listener of a flight that writes flight.mcap."""

    def __init__(
        self, path: Path, manifest: dict[str, str], attachments: dict[str, tuple[str, bytes]]
    ) -> None:
        self._recorder = Recorder(path, manifest, attachments, on_failure=self._tell)

    def rows(self, bus: npt.NDArray[np.void], truth: npt.NDArray[np.void]) -> None:
        """Hand what was logged on to the recorder."""
        if bus.size:
            self._recorder.write_bus(bus)
        if truth.size:
            self._recorder.write_truth(truth)

    def progress(self, harness: npt.NDArray[np.void]) -> None:
        """Nothing: the recorder finds the events in the frames."""

    def waiting(self, text: str) -> None:
        """Nothing of the time before the flight is recorded."""

    def close(self, outcome: str) -> None:
        """Complete the file."""
        self._recorder.close(outcome)

    @staticmethod
    def _tell(failure: str) -> None:
        sys.stderr.write(f"aeroshell: {failure}\n")
