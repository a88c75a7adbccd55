"""A campaign on a Dask cluster: the same results, whoever dies meanwhile."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from distributed import LocalCluster

from flight_sw.errors import FlightError
from tools.campaign import cluster
from tools.campaign.engine import run_campaign
from tools.campaign.folder import RESULTS
from tools.campaign.plan import Wanted

pytestmark = pytest.mark.jit_only

SHORT = Wanted("hyperion-1", "severe", 20, 3, "lqy", ("end.time_max_s=10",))
LONGER = SHORT._replace(n=64, settings=("end.time_max_s=60",))


def content(folder: Path) -> bytes:
    return (folder / RESULTS).read_bytes()


def test_a_cluster_gives_the_results_of_threads(tmp_path):
    run_campaign(SHORT, tmp_path / "here", 2)
    with LocalCluster(n_workers=2, processes=False, dashboard_address=None) as there:
        run_campaign(SHORT, tmp_path / "there", cluster=there.scheduler_address)
    assert content(tmp_path / "there") == content(tmp_path / "here")


def test_an_address_without_a_scheduler_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 0.5)
    with pytest.raises(FlightError, match=r"--cluster tcp://127\.0\.0\.1:9: no Dask scheduler"):
        run_campaign(SHORT, tmp_path, cluster="tcp://127.0.0.1:9")


def test_a_cluster_without_workers_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 1.0)
    with (
        LocalCluster(n_workers=0, processes=False, dashboard_address=None) as empty,
        pytest.raises(FlightError, match="has no worker after 1 s"),
    ):
        run_campaign(SHORT, tmp_path, cluster=empty.scheduler_address)


class Once:
    """Does something when so many flights are done, once."""

    def __init__(self, at: int, act) -> None:
        self.at, self.act, self.done = at, act, False

    def __call__(self, flown: int, n: int) -> None:
        if flown >= self.at and not self.done:
            self.done = True
            self.act()


@pytest.mark.slow
def test_a_killed_worker_loses_no_flight(tmp_path):
    run_campaign(LONGER, tmp_path / "here", 2)
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as there:
        victim = next(iter(there.workers.values())).pid
        kill = Once(9, lambda: os.kill(victim, signal.SIGKILL))
        run_campaign(LONGER, tmp_path / "there", None, kill, there.scheduler_address)
    assert kill.done
    assert content(tmp_path / "there") == content(tmp_path / "here")


@pytest.fixture
def scheduler() -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A scheduler and a worker as processes of their own."""
    started = []

    def start(*arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "distributed.cli.dask_scheduler", *arguments]
        if arguments[0].startswith("tcp:"):
            command[2] = "distributed.cli.dask_worker"
        started.append(subprocess.Popen(command, stderr=subprocess.PIPE, text=True))
        return started[-1]

    first = start("--port", "0", "--no-dashboard", "--host", "127.0.0.1")
    lines = iter(first.stderr)
    address = next(w for line in lines for w in line.split() if w.startswith("tcp://"))
    start(address, "--nthreads", "2", "--no-dashboard")
    yield first, address
    for process in started:
        process.kill()
        process.wait()


@pytest.mark.slow
def test_a_cluster_that_goes_away_leaves_what_was_flown(tmp_path, scheduler, monkeypatch):
    process, address = scheduler
    monkeypatch.setattr(cluster, "GONE_S", 3.0)
    with pytest.raises(FlightError, match="what was flown is kept"):
        run_campaign(LONGER, tmp_path / "there", None, Once(9, process.kill), address)
    flown = run_campaign(LONGER, tmp_path / "there", 2)
    assert flown.manifest["flown"]["flights"] <= LONGER.n - 9
    run_campaign(LONGER, tmp_path / "here", 2)
    assert content(tmp_path / "there") == content(tmp_path / "here")
