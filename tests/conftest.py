"""What all tests share: where compiled kernels are kept, what an uncompiled pass leaves out.

The rules of a session are here too: no test takes for ever, any order will do (`--order-seed`), and
only so many tests may be skipped because the machine did not keep time.
"""

import os
import random
import signal
import tempfile
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import numba
import pytest
from hypothesis import settings
from numba.core import config

from flight_sw.runtime import jit, kernel_cache
from tests import allowances

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


def pytest_addoption(parser: pytest.Parser) -> None:
    """The order of tests is an option: none may depend on those before it."""
    parser.addoption(
        "--order-seed", type=int, default=None, metavar="N",
        help="shuffle test files, and the tests in each, by this seed",
    )  # fmt: skip


def shuffle(items: list[pytest.Item], seed: int) -> None:
    """Put files in another order, and the tests in each; a file's tests stay together."""
    chosen = random.Random(seed)
    files: dict[Path, list[pytest.Item]] = {}
    for item in items:
        files.setdefault(item.path, []).append(item)
    groups = list(files.values())
    chosen.shuffle(groups)
    for group in groups:
        chosen.shuffle(group)
    items[:] = [item for group in groups for item in group]


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Shuffle if asked to; without compiled kernels skip what says nothing of the interpreter."""
    seed = config.getoption("--order-seed")
    if seed is not None:
        shuffle(items, seed)
    if UNCOMPILED:
        skip = pytest.mark.skip(reason="jit_only, and NUMBA_DISABLE_JIT is set")
        for item in items:
            if item.get_closest_marker("jit_only"):
                item.add_marker(skip)


def _limited(item: pytest.Item) -> Generator[None, object, object]:
    """One phase of a test, ended by an alarm when it takes too long.

    Where not even the alarm is heard, in compiled code that spins, `faulthandler_timeout` ends the
    process.
    """
    is_slow = item.get_closest_marker("slow") is not None
    limit_s = allowances.TIME_LIMIT_SLOW_S if is_slow else allowances.TIME_LIMIT_S

    def ring(*_: object) -> None:
        pytest.fail(f"took more than {limit_s:g} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        return (yield)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, object, object]:
    """Fixtures have a time limit."""
    return (yield from _limited(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Tests have a time limit."""
    return (yield from _limited(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, object, object]:
    """What ends fixtures has a time limit."""
    return (yield from _limited(item))


_slipped: list[str] = []


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note which tests were skipped because the machine did not keep time."""
    if report.skipped and allowances.SLIPPED in report.longreprtext:
        _slipped.append(report.nodeid)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say which tests the machine's slips took from this session, and how many may be."""
    if _slipped:
        terminalreporter.section("skipped because the machine slipped")
        for name in _slipped:
            terminalreporter.line(name)
        count, most = len(_slipped), allowances.SLIPPED_MAX
        judged = "allowed" if count <= most else "too many"
        terminalreporter.line(f"{count} skipped, at most {most}: {judged}")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """A session that the machine's slips took too many tests from has failed."""
    is_worker = hasattr(session.config, "workerinput")
    if len(_slipped) > allowances.SLIPPED_MAX and not is_worker:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


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
