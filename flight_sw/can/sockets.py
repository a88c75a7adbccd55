"""Frames in and out of a bus socket, in batches, without the interpreter.

A bus socket is an AF_UNIX seqpacket connection to a hub or a raw CAN socket; both move one
`struct can_frame` a packet, and only `address.open_bus` knows the difference.
"""

import errno
from typing import Any

import numpy as np
import numpy.typing as npt

from flight_sw.can.libc import (
    IOVEC,
    MMSGHDR,
    MSG_DONTWAIT,
    MSG_NOSIGNAL,
    MSG_TRUNC,
    POLLERR,
    POLLFD,
    POLLHUP,
    POLLIN,
    POLLNVAL,
    POLLOUT,
    POLLRDHUP,
    last_errno,
    monotonic_ns,
    poll,
    recvmmsg,
    sendmmsg,
    sleep_until_ns,
)
from flight_sw.records.dictionary import FRAME
from flight_sw.records.types_ import Frames, Record
from flight_sw.runtime.jit import kernel

BUS_LOST = -1
BUS_DOWN = -2  # the interface is down: it may come back, and the socket with it
BATCH = 64  # frames moved by one system call
FRAME_SIZE = FRAME.itemsize
NS_PER_MS = 1_000_000
SEND_TIMEOUT_MS = 1000  # a bus that takes nothing for so long gets the rest of the frames never
FULL_QUEUE_PAUSE_NS = 200_000  # about the time of two frames at 1 Mbit/s; poll cannot wait for it
ATTEMPTS_MAX = 1_000_000  # bounds the loops that wait; the clock ends them first

EAGAIN, EINTR, ENOBUFS = errno.EAGAIN, errno.EINTR, errno.ENOBUFS
ECONNRESET, ENETDOWN = errno.ECONNRESET, errno.ENETDOWN
BROKEN = POLLERR | POLLHUP | POLLNVAL | POLLRDHUP
RECEIVE_FLAGS = MSG_DONTWAIT
SEND_FLAGS = MSG_DONTWAIT | MSG_NOSIGNAL


def io_dtype(capacity: int) -> np.dtype[np.void]:
    """What the kernels hand to the system: buffers, and the structures that point to them."""
    return np.dtype(
        [
            ("messages", MMSGHDR, (capacity,)),
            ("iov", IOVEC, (capacity,)),
            ("frames", FRAME, (capacity,)),
            ("pollfd", POLLFD),
            ("messages_address", "u8"),
            ("pollfd_address", "u8"),
            ("capacity", "i8"),
            ("wrong_size", "i8"),  # packets dropped because they were no frame
            ("hung_up", "i8"),  # 1 once an empty packet was seen: the other end may have closed
        ],
        align=True,
    )


def new_io(capacity: int = BATCH) -> npt.NDArray[np.void]:
    """Scratch for one socket, shape (1,). It holds its own addresses: never copy it."""
    io = np.zeros(1, io_dtype(capacity))
    fields: Any = io.dtype.fields
    address = {name: io.ctypes.data + offset[1] for name, offset in fields.items()}
    rows = np.arange(capacity, dtype=np.uint64)
    io["iov"][0]["base"] = address["frames"] + rows * FRAME_SIZE
    io["iov"][0]["size"] = FRAME_SIZE
    io["messages"][0]["iov"] = address["iov"] + rows * IOVEC.itemsize
    io["messages"][0]["iov_count"] = 1
    io["messages_address"] = address["messages"]
    io["pollfd_address"] = address["pollfd"]
    io["capacity"] = capacity
    return io


@kernel
def wait_ready(fd: int, io: Record, events: int, timeout_ms: int) -> np.int64:
    """Wait for `events` on the socket: the events that came, 0 at the time-out or a signal."""
    pollfd = io["pollfd"]
    pollfd["fd"] = fd
    pollfd["events"] = events
    pollfd["revents"] = 0
    if poll(io["pollfd_address"], np.uint64(1), np.int32(timeout_ms)) < 0:
        return np.int64(0 if last_errno() == EINTR else BROKEN)
    return np.int64(pollfd["revents"])


@kernel
def copy_frame(source: Record, target: Record) -> None:
    """Copy one frame whole."""
    target["can_id"] = source["can_id"]
    target["dlc"] = source["dlc"]
    target["pad"] = source["pad"]
    target["res0"] = source["res0"]
    target["len8_dlc"] = source["len8_dlc"]
    target["data"] = source["data"]


