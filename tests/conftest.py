"""What all tests share: where compiled kernels are kept, and what an uncompiled pass leaves out."""

import os
import signal
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import pytest
from hypothesis import settings
from numba.core import config

from flight_sw import jit, kernel_cache

UNCOMPILED = bool(config.DISABLE_JIT)

settings.register_profile("repeatable", derandomize=True, deadline=None, database=None)
settings.load_profile("repeatable")


def _keeps_kernels(folder: kernel_cache.KernelFolder) -> bool:
    """Whether kernels will be found there again; it is there from here on."""
    try:
        folder.open()
        tempfile.TemporaryFile(dir=folder.path).close()
    except OSError:
        return False
    return folder.trusted()


# Before any kernel is imported: where the usual folder cannot be used, this session has one of
# its own. Parallel workers and the processes that tests start inherit the variable.
if not _keeps_kernels(jit.kernel_folder(jit.FLIGHT_ROOT)):
    _SESSION_CACHE = tempfile.TemporaryDirectory(prefix="aeroshell-kernels-")
    os.environ[jit.CACHE_VARIABLE] = _SESSION_CACHE.name
    jit.kernel = jit.kernel_decorator(jit.FLIGHT_ROOT)

# Tests interrupt processes that they start. A suite that was itself started in the background
# inherits an ignored SIGINT, and would hand it on.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what says nothing about the interpreter when kernels are not compiled."""
    if UNCOMPILED:
        skip = pytest.mark.skip(reason="jit_only, and NUMBA_DISABLE_JIT is set")
        for item in items:
            if item.get_closest_marker("jit_only"):
                item.add_marker(skip)


@pytest.fixture(scope="session")
def repo_root() -> Path:
    """The folder that holds pyproject.toml."""
    return Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def fresh_compile() -> Callable[..., Any]:
    """Compile a kernel anew, for the types of the arguments given, and return the dispatcher.

    A kernel that came out of the cache has machine code but no text; this copy has both, with all
    the kernels that it calls linked in: `copy.inspect_asm(copy.signatures[0])`. Tests that use it
    are `jit_only`.
    """

    def compile_copy(kernel: Any, *args: Any) -> Any:
        copy = numba.jit(kernel.py_func, **kernel.targetoptions)
        copy.compile(tuple(numba.typeof(arg) for arg in args))
        return copy

    return compile_copy
