"""One run of a campaign flown again: from its folder alone, on whatever bus."""

from pathlib import Path
from typing import Any, NamedTuple

from flight_sw.errors import FlightError
from flight_sw.runtime.jit import source_hash
from tools.campaign.folder import (
    LOAD,
    MISSION,
    read_load,
    read_manifest,
    read_samples,
    row_in,
)
from tools.campaign.job import Flyer, Job, Run
from tools.campaign.plan import SOURCES
from tools.overrides import Prepared


class Reflight(NamedTuple):
    """What is flown, and what the campaign had of it."""

    prepared: Prepared
    seed: int
    row: dict[str, Any] | None
    """The run's result; None if the campaign has not flown it."""


def job_in(folder: Path, manifest: dict[str, Any]) -> Job:
    """The job as the folder keeps it."""
    told = manifest["job"]
    load = folder / LOAD.format(law=told["law"])
    image = read_load(folder, told["law"])
    own = {"mission_file": str(folder / MISSION), "load_file": str(load)}
    kept = {key: told[key] for key in Job._fields if key in told}
    return Job(**{**kept, **own, "load_image": image})


def run_in(folder: Path, manifest: dict[str, Any], number: int) -> Run:
    """One run's values from the folder's samples."""
    n = manifest["identity"]["n"]
    if not 1 <= number <= n:
        raise FlightError(f"--run is {number}, allowed 1 to {n}")
    samples = read_samples(folder, manifest)
    values = samples.slice(number - 1, 1).to_pylist()[0]
    del values["run"]
    seed = values.pop("seed")
    told = {key: values[key] for key in manifest["told_to_both"]}
    return Run(number, values, seed, told)


def refly(folder: Path, number: int) -> Reflight:
    """One run of the campaign in a folder; raises AeroshellError with what is wrong."""
    manifest = read_manifest(folder)
    job = job_in(folder, manifest)
    run = run_in(folder, manifest, number)
    what = Flyer(job).prepared(run)
    prepared = Prepared(
        what.mission, job.law, what.load_image, Path(job.load_file), what.remade, False,
        job.case,
    )  # fmt: skip
    return Reflight(prepared, run.seed, row_in(folder, manifest, number))


def check_same(folder: Path, number: int, row: dict[str, Any], summary: dict[str, Any]) -> None:
    """Refuse a flight whose commands are not those of the campaign."""
    flown, then = summary["command_sha256"], row.get("command_sha256")
    sources = read_manifest(folder)["identity"]["sources_hash"]
    if flown != then:
        raise FlightError(
            f"run {number} of {folder} had commands {str(then)[:16]}, flown now: {flown[:16]}; "
            f"sources that give the same have the hash {sources}, these {source_hash(*SOURCES)}"
        )
