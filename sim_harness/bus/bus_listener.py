"""What the harness hears: every frame of the bus in its one order, its own among them.

What the flight computer hears is the ground's frames and everybody else's, in the order in which
the bus took them. A sender does not hear itself, so that order is not the harness's to know: where
others send too, a log of what was sent and what was heard mixes the two wrongly, and a replay goes
another way. The bus listener is a second connection, which hears the first. On a hub of our own it
is a ring that the hub fills, and costs no system call.

It is emptied once in a minor frame, behind the answer: a foreign frame that comes later is logged
with the time of the next one, in its right place.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.can.sockets import new_io, receive_now
from flight_sw.records.dictionary import FRAME, RX_CAPACITY
from flight_sw.records.types_ import Frames, Record
from sim_harness.bus.hub_log import HUB_LOG, RING_FRAMES, RING_MASK
from sim_harness.fence import memory_fence
from sim_harness.jit import kernel
from sim_harness.telemetry.logs import Logs, log_frame

NO_SOCKET = -1
NO_FRAMES = np.zeros(0, FRAME)


class BusListener(NamedTuple):
    """A socket to hear with, or what a hub of our own keeps."""

    fd: int
    io: npt.NDArray[np.void]
    rx: Frames
    hub_log: npt.NDArray[np.void]  # (1,)
    ring: Frames  # empty: there is no such hub


def socket_listener(fd: int) -> BusListener:
    """A bus listener with a connection of its own."""
    return BusListener(
        fd, new_io(RX_CAPACITY), np.zeros(RX_CAPACITY, FRAME), np.zeros(1, HUB_LOG), NO_FRAMES
    )


def hub_listener(hub_log: npt.NDArray[np.void], ring: Frames) -> BusListener:
    """A bus listener on a hub of our own, which fills the ring."""
    return BusListener(NO_SOCKET, new_io(1), np.zeros(RX_CAPACITY, FRAME), hub_log, ring)


def no_listener() -> BusListener:
    """A bus listener that hears nothing."""
    return BusListener(NO_SOCKET, new_io(1), NO_FRAMES, np.zeros(1, HUB_LOG), NO_FRAMES)


@kernel
def _hear_hub(harness: Record, logs: Logs, listener: BusListener, most: int) -> int:
    """Log what the hub has kept, at most so many frames; what was overwritten is counted."""
    log = listener.hub_log[0]
    kept = log["kept"]
    memory_fence()
    missed = kept - log["taken"] - RING_FRAMES
    if missed > 0:
        harness["bus_rows_lost"] += missed
        log["taken"] += missed
    n = min(kept - log["taken"], most)
    for i in range(n):
        log_frame(harness, logs, listener.ring[(log["taken"] + i) & RING_MASK])
    memory_fence()
    torn = log["claimed"] - log["taken"] - RING_FRAMES
    if torn > 0:  # overwritten while they were copied
        harness["bus_rows_lost"] += min(torn, n)
    log["taken"] += n
    return n


@kernel
def _hear_socket(harness: Record, logs: Logs, listener: BusListener) -> int:
    n = receive_now(listener.fd, listener.io[0], listener.rx, RX_CAPACITY)
    for i in range(n):
        log_frame(harness, logs, listener.rx[i])
    return n


@kernel
def hear(harness: Record, logs: Logs, listener: BusListener, batches: int) -> int:
    """Log what has come, at most so many times RX_CAPACITY frames; how many there were."""
    if harness["has_bus_listener"] == 0:
        return 0
    if len(listener.ring) > 0:
        return _hear_hub(harness, logs, listener, batches * RX_CAPACITY)
    total = 0
    for _ in range(batches):
        n = _hear_socket(harness, logs, listener)
        total += max(n, 0)
        if n < RX_CAPACITY:
            break
    return total
