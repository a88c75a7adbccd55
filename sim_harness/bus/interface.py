"""The hub's bus for python-can: `can.Bus(interface="aeroshell", channel=PATH)`.

So its tools work on it: `python -m can.logger -i aeroshell -c PATH`, `can.viewer`, `can.player`.
"""

import errno
import select
import socket
import struct
import time
from typing import Any

import can

from flight_sw.can.address import open_bus
from flight_sw.errors import BusError
from flight_sw.records.dictionary import FRAME

CAN_FRAME = struct.Struct("<IB3x8s")  # struct can_frame
EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000
IDENTIFIER_MASK = 0x1FFFFFFF
FRAME_BYTES_MAX = 8


def bytes_of(message: can.Message) -> bytes:
    """A message as one `struct can_frame`."""
    if message.is_fd or message.dlc > FRAME_BYTES_MAX:
        raise can.CanOperationError(f"frame of {message.dlc} bytes, this bus carries 0 to 8")
    identifier = message.arbitration_id
    identifier |= EXTENDED if message.is_extended_id else 0
    identifier |= REMOTE if message.is_remote_frame else 0
    identifier |= ERROR if message.is_error_frame else 0
    return CAN_FRAME.pack(identifier, message.dlc, bytes(message.data))


def message_of(packet: bytes, timestamp_s: float) -> can.Message:
    """The message in one `struct can_frame`."""
    identifier, dlc, data = CAN_FRAME.unpack(packet)
    dlc = min(dlc, FRAME_BYTES_MAX)
    is_remote = bool(identifier & REMOTE)
    return can.Message(
        timestamp=timestamp_s,
        arbitration_id=identifier & IDENTIFIER_MASK,
        is_extended_id=bool(identifier & EXTENDED),
        is_remote_frame=is_remote,
        is_error_frame=bool(identifier & ERROR),
        dlc=dlc,
        data=None if is_remote else data[:dlc],
    )


class UnixBus(can.BusABC):
    """One client of a hub; `channel` is the path of its socket file."""

    def __init__(self, channel: str, can_filters: Any = None, **settings: Any) -> None:
        try:
            self._socket = open_bus(f"unix:{channel}")
        except BusError as error:
            raise can.CanInitializationError(str(error)) from error
        self.channel = channel
        self.channel_info = f"aeroshell bus {channel}"
        self._can_protocol = can.CanProtocol.CAN_20
        super().__init__(channel=channel, can_filters=can_filters, **settings)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one frame; CanTimeoutError if the bus takes it not within `timeout` seconds."""
        packet = bytes_of(msg)
        deadline_s = None if timeout is None else time.monotonic() + timeout
        while True:
            left_s = None if deadline_s is None else max(0.0, deadline_s - time.monotonic())
            try:
                _, writable, _ = select.select([], [self._socket], [], left_s)
                if not writable:
                    raise can.exceptions.CanTimeoutError(f"{self.channel_info} took no frame")
                self._socket.send(packet, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
            except BlockingIOError:
                continue
            except (OSError, ValueError) as error:
                raise self._lost(error) from error
            return

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        deadline_s = None if timeout is None else time.monotonic() + timeout
        while True:
            left_s = None if deadline_s is None else max(0.0, deadline_s - time.monotonic())
            try:
                readable, _, _ = select.select([self._socket], [], [], left_s)
                if not readable:
                    return None, False
                packet = self._socket.recv(FRAME.itemsize + 1, socket.MSG_DONTWAIT)
            except BlockingIOError:
                continue
            except OSError as error:
                if error.errno == errno.ECONNRESET:
                    continue  # told once, before the frames that still lie there
                raise self._lost(error) from error
            except ValueError as error:
                raise self._lost(error) from error
            if not packet:
                raise can.CanOperationError(f"{self.channel_info} has ended")
            if len(packet) == FRAME.itemsize:
                return message_of(packet, time.time()), False

    def _lost(self, error: Exception) -> can.CanOperationError:
        reason = getattr(error, "strerror", None) or "connection closed"
        return can.CanOperationError(f"{self.channel_info}: {reason}")

    def fileno(self) -> int:
        """The socket's number, for select and for python-can's notifier."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Leave the bus."""
        super().shutdown()
        self._socket.close()
