"""What a punctual process asks of the system: scheduling, memory, a processor of its own.

Each is taken where it is permitted; where not, a line says what is missing and who grants it.
"""

import ctypes
import os

MCL_CURRENT, MCL_FUTURE = 1, 2
PRIORITY = 50  # of SCHED_FIFO: above everything that has not asked


def lock_memory() -> str:
    """Keep all pages of the process in memory; empty, or what is missing."""
    if ctypes.CDLL(None, use_errno=True).mlockall(MCL_CURRENT | MCL_FUTURE) == 0:
        return ""
    return f"memory is not locked ({os.strerror(ctypes.get_errno())}): grant `ulimit -l unlimited`"


def take_priority() -> str:
    """Run the calling thread first-in first-out; empty, or what is missing."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        return f"no real-time priority ({error.strerror}): grant `ulimit -r {PRIORITY}`"
    return ""


def take_processor(from_the_end: int) -> str:
    """Stay on one processor, counted from the last that is allowed; empty, or what is missing."""
    allowed = sorted(os.sched_getaffinity(0))
    if len(allowed) < 2:
        return f"no processor of its own: {len(allowed)} is available"
    try:
        os.sched_setaffinity(0, {allowed[-1 - from_the_end % len(allowed)]})
    except OSError as error:
        return f"no processor of its own ({error.strerror})"
    return ""
