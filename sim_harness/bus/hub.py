"""A CAN bus between processes without a kernel module: a hub of seqpacket connections.

Every packet is one `struct can_frame` and goes unchanged to every other client, in one order for
all of them. A client that does not read is given QUEUE_FRAMES of patience; what comes beyond is
dropped for that client alone, and counted. Frames move in compiled code with the interpreter's
lock released; Python only takes in new clients and closes those that left.
"""

import contextlib
import errno
import os
import socket
import struct
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np

from flight_sw.can.address import IS_ANOTHERS, IS_FULL, UNIX_PATH_MAX_BYTES, greeting
from flight_sw.errors import BusError
from flight_sw.runtime.privileges import punctual_processor, take_priority
from sim_harness.bus.bus_listener import BusListener, hub_listener
from sim_harness.bus.pump import (
    ACCEPT,
    CLIENTS_MAX,
    CLOSED,
    FREE,
    GONE,
    LISTENER,
    OPEN,
    STOP,
    WAKE,
    new_buffers,
    new_hub,
    pump,
)

BACKLOG = 16
SEND_BUFFER_BYTES = 1 << 20  # asked for; the system may grant less
STOP_TIMEOUT_S = 5.0
ROOT = 0
PEER = struct.Struct("3i")  # struct ucred: process, user, group


@dataclass(frozen=True, slots=True)
class HubStats:
    """What the hub has moved since it was started."""

    clients: int
    connections: int
    frames_received: int
    frames_sent: int
    frames_dropped: int
    packets_refused: int
    clients_refused: int


def _is_live(path: Path) -> bool:
    """Whether somebody listens on the socket file."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
        try:
            probe.connect(str(path))
        except OSError as error:
            return error.errno != errno.ECONNREFUSED
        return True


def _listen(path: Path) -> socket.socket:
    """The listening socket on `path`; a socket file left by a dead hub is removed first."""
    size = len(os.fsencode(path))
    if size > UNIX_PATH_MAX_BYTES:
        raise BusError(
            f"{path}: path of {size} bytes, a socket's has at most {UNIX_PATH_MAX_BYTES}"
        )
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        if path.is_socket() and not _is_live(path):
            path.unlink()
        listener.bind(str(path))
        path.chmod(0o600)
        listener.listen(BACKLOG)
        listener.setblocking(False)
    except OSError as error:
        listener.close()
        raise BusError(f"{path}: {_refusal(error, path)}") from error
    return listener


def _refusal(error: OSError, path: Path) -> str:
    if error.errno == errno.EADDRINUSE and path.is_socket():
        return "in use by another hub"
    if error.errno == errno.EADDRINUSE:
        return "exists and is not a socket"
    if error.errno == errno.ENOENT:
        return f"folder {path.parent} does not exist"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"no permission to create a socket in {path.parent}"
    return error.strerror or str(error)


class Hub:
    """A running bus on a socket file: `with Hub(path) as hub: ...`, or start() and stop().

    A prompt hub is there for real time: nothing but its equals keeps it waiting, where the system
    permits it. Any other lets the sender finish its burst before it takes the processor. A logged
    hub keeps what it moves for a bus listener in this process. Clients of other users than its own
    and the superuser are turned away, whatever the socket file permits.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        prompt: bool = False,
        logged: bool = False,
        tell: Callable[[str], object] = lambda text: None,
    ) -> None:
        self.path = Path(path)
        self.prompt = prompt
        self._hub = new_hub()
        self._buffers = new_buffers(logged=logged)
        self._clients: dict[int, socket.socket] = {}
        self._connections = self._refused = 0
        self._tell = tell
        self._thread: threading.Thread | None = None

    def start(self) -> "Hub":
        """Listen, and move frames from here on; everything is compiled when this returns."""
        self._listener = _listen(self.path)
        self._inode = self.path.stat().st_ino
        self._waker, self._wake = socket.socketpair()
        self._hub["fd"][0, WAKE] = self._wake.fileno()
        self._hub["fd"][0, LISTENER] = self._listener.fileno()
        self._waker.send(b"\0")
        self._pump()  # compiles; returns at once because of the byte
        self._wake.recv(1)
        self._processor = punctual_processor()
        self._thread = threading.Thread(target=self._run, name="bus-hub", daemon=True)
        self._thread.start()
        return self

    def stop(self) -> None:
        """Close every connection and remove the socket file; calling it twice does no harm."""
        if self._thread is None:
            return
        self._waker.send(b"\0")
        self._thread.join(STOP_TIMEOUT_S)
        self._thread = None
        for one in (*self._clients.values(), self._listener, self._waker, self._wake):
            one.close()
        self._clients.clear()
        with contextlib.suppress(FileNotFoundError):
            if self.path.stat().st_ino == self._inode:
                self.path.unlink()

    def __enter__(self) -> "Hub":
        return self.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    @property
    def stats(self) -> HubStats:
        """Totals so far."""
        hub = self._hub[0]
        return HubStats(
            clients=len(self._clients),
            connections=self._connections,
            frames_received=int(hub["frames_received"]),
            frames_sent=int(hub["frames_sent"]),
            frames_dropped=int(hub["frames_dropped"]),
            packets_refused=int(self._buffers.io["wrong_size"][0]),
            clients_refused=self._refused,
        )

    @property
    def bus_listener(self) -> BusListener:
        """What hears everything that a logged hub moves."""
        return hub_listener(self._buffers.hub_log, self._buffers.ring)

    def _pump(self) -> int:
        return int(pump(self._hub, self._buffers))

    def _run(self) -> None:
        if self.prompt:
            take_priority(self._processor)  # where it is permitted
        else:
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        while True:
            events = self._pump()
            if events & STOP:
                return
            if events & CLOSED:
                self._close_gone()
            if events & ACCEPT:
                self._accept()

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError, ConnectionAbortedError):
            client, _ = self._listener.accept()
            row = int(np.argmax(self._hub["client"][0]["state"] == FREE))
            process, user, _ = PEER.unpack(
                client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, PEER.size)
            )
            if user not in (ROOT, os.geteuid()):
                self._turn_away(client, IS_ANOTHERS, f"process {process} of user {user}")
                return
            if self._hub["client"][0]["state"][row] != FREE:
                self._turn_away(client, IS_FULL, f"client {CLIENTS_MAX + 1}, process {process}")
                return
            with contextlib.suppress(OSError):  # it may have left already
                client.send(greeting(), socket.MSG_NOSIGNAL)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
            self._connections += 1
            self._clients[row] = client
            self._hub["client"][0][row] = (client.fileno(), OPEN, 0, 0)

    def _turn_away(self, client: socket.socket, reason: int, who: str) -> None:
        """Tell a client why it is not taken, and whoever runs the hub that it was not."""
        self._refused += 1  # counted and told by the time that the client knows
        self._tell(f"unix:{self.path}: {who} was turned away")
        with client, contextlib.suppress(OSError):
            client.send(greeting(reason, CLIENTS_MAX), socket.MSG_NOSIGNAL)

    def _close_gone(self) -> None:
        state = self._hub["client"][0]["state"]
        for row in [row for row in self._clients if state[row] == GONE]:
            self._clients.pop(row).close()
            state[row] = FREE
