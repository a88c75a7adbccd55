"""The hub's inner loop: one thread takes frames from each client and hands them to the others."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.can.libc import (
    POLLERR,
    POLLFD,
    POLLHUP,
    POLLIN,
    POLLNVAL,
    POLLOUT,
    last_errno,
    poll,
)
from flight_sw.can.sockets import (
    BATCH,
    EAGAIN,
    EINTR,
    ENOBUFS,
    copy_frame,
    new_io,
    receive_now,
    send_now,
)
from flight_sw.records.dictionary import FRAME
from flight_sw.records.types_ import Frames, Record
from sim_harness.bus.hub_log import HUB_LOG, RING_FRAMES, keep
from sim_harness.jit import kernel

CLIENTS_MAX = 32
QUEUE_FRAMES = 8192  # kept for a client whose socket is full: 128 kB, two seconds of a full bus
QUEUE_MASK = QUEUE_FRAMES - 1
WAKE, LISTENER, FIRST_CLIENT = 0, 1, 2  # rows of the poll table
POLL_ROWS = FIRST_CLIENT + CLIENTS_MAX
ROUNDS_MAX = 1 << 62  # bounds the loop in words; it ends with an event for Python

FREE, OPEN, DEAF, GONE = 0, 1, 2, 3  # states of a client's row; a deaf one may still be read
STOP, ACCEPT, CLOSED = 1, 2, 4  # events for Python
READABLE = POLLIN | POLLHUP | POLLERR | POLLNVAL
FOREVER_MS = -1

CLIENT = np.dtype(
    [
        ("fd", "i4"),
        ("state", "i4"),
        ("head", "i8"),  # frames ever queued
        ("tail", "i8"),  # frames ever taken from the queue
    ],
    align=True,
)
HUB = np.dtype(
    [
        ("fd", "i4", (FIRST_CLIENT,)),  # wake-up and listening sockets
        ("client", CLIENT, (CLIENTS_MAX,)),
        ("pollfd", POLLFD, (POLL_ROWS,)),
        ("pollfd_address", "u8"),
        ("frames_received", "i8"),
        ("frames_sent", "i8"),
        ("frames_dropped", "i8"),
    ],
    align=True,
)
"""The hub's clients and totals. It holds its own address: never copy it."""


class Buffers(NamedTuple):
    """What a hub's frames lie in."""

    queues: Frames  # (CLIENTS_MAX, QUEUE_FRAMES)
    io: npt.NDArray[np.void]
    frames: Frames  # (BATCH,)
    hub_log: npt.NDArray[np.void]  # (1,)
    ring: Frames  # of the tap; empty: nothing is kept


@kernel
def _watch(hub: Record) -> int:
    """Fill the poll table: what each connection is waited for; returns its length."""
    table = hub["pollfd"]
    clients = hub["client"]
    for row in range(FIRST_CLIENT):
        table[row]["fd"] = hub["fd"][row]
        table[row]["events"] = POLLIN
    rows = FIRST_CLIENT
    for i in range(CLIENTS_MAX):
        client = clients[i]
        entry = table[FIRST_CLIENT + i]
        if client["state"] == FREE or client["state"] == GONE:
            entry["fd"] = -1
            continue
        entry["fd"] = client["fd"]
        entry["events"] = POLLIN if client["head"] == client["tail"] else POLLIN | POLLOUT
        rows = FIRST_CLIENT + i + 1
    return rows


@kernel
def _sent(hub: Record, client: Record, moved: int) -> int:
    """Frames that a send has moved; a client that can take no more is marked deaf."""
    if moved >= 0:
        hub["frames_sent"] += moved
        return moved
    code = last_errno()
    if code not in (EAGAIN, EINTR, ENOBUFS):
        client["state"] = DEAF
    return 0


@kernel
def _flush(hub: Record, queue: Frames, io: Record, client: Record) -> None:
    """Send what waits in a client's queue, as far as there is room."""
    for _ in range(QUEUE_FRAMES):
        waiting = client["head"] - client["tail"]
        start = client["tail"] & QUEUE_MASK
        run = min(waiting, QUEUE_FRAMES - start)
        if run == 0 or client["state"] != OPEN:
            return
        moved = _sent(hub, client, send_now(client["fd"], io, queue, start, run))
        if moved == 0:
            return
        client["tail"] += moved


@kernel
def _deliver(
    hub: Record, queue: Frames, io: Record, client: Record, frames: Frames, n: int
) -> None:
    """Hand `n` frames to one client: into its socket, its queue, or nowhere."""
    done = np.int64(0)
    if client["head"] == client["tail"]:
        done += _sent(hub, client, send_now(client["fd"], io, frames, 0, n))
    if client["state"] != OPEN:
        return
    for i in range(done, n):
        if client["head"] - client["tail"] >= QUEUE_FRAMES:
            hub["frames_dropped"] += n - i
            return
        copy_frame(frames[i], queue[client["head"] & QUEUE_MASK])
        client["head"] += 1


@kernel
def _forward(hub: Record, buffers: Buffers, source: int) -> int:
    """Take a batch from one client and deliver it to the others; returns frames taken."""
    clients = hub["client"]
    io, frames = buffers.io[0], buffers.frames
    n = receive_now(clients[source]["fd"], io, frames, BATCH)
    if n < 0:
        clients[source]["state"] = GONE
        return 0
    hub["frames_received"] += n
    keep(buffers.hub_log[0], buffers.ring, frames, n)
    for i in range(CLIENTS_MAX):
        if n > 0 and i != source and clients[i]["state"] == OPEN:
            _deliver(hub, buffers.queues[i], io, clients[i], frames, n)
    return n


@kernel
def _serve(hub: Record, buffers: Buffers, rows: int) -> int:
    """Serve every connection that poll found ready; returns events for Python."""
    table = hub["pollfd"]
    clients = hub["client"]
    events = STOP if table[WAKE]["revents"] != 0 else 0
    if table[LISTENER]["revents"] != 0:
        events |= ACCEPT
    for i in range(rows - FIRST_CLIENT):
        revents = table[FIRST_CLIENT + i]["revents"]
        if revents & POLLOUT != 0:
            _flush(hub, buffers.queues[i], buffers.io[0], clients[i])
        if revents & READABLE != 0:
            _forward(hub, buffers, i)
            if clients[i]["state"] == GONE:
                events |= CLOSED
    return events


@kernel
def pump(hub: Frames, buffers: Buffers) -> int:
    """Move frames until there is something for Python to do: the events that ask for it."""
    the_hub = hub[0]
    for _ in range(ROUNDS_MAX):
        rows = _watch(the_hub)
        if poll(the_hub["pollfd_address"], np.uint64(rows), np.int32(FOREVER_MS)) <= 0:
            continue
        events = _serve(the_hub, buffers, rows)
        if events != 0:
            return events
    return 0


def new_hub() -> npt.NDArray[np.void]:
    """A hub without clients, shape (1,)."""
    hub = np.zeros(1, HUB)
    fields: Any = HUB.fields
    hub["pollfd_address"] = hub.ctypes.data + fields["pollfd"][1]
    return hub


def new_buffers(*, logged: bool) -> Buffers:
    """Empty buffers; a logged hub keeps what it moves."""
    return Buffers(
        queues=np.zeros((CLIENTS_MAX, QUEUE_FRAMES), FRAME),
        io=new_io(),
        frames=np.zeros(BATCH, FRAME),
        hub_log=np.zeros(1, HUB_LOG),
        ring=np.zeros(RING_FRAMES if logged else 0, FRAME),
    )
