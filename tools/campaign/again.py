"""One run of a campaign flown again: from its folder alone, on whatever bus."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet as pq

from flight_sw.errors import FlightError
from flight_sw.jit import source_hash
from tools.campaign.job import Flyer, Job, Run
from tools.campaign.plan import SOURCES
from tools.campaign.store import (
    JOURNAL,
    LOAD,
    MISSION,
    RESULTS,
    read_manifest,
    read_samples,
)
from tools.overrides import Prepared


class Again(NamedTuple):
    """What is flown, and what the campaign had of it."""

    prepared: Prepared
    seed: int
    row: dict[str, Any] | None
    """The run's result; None if the campaign has not flown it."""


def job_in(folder: Path, manifest: dict[str, Any]) -> Job:
    """The job as the folder keeps it."""
    told = manifest["job"]
    load = folder / LOAD.format(law=told["law"])
    try:
        image = load.read_bytes()
    except OSError as error:
        raise FlightError(f"{load}: cannot be read ({error.strerror})") from error
    own = {"mission_file": str(folder / MISSION), "load_file": str(load)}
    return Job(**{**told, **own}, load_image=image)


def run_in(folder: Path, manifest: dict[str, Any], number: int) -> Run:
    """One run's values from the folder's samples."""
    n = int(manifest["identity"]["n"])
    if not 1 <= number <= n:
        raise FlightError(f"--run is {number}, allowed 1 to {n}")
    samples = read_samples(folder)
    values = samples.slice(number - 1, 1).to_pylist()[0]
    del values["run"]
    seed = values.pop("seed")
    told = {key: values[key] for key in manifest["told_to_both"]}
    return Run(number, values, seed, told)


def row_in(folder: Path, number: int) -> dict[str, Any] | None:
    """One run's result, from a finished campaign or one that has been stopped."""
    if (folder / RESULTS).is_file():
        rows = pq.read_table(folder / RESULTS, filters=[("run", "=", number)]).to_pylist()
        return rows[0] if rows else None
    if not (folder / JOURNAL).is_file():
        return None
    for line in (folder / JOURNAL).read_text(encoding="utf-8").splitlines():
        if f'"run": {number},' in line and (row := json.loads(line))["run"] == number:
            return dict(row)
    return None


def again(folder: Path, number: int) -> Again:
    """One run of the campaign in a folder; raises AeroshellError with what is wrong."""
    manifest = read_manifest(folder)
    job = job_in(folder, manifest)
    run = run_in(folder, manifest, number)
    what = Flyer(job).prepared(run)
    prepared = Prepared(
        what.mission, job.law, what.load_image, Path(job.load_file), what.remade, False
    )
    return Again(prepared, run.seed, row_in(folder, number))


def check_same(folder: Path, number: int, row: dict[str, Any], summary: dict[str, Any]) -> None:
    """Refuse a flight whose commands are not those of the campaign."""
    flown, then = summary["command_sha256"], row.get("command_sha256")
    sources = read_manifest(folder)["identity"]["sources_hash"]
    if flown != then:
        raise FlightError(
            f"run {number} of {folder} had commands {str(then)[:16]}, flown now: {flown[:16]}; "
            f"sources that give the same have the hash {sources}, these {source_hash(*SOURCES)}"
        )
