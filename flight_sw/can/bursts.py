"""Receiving the rest of a burst: the next frame is microseconds away, a sleep costs more."""

from flight_sw.can.libc import monotonic_ns
from flight_sw.can.sockets import receive_now
from flight_sw.records.types_ import Frames, Record
from flight_sw.runtime.jit import kernel

BURST_GAP_NS = 30_000  # longest wait without sleeping; a sender puts out a frame a microsecond


@kernel
def recv_rest(fd: int, io: Record, frames: Frames, capacity: int) -> int:
    """Frames that follow at once: 0 if none came within the gap, BUS_LOST at the end."""
    deadline_ns = monotonic_ns() + BURST_GAP_NS
    while True:
        n = receive_now(fd, io, frames, capacity)
        if n != 0 or monotonic_ns() > deadline_ns:
            return n
