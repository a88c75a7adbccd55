"""Campaigns as the report takes them: manifest, samples, results, profiles; whatever there is.

A campaign that is still flying, or was killed, is read from its journal; what is missing is named
in `notes`, and nothing is assumed in its place.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from flight_sw.errors import AeroshellError
from sim_harness.flight.outcomes import CLASSES, NOT_FLOWN
from sim_harness.mission.dispersion_keys import Requirement
from sim_harness.mission.mission import Mission
from sim_harness.mission.quantities import plain
from sim_harness.mission.requirements import Verdict, judge
from sim_harness.world.missions import mission_of
from tools.campaign.columns import TEXTS, numbers
from tools.campaign.folder import (
    JOURNAL,
    MANIFEST,
    MISSION,
    RESULTS,
    has_results,
    read_journal,
    read_manifest,
    read_results,
    read_samples,
    requirement_of,
)
from tools.campaign.profiles import Profiles, read_profiles

F8 = npt.NDArray[np.float64]
NOT_VARIED = ("run", "seed")
DONE = "done"
EXCEEDED = "limits_exceeded"


class ReportError(AeroshellError):
    """A campaign cannot be reported."""


class Source(NamedTuple):
    """One campaign."""

    folder: Path
    label: str
    manifest: dict[str, Any]
    results: pa.Table
    samples: pa.Table
    """Of the runs in `results`, row by row."""
    profiles: Profiles | None
    notes: tuple[str, ...]

    @property
    def identity(self) -> dict[str, Any]:
        """What the campaign is known by."""
        return dict(self.manifest["identity"])

    @property
    def n(self) -> int:
        """Flights asked for."""
        return int(self.identity["n"])

    @property
    def runs(self) -> npt.NDArray[np.int64]:
        """Numbers of the runs that have been flown."""
        return np.asarray(self.results["run"].to_numpy())

    @property
    def classes(self) -> npt.NDArray[np.str_]:
        """Their outcome classes."""
        return np.array(self.results["outcome_class"].to_pylist(), str)

    def values(self, key: str) -> F8:
        """A metric of all runs; NaN where it was not told or its flight means nothing."""
        if key not in self.results.column_names or key in TEXTS:
            return np.full(len(self.results), np.nan)
        values = numbers(self.results, key)
        return np.where(np.isin(self.classes, NOT_FLOWN), np.nan, values)

    def varied(self) -> dict[str, F8]:
        """The dispersed keys that differ from run to run, and their values."""
        keys = [key for key in self.samples.column_names if key not in NOT_VARIED]
        columns = {key: numbers(self.samples, key) for key in keys}
        return {key: values for key, values in columns.items() if len(set(values)) > 1}

    def requirements(self) -> list[Requirement]:
        """What the mission requires."""
        return [requirement_of(told) for told in self.manifest.get("requirements", [])]

    def verdicts(self) -> list[Verdict]:
        """The requirements judged by the flights that are there; runs by their number."""
        found = []
        for requirement in self.requirements():
            verdict = judge(requirement, self.values(requirement.metric))
            worst = verdict.worst_run
            found.append(verdict._replace(worst_run=int(self.runs[worst - 1]) if worst else None))
        return found

    def fixed(self) -> dict[str, str]:
        """What was set for every run, by the command or by the dispersion set."""
        told = self.manifest.get("fixed")
        if not isinstance(told, dict):
            return {}
        return {
            key: value if isinstance(value, str) else plain(value) for key, value in told.items()
        }

    def exceeded(self) -> list[str]:
        """The limits that each run exceeded; empty where none, or where it was not told."""
        if EXCEEDED not in self.results.column_names:
            return [""] * len(self.results)
        return [str(told or "") for told in self.results[EXCEEDED].to_pylist()]

    def counts(self) -> dict[str, int]:
        """Flights in each outcome class, all classes in their order."""
        names = list(CLASSES) + sorted(set(self.classes.tolist()) - set(CLASSES))
        return {name: int(np.sum(self.classes == name)) for name in names}

    def mission(self) -> Mission:
        """The mission before dispersions; raises AeroshellError where it is none of today's."""
        path = self.folder / MISSION
        return mission_of(self.manifest["job"]["mission_tree"], path, str(self.folder / MANIFEST))


def numeric_keys(results: pa.Table) -> list[str]:
    """Columns that hold numbers or truths, in their order."""
    kinds = (pa.types.is_floating, pa.types.is_integer, pa.types.is_boolean)
    fields = [f for f in results.schema if f.name not in NOT_VARIED]
    return [f.name for f in fields if any(kind(f.type) for kind in kinds)]


def _checked_manifest(folder: Path) -> dict[str, Any]:
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        raise ReportError(f"{folder}: {what}, allowed is the folder of a campaign")
    return read_manifest(folder)


def _results(folder: Path, manifest: dict[str, Any]) -> pa.Table:
    """The results, or as many as there are."""
    if has_results(folder):
        return read_results(folder, manifest)
    if not (folder / JOURNAL).is_file():
        raise ReportError(f"{folder}: has no results, neither {RESULTS} nor {JOURNAL} is there")
    table = read_journal(folder, manifest["identity"]["n"])
    if table is None:
        raise ReportError(f"{folder}: has no results yet, no flight of it has ended")
    return table


def read_source(folder: Path) -> Source:
    """One campaign from its folder; raises AeroshellError with what is wrong."""
    manifest = _checked_manifest(folder)
    identity = manifest["identity"]
    n = identity["n"]
    results = _results(folder, manifest)
    samples = read_samples(folder, manifest)
    runs = results["run"].to_numpy()
    notes = []
    profiles = None
    if len(results) < n:
        notes.append(
            f"incomplete: {len(results):,} of {n:,} flights have been flown, judged are those"
        )
    else:
        profiles = read_profiles(folder, n)
    if profiles is None:
        notes.append("no profiles over speed are kept: the corridor is not drawn")
    label = str(identity["law"])
    return Source(folder, label, manifest, results, samples.take(runs - 1), profiles, tuple(notes))


def read_sources(folders: Sequence[Path]) -> list[Source]:
    """Campaigns that have flown the same samples, each under a label of its own."""
    sources: list[Source] = []
    for folder in folders:
        if any(folder.resolve() == other.folder.resolve() for other in sources):
            raise ReportError(f"{folder}: is named twice")
        sources.append(read_source(folder))
    first = sources[0]
    for other in sources[1:]:
        _check_same_samples(first, other)
    labels = [source.label for source in sources]
    if len(set(labels)) < len(labels):  # one law twice: say which folder
        sources = [s._replace(label=f"{s.label} ({s.folder.name})") for s in sources]
    labels = [source.label for source in sources]
    if len(set(labels)) < len(labels):
        sources = [s._replace(label=f"{s.label} ({s.folder})") for s in sources]
    return sources


def _check_same_samples(first: Source, other: Source) -> None:
    """Refuse to compare flights that do not pair."""
    mine, theirs = first.identity, other.identity
    if mine["mission"] == theirs["mission"] and _all_samples(first).equals(_all_samples(other)):
        return
    keys = ("mission", "dispersions", "n", "seed", "samples_hash")
    differ = [key for key in keys if mine[key] != theirs[key]] or ["samples"]
    told = ", ".join(f"{key} {theirs.get(key)} (not {mine.get(key)})" for key in differ)
    raise ReportError(
        f"{other.folder}: flew other samples than {first.folder}: {told}; "
        "laws are compared on the same ones"
    )


def _all_samples(source: Source) -> pa.Table:
    return read_samples(source.folder, source.manifest)
