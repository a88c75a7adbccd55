"""A clock that only goes on when it is looked at or slept by, for loops that keep time.

The loops are run in the interpreter with this clock and a simulated bus in place of the C
library's calls; what they call beside these stays compiled. So their accounts of time can be
compared with closed forms, on any machine.
"""

from types import ModuleType

import pytest

LOOK_NS = 200  # that a look at the clock takes
WAKE_NS = 60_000  # that a sleeper wakes late


class Clock:
    """Nanoseconds of a machine that does nothing else."""

    def __init__(self) -> None:
        self.now_ns = 1_000_000_000

    def look(self) -> int:
        self.now_ns += LOOK_NS
        return self.now_ns

    def sleep_until(self, deadline_ns: int) -> int:
        self.now_ns = max(self.now_ns, int(deadline_ns) + WAKE_NS)
        return 0

    def wait(self, arrival_ns: int | None, wait_ms: int) -> bool:
        """Wait for an arrival, or so long at most; whether it came."""
        end_ns = self.now_ns + int(wait_ms) * 1_000_000
        if arrival_ns is None or arrival_ns > end_ns:
            self.now_ns = end_ns
            return False
        self.now_ns = max(self.now_ns, arrival_ns)
        return True


def interpret(patch: pytest.MonkeyPatch, module: ModuleType, clock: Clock, **calls: object) -> None:
    """Run a module's own kernels in the interpreter, by this clock and with these calls."""
    for name, kernel in list(vars(module).items()):
        python = getattr(kernel, "py_func", None)
        if python is not None and python.__module__ == module.__name__:
            patch.setattr(module, name, python)
    patch.setattr(module, "monotonic_ns", clock.look)
    patch.setattr(module, "sleep_until_ns", clock.sleep_until)
    for name, call in calls.items():
        patch.setattr(module, name, call)
