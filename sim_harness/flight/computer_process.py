"""The flight computer as a process: started, watched, asked for its report, ended."""

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from flight_sw.boot import COMPILES, NOT_PERMITTED
from flight_sw.errors import FlightError
from flight_sw.runtime.kernel_cache import NOTICE

END_TIMEOUT_S = 3.0  # for the report and a clean exit after a stop request
PACKAGE_PARENT = Path(__file__).resolve().parents[2]
LAST_WORDS = 5  # lines of its standard error that are kept


def own_module(name: str) -> list[str]:
    """The command that runs a module of this installation; the working folder holds none."""
    return [sys.executable, "-P", "-m", name]


def own_environment() -> dict[str, str]:
    """The environment in which a process of ours imports what this one did.

    Its packages come first. Of the user's own places for modules those stay that are absolute and
    not the working folder: an empty one, as in `PYTHONPATH=$PYTHONPATH:/lib`, means just that.
    """
    here = os.getcwd()
    own = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    kept = [place for place in own if os.path.isabs(place) and not _is_same(place, here)]
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(PACKAGE_PARENT), *kept])}


def _is_same(place: str, other: str) -> bool:
    return os.path.realpath(place) == os.path.realpath(other)


class ComputerProcess:
    """`python -m flight_sw` on a bus, in a session of its own so that Ctrl-C ends only us."""

    def __init__(
        self,
        load_path: Path,
        bus_address: str,
        options: list[str],
        warn: Callable[[str], None],
    ) -> None:
        self._process = subprocess.Popen(
            [*own_module("flight_sw"), "--load", str(load_path), *options, "--bus", bus_address],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
            env=own_environment(),
        )
        self._words: list[str] = []
        self.is_compiling = False
        """It has said so; whether it has ended is for FSW_BOOT to tell."""
        self._warn = warn
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            if line.startswith(NOT_PERMITTED):
                self._warn(line.strip())
            elif line.startswith(COMPILES):
                self.is_compiling = True
            elif not line.startswith(NOTICE):  # none of these says why it ended
                self._words = [*self._words, line.strip()][-LAST_WORDS:]

    @property
    def pid(self) -> int:
        """Process number."""
        return self._process.pid

    @property
    def status(self) -> int | None:
        """Exit status, None while it runs."""
        return self._process.poll()

    def ends_within(self, seconds: float) -> bool:
        """Whether it ends by itself within so long; it may have a report to be rid of first."""
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        return True

    @property
    def last_words(self) -> str:
        """The last line of its standard error."""
        self._listener.join(0.2 if self.status is not None else 0.0)
        return next((w for w in reversed(self._words) if w), "")

    def fail_if_ended(self) -> None:
        """Raise FlightError with its last words if it has ended."""
        status = self.status
        if status is None:
            return
        how = f"ended with status {status}" if status >= 0 else f"was killed by signal {-status}"
        words = self.last_words.removeprefix("flight computer: ")
        raise FlightError(f"flight computer {how}" + (f": {words}" if words else ""))

    def report(self) -> dict[str, Any]:
        """Wait for its clean end; the report it printed, empty if there is none."""
        try:
            text, _ = self._process.communicate(timeout=END_TIMEOUT_S)
            return dict(json.loads(text.strip().splitlines()[-1]))
        except (subprocess.TimeoutExpired, json.JSONDecodeError, IndexError, ValueError):
            return {}

    def kill(self) -> None:
        """End it without asking."""
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """End it, whatever state it is in."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self.kill()
        for stream in (self._process.stdout, self._process.stderr):
            if stream is not None:
                with contextlib.suppress(OSError, ValueError):
                    stream.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
