"""The one place where compiler flags and the kernel cache are chosen.

fastmath stays off: it lets the compiler assume that NaN cannot happen, and the non-finite checks
in the kernels would then be removed. Compiled kernels are kept in a folder named after a hash of
every source file they can depend on (numba itself only looks at the file a kernel stands in), so
that a changed constant, callee or DBC never meets a stale kernel.
"""

import hashlib
import os
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np

from flight_sw.runtime.kernel_cache import KernelCache, KernelFolder

FLAGS: dict[str, Any] = {
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
VERSIONS = (
    numba.__version__, llvmlite.__version__, np.__version__, platform.python_version(),
)  # fmt: skip
SOURCE_SUFFIXES = (".py", ".dbc")
FLIGHT_ROOT = Path(__file__).parents[1]
config: Any = numba.config
NOWHERE = Path(os.devnull) / "kernels"  # cannot be made: kernels are compiled in memory


def cache_root() -> Path:
    """Folder that holds the compiled kernels of every version of the sources."""
    try:
        if chosen := os.environ.get(CACHE_VARIABLE):
            return Path(chosen).absolute()
        base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
        return Path(base).absolute() / "aeroshell"
    except (OSError, RuntimeError):  # the working folder was removed, the user has no home
        return NOWHERE


def source_hash(*roots: Path) -> str:
    """Hash over all sources below `roots`, the compiler's version and its debug switches."""
    digest = hashlib.sha256()
    digest.update(" ".join(VERSIONS).encode())
    digest.update(f"boundscheck={config.BOUNDSCHECK}".encode())
    for root in roots:
        for path in sorted(p for p in root.rglob("*") if p.suffix in SOURCE_SUFFIXES):
            digest.update(str(path.relative_to(root.parent)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def kernel_folder(*roots: Path) -> KernelFolder:
    """Where the compiled kernels of these sources are kept; made when the first is saved."""
    return KernelFolder(cache_root() / source_hash(*roots))


def kernel_decorator(*roots: Path, inlined: bool = True) -> Callable[..., Any]:
    """The decorator of all kernels that depend on nothing outside `roots`."""
    folder = kernel_folder(*roots)
    flags = {**FLAGS, "forceinline": inlined}

    def kernel(function: Callable[..., Any]) -> Any:
        compiled = numba.njit(function, **flags)
        if not config.DISABLE_JIT:
            compiled._cache = KernelCache(function, folder)
        return compiled

    return kernel


kernel = kernel_decorator(FLIGHT_ROOT)
seldom_kernel = kernel_decorator(FLIGHT_ROOT, inlined=False)
"""For what no nominal cycle runs: it is called, since every copy of it would be compiled again."""
