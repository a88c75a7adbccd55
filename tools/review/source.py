"""A recorded flight as the review takes it: truth, messages, log, and the mission that was flown.

What a recording lacks (a killed writer, another version, no mission attached) is left out of the
review and named in `gaps`; nothing is assumed in its place.
"""

import functools
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from flight_sw.errors import AeroshellError, RecordingError
from flight_sw.runtime.echo import echoed
from sim_harness.mission import documents
from sim_harness.mission.mission import Mission, apply
from sim_harness.telemetry.reader import Recording, open_recording
from sim_harness.telemetry.records import RECORDING_NAME
from sim_harness.world.assembly import world_of
from sim_harness.world.missions import mission_of
from tools.review.corridor import PathLimits
from tools.review.stage import part
from tools.tracks import Tracks, tracks_of

F8 = npt.NDArray[np.float64]
Rows = npt.NDArray[np.void]
Column = npt.NDArray[Any]

MISSION_SUFFIX = ".toml"
OVERRIDES = "overrides"  # of the manifest: mission keys set for this flight, as JSON
RECORDING = Path(RECORDING_NAME)
SAME_RADIUS = 1e-3  # of a planet, between flights that are laid over each other


def labels_of(paths: list[Path]) -> list[str]:
    """A short name for each flight: its folder's, where its file says nothing. All differ, as the
    parts of entity paths that are made of them do."""
    found: dict[str, str] = {}
    for path in paths:
        whole = path.resolve()
        name = whole.stem if whole.suffix == RECORDING.suffix else whole.name
        if whole.name == RECORDING.name:
            name = whole.parent.name or name
        label, number = name, 1
        while part(label) in found:
            number += 1
            label = f"{name} ({number})"
        found[part(label)] = label
    return [*found.values()]


class FlightData:
    """One flight."""

    def __init__(self, label: str, recording: Recording) -> None:
        self.label = label
        self.recording = recording
        self.messages: dict[str, tuple[F8, Mapping[str, Column]]] = {}
        self.gaps: list[str] = []
        self.mission, self.world = self._mission()
        self.limits = limits_of(self.mission)
        self.planned: Tracks = tracks_of(recording)
        self.gaps += self.planned.gaps
        self.planet_radius_m = None if self.mission is None else self.mission.planet.radius_km * 1e3

    @property
    def truth(self) -> Rows:
        """The sampled truth."""
        return self.recording.truth

    def has(self, *names: str) -> bool:
        """Whether the truth was recorded with these fields."""
        return len(self.truth) > 1 and set(names) <= set(self.truth.dtype.names or ())

    def message(self, name: str) -> tuple[F8, Mapping[str, Column]]:
        """Times and signals of a message; without rows where there is no such message."""
        if name not in {message.name for message in self.recording.decoder.messages}:
            return np.zeros(0), {}
        if name not in self.messages:
            self.messages[name] = self.recording.message(name)
        return self.messages[name]

    @property
    def end_speed_mps(self) -> float:
        """Where the mission ends; 0 if it does not end by speed."""
        return 0.0 if self.mission is None else self.mission.end.speed_mps

    @functools.cached_property
    def tables(self) -> dict[str, Any]:
        """The mission as it was flown, with its overrides; the file where it is not understood."""
        if self.mission is not None:
            return self.mission.model_dump()
        try:
            return documents.toml_of(self.recording.attachment(MISSION_SUFFIX))
        except (RecordingError, documents.DocumentError):
            return {}

    def _mission(self) -> tuple[Mission | None, Any]:
        """The mission from what is attached, with the overrides it was flown with, and its world,
        whose air may be a table that is attached too."""
        attachments = self.recording.attachments
        names = [name for name in attachments if name.endswith(MISSION_SUFFIX)]
        if len(names) != 1:
            self.gaps.append("no mission is attached: no planet, limits and corridor")
            return None, None
        try:
            overrides = documents.json_of(self.recording.manifest.get(OVERRIDES, "{}").encode())
            if not isinstance(overrides, dict):
                raise documents.DocumentError("its overrides are no table")
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder, f"mission{MISSION_SUFFIX}")
                raw = documents.toml_of(attachments[names[0]])
                apply(raw, overrides)
                self._bring_table(raw, path.with_name("atmosphere.csv"))
                mission = mission_of(raw, path, echoed(names[0]))
                return mission, world_of(mission)[0]
        except (AeroshellError, ValueError, OSError, RecursionError) as error:
            reason = echoed((str(error).splitlines() or [type(error).__name__])[0])
            self.gaps.append(f"its mission is not understood, {reason}: no planet and limits")
            return None, None

    def _bring_table(self, raw: dict[str, Any], path: Path) -> None:
        """Put the table of air that is attached where the mission then finds it, whatever its name:
        a name that came with a recording leads to nothing but what is in it."""
        air = raw.get("atmosphere")
        if isinstance(air, dict) and isinstance(air.get("csv"), str):
            if air["csv"] not in self.recording.attachments:
                raise RecordingError(f"its table {echoed(air['csv'])} is not attached")
            path.write_bytes(self.recording.attachments[air["csv"]])
            air["csv"] = path.name


def limits_of(mission: Mission | None) -> PathLimits:
    """The path limits in SI; none without a mission."""
    if mission is None:
        return PathLimits(np.inf, np.inf, np.inf)
    limits = mission.limits
    return PathLimits(
        limits.heat_flux_max_kwpm2 * 1e3,
        limits.load_factor_max_g,
        limits.dynamic_pressure_max_kpa * 1e3,
    )


def open_flights(paths: list[Path]) -> list[FlightData]:
    """The flights of a review; flights over different planets are not laid over each other."""
    flights = [
        FlightData(label, open_recording(path))
        for label, path in zip(labels_of(paths), paths, strict=True)
    ]
    for path, flight in zip(paths, flights, strict=True):
        if not len(flight.truth) and not len(flight.recording.bus):
            raise RecordingError(f"{path}: holds no frame and no sample, there is nothing to show")
    known = [(p, f) for p, f in zip(paths, flights, strict=True) if f.planet_radius_m]
    for path, flight in known[1:]:
        first, own = float(known[0][1].planet_radius_m or 0), float(flight.planet_radius_m or 0)
        if abs(own - first) > SAME_RADIUS * first:
            raise RecordingError(
                f"{path}: was flown over a planet of {own / 1e3:z,.1f} km radius, {known[0][0]} "
                f"over one of {first / 1e3:z,.1f} km; flights of one planet lie over each other"
            )
    return flights
