"""The cyclic loop: wait for frames, step, send, account for time.

It does its own poll, receive and send through the C library with the interpreter's lock released,
and comes back to Python a few times a second so that signals are seen.
"""

import numpy as np

from flight_sw.can.bursts import recv_rest
from flight_sw.can.libc import monotonic_ns
from flight_sw.can.sockets import recv_frames, send_frames
from flight_sw.computer import minor_frame
from flight_sw.dictionary import RX_CAPACITY, TICK_ID
from flight_sw.histogram import HISTOGRAM, add
from flight_sw.jit import kernel
from flight_sw.types_ import Frames, Record

RUNNING, STOPPED, BUS_LOST = 0, 1, 2

EXECUTIVE = np.dtype(
    [
        ("cycles", "u8"),
        ("frames_received", "u8"),
        ("frames_sent", "u8"),
        ("false_ticks", "u8"),  # frames from the bus that looked like the executive's own tick
        ("step_time", HISTOGRAM),
    ],
    align=True,
)


@kernel
def _drop_false_ticks(rx: Frames, n_rx: int, executive: Record) -> int:
    kept = 0
    for i in range(n_rx):
        if rx[i]["can_id"] == TICK_ID:
            executive["false_ticks"] += 1
            continue
        if kept != i:
            rx[kept]["can_id"] = rx[i]["can_id"]
            rx[kept]["dlc"] = rx[i]["dlc"]
            rx[kept]["data"] = rx[i]["data"]
        kept += 1
    return kept


@kernel
def serve(
    fd: int,
    io: Frames,
    load: Frames,
    state: Frames,
    executive: Frames,
    rx: Frames,
    tx: Frames,
    slice_ns: int,
) -> int:
    """Serve the bus for about `slice_ns`; returns RUNNING, STOPPED or BUS_LOST.

    The records have shape (1,). A slice of zero compiles and touches everything.
    """
    end_ns = monotonic_ns() + slice_ns
    wait_ms = max(slice_ns // 1_000_000, 1)
    if slice_ns == 0:
        return RUNNING
    in_burst = False
    while True:
        n_rx = 0
        if in_burst:
            n_rx = recv_rest(fd, io[0], rx, RX_CAPACITY)
        if n_rx == 0:
            n_rx = recv_frames(fd, io[0], rx, RX_CAPACITY, wait_ms)
        start_ns = monotonic_ns()
        if n_rx < 0:
            return BUS_LOST
        if n_rx > 0:
            executive[0]["frames_received"] += n_rx
            n_rx = _drop_false_ticks(rx, n_rx, executive[0])
            n_tx = minor_frame(load[0], state[0], rx, n_rx, tx)
            in_burst = n_tx == 0
            if n_tx > 0:
                add(executive[0]["step_time"], monotonic_ns() - start_ns)
                executive[0]["cycles"] += 1
                if send_frames(fd, io[0], tx, n_tx) < 0:
                    return BUS_LOST
                executive[0]["frames_sent"] += n_tx
            if state[0]["stop"] == 1:
                return STOPPED
        if start_ns >= end_ns:
            return RUNNING
