"""Flies runs in threads of this process: the compiled loop lets go of the interpreter's lock."""

import os
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any

from tools.campaign.job import Flyer
from tools.campaign.plan import Plan

AHEAD = 4  # runs in the queue for each thread: enough to keep it busy, few enough to stay flat


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0))


def fly_in_threads(plan: Plan, runs: list[int], jobs: int) -> Iterator[dict[str, Any]]:
    """The rows of runs as they end, in whatever order."""
    own = threading.local()
    onboard = Flyer(plan.job).onboard

    def fly(number: int) -> dict[str, Any]:
        if not hasattr(own, "flyer"):
            own.flyer = Flyer(plan.job, onboard)
        return own.flyer.fly(plan.run(number))

    pool = ThreadPoolExecutor(jobs, thread_name_prefix="flight")
    waiting: set[Future[dict[str, Any]]] = set()
    numbers = iter(runs)
    try:
        while True:
            while len(waiting) < AHEAD * jobs and (number := next(numbers, None)) is not None:
                waiting.add(pool.submit(fly, number))
            if not waiting:
                return
            ended, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in ended:
                yield future.result()
    finally:
        pool.shutdown(cancel_futures=True)
