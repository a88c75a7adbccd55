"""Lets several processes fill one kernel cache at the same time.

numba numbers a new cache file by reading the index, then writes index and file without a lock. Two
processes that compile one kernel for different argument types at the same moment take the same
number, and the index may then lead one signature to the other's machine code. Both are written
under a lock here; the harness, the flight computer and parallel test workers share a cache.
"""

import fcntl
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core.caching import IndexDataCacheFile

LOCK_NAME = ".lock"


def _locked(save: Callable[..., None]) -> Callable[..., None]:
    @functools.wraps(save)
    def save_alone(self: Any, *args: Any) -> None:
        with (Path(self._cache_path) / LOCK_NAME).open("ab") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # released when the file closes, whatever happens
            save(self, *args)

    return save_alone


def serialise_saves() -> None:
    """From here on this process saves compiled kernels one process at a time; once is enough."""
    if not hasattr(IndexDataCacheFile.save, "__wrapped__"):
        IndexDataCacheFile.save = _locked(  # type: ignore[method-assign]
            IndexDataCacheFile.save
        )
