"""The one place where compiler flags and the kernel cache are chosen.

fastmath stays off: it lets the compiler assume that NaN cannot happen, and the non-finite checks
in the kernels would then be removed. Compiled kernels are kept in a folder named after a hash of
every source file they can depend on (numba itself only looks at the file a kernel stands in), so
that a changed constant, callee or DBC never meets a stale kernel.
"""

import contextlib
import hashlib
import os
import platform
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

from flight_sw.kernel_cache import serialise_saves

FLAGS: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "fastmath": False,
    "error_model": "numpy",
    # No reference counts: they are atomic, and shared by the threads of a campaign. A kernel that
    # would allocate is refused by the compiler.
    "_nrt": False,
    # Kernels are small: the calls between them cost a flight in memory a seventh of its time.
    "forceinline": True,
}
CACHE_VARIABLE = "AEROSHELL_CACHE_DIR"
SOURCE_SUFFIXES = (".py", ".dbc")
FLIGHT_ROOT = Path(__file__).parent
config: Any = numba.config
FOLDERS_KEPT = 12  # versions of the sources whose kernels stay cached, most recently used first


def cache_root() -> Path:
    """Folder that holds the compiled kernels of every version of the sources."""
    if chosen := os.environ.get(CACHE_VARIABLE):
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "aeroshell"


def source_hash(*roots: Path) -> str:
    """Hash over all sources below `roots`, the compiler's version and its debug switches."""
    digest = hashlib.sha256()
    digest.update(f"{numba.__version__} {np.__version__} {platform.python_version()}".encode())
    digest.update(f"boundscheck={config.BOUNDSCHECK}".encode())
    for root in roots:
        for path in sorted(p for p in root.rglob("*") if p.suffix in SOURCE_SUFFIXES):
            digest.update(str(path.relative_to(root.parent)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _open_folder(folder: Path) -> None:
    """Make the cache folder, mark it used, and drop those not used for longest."""
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        others = sorted(folder.parent.iterdir(), key=lambda p: p.stat().st_mtime, reverse=True)
        for old in others[FOLDERS_KEPT:]:
            shutil.rmtree(old, ignore_errors=True)


def kernel_decorator(*roots: Path) -> Callable[..., Any]:
    """The decorator of all kernels that depend on nothing outside `roots`."""
    folder = str(cache_root() / source_hash(*roots))
    _open_folder(Path(folder))
    serialise_saves()

    def kernel(function: Callable[..., Any]) -> Any:
        before = config.CACHE_DIR
        config.CACHE_DIR = folder
        try:
            return numba.njit(function, **FLAGS)
        finally:
            config.CACHE_DIR = before

    return kernel


kernel = kernel_decorator(FLIGHT_ROOT)
