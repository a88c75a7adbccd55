"""Campaigns as the report takes them: manifest, samples, results, profiles; whatever there is.

A campaign that is still flying, or was killed, is read from its journal; what is missing is named
in `notes`, and nothing is assumed in its place.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import ValidationError

from flight_sw.errors import AeroshellError
from sim_harness.dispersion_keys import Requirement
from sim_harness.mission import Mission, mission_of
from sim_harness.outcomes import CLASSES, NOT_FLOWN
from sim_harness.quantities import plain
from sim_harness.requirements import Verdict, judge
from tools.campaign.profiles import Profiles, read_profiles
from tools.campaign.store import JOURNAL, MANIFEST, RESULTS, SAMPLES, read_manifest, read_samples

F8 = npt.NDArray[np.float64]
NEEDED = ("mission", "law", "load_crc32", "dispersions", "n", "seed", "samples_hash")
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
        if key not in self.results.column_names:
            return np.full(len(self.results), np.nan)
        values = self.results[key].cast(pa.float64()).to_numpy(zero_copy_only=False)
        return np.where(np.isin(self.classes, NOT_FLOWN), np.nan, values)

    def varied(self) -> dict[str, F8]:
        """The dispersed keys that differ from run to run, and their values."""
        keys = [key for key in self.samples.column_names if key not in NOT_VARIED]
        columns = {key: self.samples[key].cast(pa.float64()).to_numpy() for key in keys}
        return {key: values for key, values in columns.items() if len(set(values)) > 1}

    def requirements(self) -> list[Requirement]:
        """What the mission requires."""
        return [_requirement(told) for told in self.manifest.get("requirements", [])]

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
        try:
            tree, file = self.manifest["job"]["mission_tree"], self.manifest["job"]["mission_file"]
        except (KeyError, TypeError) as error:
            raise ReportError(f"{self.folder / MANIFEST}: keeps no mission") from error
        return mission_of(tree, Path(str(file)), str(self.folder / MANIFEST))


def _requirement(told: dict[str, Any]) -> Requirement:
    """A requirement as the manifest keeps it, bounds that it does not have being null."""
    return Requirement.model_validate({k: v for k, v in told.items() if v is not None})


def numeric_keys(results: pa.Table) -> list[str]:
    """Columns that hold numbers or truths, in their order."""
    kinds = (pa.types.is_floating, pa.types.is_integer, pa.types.is_boolean)
    fields = [f for f in results.schema if f.name not in NOT_VARIED]
    return [f.name for f in fields if any(kind(f.type) for kind in kinds)]


def _checked_manifest(folder: Path) -> dict[str, Any]:
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        raise ReportError(f"{folder}: {what}, allowed is the folder of a campaign")
    manifest = read_manifest(folder)
    identity = manifest.get("identity") if isinstance(manifest, dict) else None
    missing = [key for key in NEEDED if not isinstance(identity, dict) or key not in identity]
    if missing:
        raise ReportError(f"{folder / MANIFEST}: says no {missing[0]}: not a campaign's manifest")
    for told in manifest.get("requirements", []):
        try:
            _requirement(told)
        except (ValidationError, AeroshellError, ValueError) as error:
            raise ReportError(f"{folder / MANIFEST}: a requirement cannot be read") from error
    return manifest


def _from_journal(folder: Path) -> pa.Table:
    """What a campaign has flown so far."""
    rows: dict[int, dict[str, Any]] = {}
    try:
        lines = (folder / JOURNAL).read_bytes().split(b"\n")
    except OSError as error:
        raise ReportError(
            f"{folder}: has no results, neither {RESULTS} nor {JOURNAL} is there"
        ) from error
    for line in lines:
        try:
            row = json.loads(line)
            rows[int(row["run"])] = row
        except (ValueError, KeyError, TypeError):
            continue  # the line that is being written, or was when the writer was killed
    if not rows:
        raise ReportError(f"{folder}: has no results yet, no flight of it has ended")
    keys = dict.fromkeys(key for run in sorted(rows) for key in rows[run])
    return pa.table({key: [rows[run].get(key) for run in sorted(rows)] for key in keys})


def _results(folder: Path, n: int) -> pa.Table:
    """The results, checked against the manifest."""
    path = folder / RESULTS
    if not path.is_file():
        return _from_journal(folder)
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        told = str(error).split("\n", maxsplit=1)[0]
        raise ReportError(f"{path}: cannot be read ({told})") from error
    for key in ("run", "outcome_class"):
        if key not in table.column_names:
            raise ReportError(f"{path}: has no column {key}: not the results of a campaign")
    if len(table) != n:
        raise ReportError(f"{path}: has {len(table):,} flights, {MANIFEST} says {n:,}")
    return table


def read_source(folder: Path) -> Source:
    """One campaign from its folder; raises AeroshellError with what is wrong."""
    manifest = _checked_manifest(folder)
    identity = manifest["identity"]
    n = int(identity["n"])
    results = _results(folder, n)
    samples = read_samples(folder)
    runs = results["run"].to_numpy()
    if len(samples) != n or runs.min() < 1 or runs.max() > n:
        raise ReportError(f"{folder / SAMPLES}: has {len(samples):,} rows, {MANIFEST} says {n:,}")
    notes = []
    profiles = None
    if len(results) < n:
        notes.append(
            f"incomplete: {len(results):,} of {n:,} flights have been flown, judged are those"
        )
    else:
        profiles = read_profiles(folder)
    if profiles is None:
        notes.append("no profiles over speed are kept: the corridor is not drawn")
    elif len(profiles.runs) != n:
        raise ReportError(f"{folder}: has profiles of {len(profiles.runs):,} flights, not {n:,}")
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
    return read_samples(source.folder)