@kernel
def _keep_frames(io: Record, n: int, frames: Frames) -> int:
    """Copy the packets that are frames; the others are counted and dropped."""
    messages = io["messages"]
    packets = io["frames"]
    kept = 0
    for i in range(n):
        size = messages[i]["size"]
        if size == FRAME_SIZE and messages[i]["flags"] & MSG_TRUNC == 0:
            copy_frame(packets[i], frames[kept])
            kept += 1
        elif size == 0:
            io["hung_up"] = 1
        else:
            io["wrong_size"] += 1
    return kept


@kernel
def _is_hung_up(fd: int, io: Record) -> bool:
    """Whether an empty packet just received meant the end of the connection."""
    if io["hung_up"] == 0:
        return False
    io["hung_up"] = 0
    if wait_ready(fd, io, POLLIN | POLLRDHUP, 0) & BROKEN != 0:
        return True
    io["wrong_size"] += 1
    return False


@kernel
def receive_now(fd: int, io: Record, frames: Frames, capacity: int) -> int:
    """Take what lies ready, at most `capacity` frames; 0 is nothing, BUS_LOST the end.

    BUS_DOWN is told once, when the interface goes down; nothing is received until it is back.
    """
    limit = min(capacity, io["capacity"])
    for _ in range(ATTEMPTS_MAX):
        n = recvmmsg(fd, io["messages_address"], limit, RECEIVE_FLAGS, 0)
        if n < 0:
            code = last_errno()
            if code in (EINTR, ECONNRESET):
                continue  # a reset is told once, before the frames that lie in front of it
            if code == ENETDOWN:
                return BUS_DOWN
            return 0 if code == EAGAIN else BUS_LOST
        kept = _keep_frames(io, n, frames)
        if kept > 0:
            return kept
        if n == 0:
            return 0
        if _is_hung_up(fd, io):
            return BUS_LOST
    return 0


@kernel
def recv_frames(fd: int, io: Record, frames: Frames, capacity: int, timeout_ms: int) -> int:
    """Frames received, at least one unless `timeout_ms` passes first (0: do not wait).

    BUS_LOST says that no frame will come any more, BUS_DOWN that none will for a while.
    """
    n = receive_now(fd, io, frames, capacity)
    if n != 0 or timeout_ms <= 0:
        return n
    deadline_ns = monotonic_ns() + timeout_ms * NS_PER_MS
    for _ in range(ATTEMPTS_MAX):
        left_ns = deadline_ns - monotonic_ns()
        if left_ns <= 0:
            return 0
        events = wait_ready(fd, io, POLLIN, (left_ns + NS_PER_MS - 1) // NS_PER_MS)
        n = receive_now(fd, io, frames, capacity)
        if n != 0:
            return n
        if events & BROKEN != 0:
            return BUS_LOST
    return 0


@kernel
def send_now(fd: int, io: Record, frames: Frames, first: int, n: int) -> np.int64:
    """Send `frames[first:first + n]` as far as there is room; not above 0: see last_errno."""
    batch = min(n, io["capacity"])
    packets = io["frames"]
    for i in range(batch):
        copy_frame(frames[first + i], packets[i])
    return np.int64(sendmmsg(fd, io["messages_address"], batch, SEND_FLAGS))


@kernel
def _wait_for_room(fd: int, io: Record, code: int, left_ns: int) -> bool:
    """Wait until a refused send may be tried again; False if the bus is lost."""
    if code == EINTR:
        return True
    if code == ENOBUFS:
        sleep_until_ns(monotonic_ns() + FULL_QUEUE_PAUSE_NS)
        return True
    if code != EAGAIN:
        return False
    timeout_ms = (left_ns + NS_PER_MS - 1) // NS_PER_MS
    return wait_ready(fd, io, POLLOUT, timeout_ms) & BROKEN == 0


@kernel
def send_frames(fd: int, io: Record, frames: Frames, n: int) -> int:
    """Send the first `n` frames in order; returns how many went, BUS_LOST if none can go any more.

    BUS_DOWN says that some were not sent because the interface is down. Fewer than `n` only where
    the bus took nothing for SEND_TIMEOUT_MS.
    """
    sent = 0
    deadline_ns = np.int64(0)
    for _ in range(ATTEMPTS_MAX):
        if sent >= n:
            return sent
        moved = send_now(fd, io, frames, sent, n - sent)
        if moved > 0:
            sent += moved
            deadline_ns = np.int64(0)
            continue
        code = last_errno()
        if code == ENETDOWN:
            return BUS_DOWN
        now_ns = monotonic_ns()
        if deadline_ns == 0:
            deadline_ns = now_ns + SEND_TIMEOUT_MS * NS_PER_MS
        if now_ns >= deadline_ns:
            return sent
        if not _wait_for_room(fd, io, code, deadline_ns - now_ns):
            return BUS_LOST
    return sent
