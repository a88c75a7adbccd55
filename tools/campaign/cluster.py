"""Flies runs on a Dask cluster: its address is all that is given.

A worker gets the job once, and a few runs at a time; what it needs is in the job, nothing is read
from this machine's disk. A worker that dies gives its runs back; a cluster that goes away ends the
campaign with what has been flown, to be gone on with later.
"""

import logging
import queue
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from typing import Any

from flight_sw.errors import FlightError
from tools.campaign.job import Flyer, Job, Run
from tools.campaign.plan import Plan

BATCH = 8  # runs a task: a second or so
AHEAD = (
    3  # tasks out for each thread of the cluster: enough to keep it busy, few enough to stay flat
)
CONNECT_S = 15.0
LOOK_S = 2.0  # longest wait for a result before the cluster is looked at
GONE_S = 30.0  # without a scheduler or any worker: the cluster is gone
RESULT_S = 30.0  # to bring a finished result here
LOGGERS = ("distributed", "distributed.client", "distributed.core", "distributed.comm")
FLYERS: dict[int, Flyer] = {}  # in a worker: one for each thread, of the last job


def same(job: Job) -> Job:
    """The job as a task, so that a worker that dies with it does not take it away."""
    return job


def fly_batch(job: Job, runs: list[Run]) -> list[dict[str, Any]]:
    """What a worker does: fly these runs."""
    me = threading.get_ident()
    if me not in FLYERS or FLYERS[me].job is not job:
        FLYERS[me] = Flyer(job)
    return [FLYERS[me].fly(run) for run in runs]


def batches(plan: Plan, runs: list[int]) -> Iterator[list[Run]]:
    """Runs in tasks."""
    for first in range(0, len(runs), BATCH):
        yield [plan.run(number) for number in runs[first : first + BATCH]]


class Cluster:
    """A connection to a cluster, and the tasks that are out."""

    def __init__(self, address: str) -> None:
        import distributed

        for name in LOGGERS:  # a lost cluster is told in one sentence, not in their tracebacks
            logging.getLogger(name).setLevel(logging.CRITICAL)
        client_of: Any = distributed.Client  # its signature is not typed
        self.address = address
        self._idle_since_s: float | None = None
        try:
            self.client: Any = client_of(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise FlightError(
                f"--cluster {address}: no Dask scheduler answers there ({error})"
            ) from error
        try:
            self.client.wait_for_workers(1, timeout=CONNECT_S)
        except (OSError, TimeoutError) as error:
            self.close()
            raise FlightError(
                f"--cluster {address}: has no worker after {CONNECT_S:g} s"
            ) from error

    def threads(self) -> int:
        """Flights that the cluster flies at a time; 0 when nobody is there."""
        with suppress(OSError, TimeoutError):
            if self.client.status == "running":
                return int(sum(self.client.nthreads().values()))
        return 0

    def _lost(self, reason: str) -> FlightError:
        return FlightError(
            f"--cluster {self.address}: {reason}; what was flown is kept, "
            "the same command goes on with it"
        )

    def _look(self) -> int:
        """Threads at work; raises when there have been none for long."""
        threads = self.threads()
        now_s = time.monotonic()
        if threads:
            self._idle_since_s = None
        elif self._idle_since_s is None:
            self._idle_since_s = now_s
        elif now_s - self._idle_since_s > GONE_S:
            raise self._lost(f"no scheduler or no worker for {GONE_S:g} s")
        return threads

    def _rows(self, future: Any) -> list[dict[str, Any]]:
        from distributed import KilledWorker

        try:
            return list(future.result(timeout=RESULT_S))
        except KilledWorker as error:
            raise self._lost("workers died over and over") from error
        except (CancelledError, OSError, TimeoutError) as error:
            raise self._lost("the cluster is gone") from error

    def fly(self, plan: Plan, runs: list[int]) -> Iterator[dict[str, Any]]:
        """The rows of runs as they end, in whatever order."""
        done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        waiting = batches(plan, runs)
        job = self.client.submit(same, plan.job, pure=False)
        threads = self.threads()
        out: set[Any] = set()
        while True:
            while len(out) < max(threads, 1) * AHEAD and (batch := next(waiting, None)):
                future = self.client.submit(fly_batch, job, batch, pure=False)
                out.add(future)
                future.add_done_callback(done.put)
            if not out:
                return
            try:
                future = done.get(timeout=LOOK_S)
            except queue.Empty:
                threads = self._look()
                continue
            out.discard(future)
            yield from self._rows(future)

    def close(self) -> None:
        """Let go of the cluster; tasks that are out are given up."""
        with suppress(OSError, TimeoutError):
            self.client.close(timeout=CONNECT_S)
