"""Flies a campaign to its end: threads here, or a cluster; whatever is missing in its folder."""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from flight_sw.errors import FlightError
from tools.campaign.plan import Plan, Wanted, plan_of
from tools.campaign.pool import fly_in_threads, processors
from tools.campaign.store import Store, read_manifest, read_results, read_samples

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


def fly_all(plan: Plan, store: Store, jobs: int, progress: Progress) -> float:
    """Fly what is missing; returns the seconds that took."""
    begun_s = time.perf_counter()
    progress(store.flown, plan.n)
    for row in fly_in_threads(plan, store.to_fly(), jobs):
        store.add(row)
        progress(store.flown, plan.n)
    if not store.is_complete:
        store.finish()
    return time.perf_counter() - begun_s


def run_campaign(
    wanted: Wanted,
    out: Path,
    jobs: int | None = None,
    progress: Progress = lambda done, n: None,
) -> Campaign:
    """Fly a campaign in a folder, or what is missing of it there."""
    jobs = processors() if jobs is None else jobs
    if not 1 <= jobs <= JOBS_MAX:
        raise FlightError(f"--jobs is {jobs}, allowed 1 to {JOBS_MAX}")
    plan = plan_of(wanted)
    store = Store(out, plan)
    try:
        missing = len(store.to_fly())
        wall_s = fly_all(plan, store, jobs, progress)
        if missing or read_manifest(out)["state"] != "done":
            flown = {"flights": missing, "jobs": jobs, "wall_s": round(wall_s, 3)}
            store.write_manifest({"state": "done", "flown": flown})
    finally:
        store.close()
    return read_campaign(out)


def read_campaign(folder: Path) -> Campaign:
    """A finished campaign from its folder."""
    return Campaign(folder, read_manifest(folder), read_results(folder), read_samples(folder))


def results_of(wanted: Wanted, jobs: int | None = None) -> pa.Table:
    """The results of a campaign that is kept nowhere."""
    with tempfile.TemporaryDirectory(prefix="aeroshell-campaign-") as folder:
        return run_campaign(wanted, Path(folder), jobs).results
