"""Flies a campaign to its end: threads here, or a cluster; whatever is missing in its folder."""

import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from flight_sw.errors import FlightError
from sim_harness.flight.outcomes import NOT_FLOWN
from tools.campaign.cluster import Cluster
from tools.campaign.folder import read_manifest, read_results, read_samples
from tools.campaign.job import Flyer
from tools.campaign.plan import Plan, Wanted, plan_of
from tools.campaign.pool import fly_in_threads, processors
from tools.campaign.store import Store
from tools.campaign.verdict import check_metrics, judged

JOBS_MAX = 1024


class Campaign(NamedTuple):
    """A finished campaign."""

    folder: Path
    manifest: dict[str, Any]
    results: pa.Table
    samples: pa.Table

    def column(self, name: str) -> Any:
        """A column of the results as a numpy array."""
        return self.results[name].to_numpy()


Progress = Callable[[int, int], None]
"""Told how many flights are done, and of how many."""


def keep_all(plan: Plan, store: Store, rows: Iterable[dict[str, Any]], progress: Progress) -> None:
    """Keep rows as they come; the first flown one shows whether the requirements can be judged."""
    checked = False
    for row in rows:
        if not checked and row["outcome_class"] not in NOT_FLOWN:
            check_metrics(plan.requirements, row)
            checked = True
        store.add(row)
        progress(store.flown, plan.n)


def fly_missing(
    plan: Plan, store: Store, jobs: int, address: str | None, progress: Progress
) -> dict[str, Any]:
    """Fly what is missing; returns how that went."""
    runs = store.to_fly()
    cluster = Cluster(address) if address is not None and runs else None
    try:
        if cluster is None and runs:
            Flyer(plan.job).compiled()
        begun_s, begun_cpu_s = time.perf_counter(), time.process_time()
        progress(store.flown, plan.n)
        rows = cluster.fly(plan, runs) if cluster else fly_in_threads(plan, runs, jobs)
        keep_all(plan, store, rows, progress)
        at_a_time = cluster.threads() if cluster else jobs
    finally:
        if cluster is not None:
            cluster.close()
    wall_s = round(time.perf_counter() - begun_s, 3)
    cpu_s = round(time.process_time() - begun_cpu_s, 3)  # of this process alone
    return {"flights": len(runs), "jobs": at_a_time, "wall_s": wall_s, "cpu_s": cpu_s}


def run_campaign(
    wanted: Wanted,
    out: Path,
    jobs: int | None = None,
    progress: Progress = lambda done, n: None,
    cluster: str | None = None,
) -> Campaign:
    """Fly a campaign in a folder, or what is missing of it there."""
    jobs = processors() if jobs is None else jobs
    if not 1 <= jobs <= JOBS_MAX:
        raise FlightError(f"--jobs is {jobs}, allowed 1 to {JOBS_MAX}")
    plan = plan_of(wanted)
    store = Store(out, plan)
    try:
        if not store.is_complete:
            flown = fly_missing(plan, store, jobs, cluster, progress)
            store.finish()
            store.write_manifest({"state": "flown", "flown": flown})
        manifest = read_manifest(out)
        if manifest["state"] != "done":
            verdict = judged(out, manifest, plan.requirements)
            how = manifest.get("flown")
            store.write_manifest({"state": "done", "flown": how, "verdict": verdict})
    finally:
        store.close()
    return read_campaign(out)


def read_campaign(folder: Path) -> Campaign:
    """A finished campaign from its folder."""
    manifest = read_manifest(folder)
    return Campaign(
        folder, manifest, read_results(folder, manifest), read_samples(folder, manifest)
    )


def results_of(wanted: Wanted, jobs: int | None = None) -> pa.Table:
    """The results of a campaign that is kept nowhere."""
    with tempfile.TemporaryDirectory(prefix="aeroshell-campaign-") as folder:
        return run_campaign(wanted, Path(folder), jobs).results
