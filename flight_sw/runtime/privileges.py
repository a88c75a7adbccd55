"""What a punctual process asks of the system: scheduling, memory, a processor.

Each is taken where it is permitted; where not, a line says what is missing and who grants it.

Harness, hub and flight computer of one machine share a processor, the last that is allowed: one of
them has work at a time, and the next is then woken by a context switch of its own processor. To
wake it on another costs an interrupt, and on a virtual machine a return from the hypervisor. At
equal priority a burst is sent whole before its reader runs.
"""

import ctypes
import os

MCL_CURRENT, MCL_FUTURE = 1, 2
PRIORITY = 50  # of SCHED_FIFO: above everything that has not asked


def lock_memory(flags: int = MCL_CURRENT | MCL_FUTURE) -> str:
    """Keep the pages of the process in memory; empty, or what is missing."""
    if ctypes.CDLL(None, use_errno=True).mlockall(flags) == 0:
        return ""
    return f"memory is not locked ({os.strerror(ctypes.get_errno())}): grant `ulimit -l unlimited`"


def unlock_memory() -> None:
    """Let the system swap again."""
    ctypes.CDLL(None).munlockall()


def punctual_processor() -> int:
    """The processor that the calling thread would share with the rest of a flight."""
    return max(os.sched_getaffinity(0))


def take_priority(processor: int) -> str:
    """Run the calling thread first-in first-out on a processor; empty, or what is missing.

    Without the priority it stays free to go wherever there is room.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        return f"no real-time priority ({error.strerror}): grant `ulimit -r {PRIORITY}`"
    try:
        os.sched_setaffinity(0, {processor})
    except OSError as error:
        return f"not on processor {processor} ({error.strerror})"
    return ""


def leave_processor(processor: int) -> set[int]:
    """Keep the calling thread off a processor if there is another; returns where it was allowed."""
    allowed = os.sched_getaffinity(0)
    if others := allowed - {processor}:
        os.sched_setaffinity(0, others)
    return allowed
