"""Bus addresses and the sockets behind them: `unix:PATH` and `socketcan:INTERFACE`.

A flight computer's CAN socket hears only the identifiers that the other side sends, sorted out by
the kernel; a harness hears everything. Both hear the error frames of the interface.
"""

import contextlib
import errno
import os
import socket
import struct
from pathlib import Path

from flight_sw import icd
from flight_sw.can.plain import CAN_FRAME
from flight_sw.errors import BusError

UNIX_PATH_MAX_BYTES = 107  # of sockaddr_un, without the closing zero
RECEIVE_BUFFER_BYTES = 4 << 20  # asked for; without privilege the system grants less
EXTENDED_FLAG, REMOTE_FLAG, ERROR_FLAG = 0x80000000, 0x40000000, 0x20000000
STANDARD_MASK = 0x7FF
ERRORS_ALL = 0x1FFFFFFF  # every class of error frame
RESTARTED, BUS_OFF = ERROR_FLAG | 0x100, ERROR_FLAG | 0x40  # CAN_ERR_RESTARTED, CAN_ERR_BUSOFF
GREETING_TIMEOUT_S = 10.0  # a hub whose process has no time takes a while
REFUSALS = {1: "has as many clients as it takes, {} of them", 2: "belongs to another user"}
IS_FULL, IS_ANOTHERS = REFUSALS
CAN_FILTER = struct.Struct("=II")  # struct can_filter: identifier, mask
CAN_RAW_ERR_FILTER = 2  # not named by the socket module
SO_RCVBUFFORCE, SO_MEMINFO = 33, 55
MEMINFO = struct.Struct("=9I")
MEMINFO_DROPS = 8  # packets that found the receive buffer full
INTERFACE_NAME_MAX = 15


def identifiers_from(sender: str) -> tuple[int, ...]:
    """What one side of the bus sends."""
    return tuple(message.can_id for message in icd.LAYOUT if message.sender == sender)


def can_filters(identifiers: tuple[int, ...]) -> bytes:
    """CAN_RAW_FILTER for data frames with exactly these 11-bit identifiers."""
    mask = EXTENDED_FLAG | REMOTE_FLAG | STANDARD_MASK
    return b"".join(CAN_FILTER.pack(identifier, mask) for identifier in identifiers)


def frames_dropped(bus: socket.socket) -> int:
    """Frames lost so far because the socket's receive buffer was full."""
    try:
        raw = bus.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, MEMINFO.size)
    except OSError:
        return 0
    return int(MEMINFO.unpack(raw)[MEMINFO_DROPS]) if len(raw) == MEMINFO.size else 0


def _open_unix(path: str) -> socket.socket:
    size = len(os.fsencode(path))
    if size > UNIX_PATH_MAX_BYTES:
        raise BusError(
            f"unix:{path}: path of {size} bytes, a socket's has at most {UNIX_PATH_MAX_BYTES}"
        )
    bus = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        bus.connect(path)
        bus.settimeout(GREETING_TIMEOUT_S)
        greeting = bus.recv(CAN_FRAME.size)
        bus.settimeout(None)
    except TimeoutError as error:
        bus.close()
        raise BusError(
            f"unix:{path}: took no client within {GREETING_TIMEOUT_S:g} s, allowed is a hub"
        ) from error
    except OSError as error:
        bus.close()
        raise BusError(f"unix:{path}: {_unix_refusal(error, Path(path))}") from error
    if refusal := _turned_away(greeting):
        bus.close()
        raise BusError(f"unix:{path}: {refusal}")
    return bus


def greeting(reason: int = 0, detail: int = 0) -> bytes:
    """A hub's first word to a client, an error frame: the bus has begun, or why not for it."""
    return CAN_FRAME.pack(BUS_OFF if reason else RESTARTED, 8, reason | detail << 8)


def _turned_away(packet: bytes) -> str:
    """Why a hub does not take us, from its first word; empty if it does."""
    if len(packet) != CAN_FRAME.size:
        return "nobody listens there, its hub has ended" if not packet else "is no hub"
    can_id, _, data = CAN_FRAME.unpack(packet)
    if can_id == RESTARTED:
        return ""
    reason = REFUSALS.get(data & 0xFF) if can_id == BUS_OFF else None
    return reason.format(data >> 8) if reason else "is no hub"


def _unix_refusal(error: OSError, path: Path) -> str:
    if error.errno == errno.ENOENT:
        return "does not exist, start a hub there first"
    if error.errno in (errno.EACCES, errno.EPERM):
        return "no permission to connect"
    if error.errno == errno.ECONNREFUSED and not path.is_socket():
        return "is not a socket"
    if error.errno == errno.ECONNREFUSED:
        return "nobody listens there, its hub has ended"
    if error.errno == errno.EPROTOTYPE:
        return "is a socket of another kind, allowed is a seqpacket hub"
    return error.strerror or str(error)


def _exists(interface: str) -> bool:
    with contextlib.suppress(OSError):
        return socket.if_nametoindex(interface) > 0
    return False


def _can_refusal(error: OSError, interface: str) -> str:
    """Why an interface cannot be used, and how to mend it."""
    if error.errno in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
        return "this kernel has no CAN sockets, load them with `modprobe can-raw`"
    if error.errno in (errno.EACCES, errno.EPERM):
        return "no permission to open CAN sockets, run as root or with CAP_NET_RAW"
    if error.errno == errno.ENETDOWN:
        return f"interface is down, raise it with `ip link set {interface} up`"
    if error.errno in (errno.ENODEV, errno.ENXIO) and _exists(interface):
        return "is not a CAN interface, `ip link show type can` and `type vcan` list those"
    if error.errno in (errno.ENODEV, errno.ENXIO):
        return f"no such interface, `aeroshell bus up {interface}` makes a virtual one"
    return error.strerror or str(error)


def _configure(bus: socket.socket, hears: tuple[int, ...] | None) -> None:
    """Filters before the socket is bound, so that no other frame waits in it."""
    if hears is not None:
        bus.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, can_filters(hears))
    errors = struct.pack("=I", ERRORS_ALL)
    bus.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, errors)
    try:
        bus.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES)
    except OSError:
        bus.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)


def _open_socketcan(interface: str, hears: tuple[int, ...] | None) -> socket.socket:
    where = f"socketcan:{interface}"
    if len(interface) > INTERFACE_NAME_MAX:
        raise BusError(
            f"{where}: name of {len(interface)} characters, "
            f"an interface's has at most {INTERFACE_NAME_MAX}"
        )
    if not hasattr(socket, "AF_CAN"):
        raise BusError(f"{where}: this Python was built without CAN sockets")
    bus: socket.socket | None = None
    try:
        bus = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        _configure(bus, hears)
        bus.bind((interface,))
        # An interface that is down is bound without complaint; the socket's error tells.
        if code := bus.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            raise OSError(code, "cannot be used")
    except OSError as error:
        if bus is not None:
            bus.close()
        raise BusError(f"{where}: {_can_refusal(error, interface)}") from error
    return bus


def open_bus(address: str, hears: tuple[int, ...] | None = None) -> socket.socket:
    """The connected socket of a bus address, `unix:PATH` or `socketcan:INTERFACE`.

    On a CAN interface `hears` keeps all other identifiers out; a hub sends everything.
    """
    kind, colon, place = address.partition(":")
    if not colon or not place or kind not in ("unix", "socketcan"):
        raise BusError(f"bus '{address}': allowed are unix:PATH and socketcan:INTERFACE")
    return _open_unix(place) if kind == "unix" else _open_socketcan(place, hears)
