"""What goes over a bus: frames, bits, rates and visible errors of each identifier, as heard.

Every frame is checked as a receiver would: length, checksum, sequence. Lengths in bits are those of
the load model, so that what is measured stands beside what was calculated.

Limits: a listener in Python; it follows a full bus at 1 Mbit/s, and what it misses is counted by
the socket. Frames with flexible data rate are not known here.
"""

import socket
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from flight_sw import icd
from flight_sw.can.address import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG, frames_dropped
from flight_sw.can.crc import POSITIONS, counter_table, crc_table
from flight_sw.can.error_frames import NO_ERRORS, Account
from flight_sw.errors import BusError
from sim_harness.bus.load_model import worst_frame_bits

CAN_FRAME = struct.Struct("<IB3x8s")  # struct can_frame
EXTENDED_BITS = 25  # more at worst than a frame with an 11-bit identifier: 80 + 10n [DAVIS07]
EXTENDED_MASK, STANDARD_MASK = 0x1FFFFFFF, 0x7FF
LISTEN_S = 0.1
MESSAGE_OF = {message.can_id: message for message in icd.LAYOUT}
CRC_TABLE = crc_table().tolist()
CRC_OF_COUNTER = {m.can_id: counter_table(m.data_ids).tolist() for m in icd.LAYOUT}


@dataclass(slots=True)
class Heard:
    """What was heard under one identifier."""

    key: int
    """The identifier, EXTENDED_FLAG with it if it has 29 bits."""
    frames: int = 0
    bits: int = 0
    wrong_length: int = 0
    wrong_crc: int = 0
    sequence_breaks: int = 0
    counter: int = -1
    data: bytes = b""
    """Of the last good frame; of the last one if the DBC does not know the identifier."""

    @property
    def message(self) -> icd.Message | None:
        """What the DBC says of it."""
        return MESSAGE_OF.get(self.key)

    @property
    def name(self) -> str:
        """The message's name, empty for a foreign identifier."""
        return self.message.name if self.message else ""

    @property
    def can_id(self) -> str:
        """The identifier as it is written."""
        if self.key & EXTENDED_FLAG:
            return f"0x{self.key & EXTENDED_MASK:08X}"
        return f"0x{self.key:03X}"

    @property
    def errors(self) -> int:
        """Frames that a receiver would refuse."""
        return self.wrong_length + self.wrong_crc + self.sequence_breaks

    def values(self) -> dict[str, float]:
        """The last good frame's signals."""
        if self.message is None or len(self.data) != icd.FRAME_BYTES:
            return {}
        word = int.from_bytes(self.data, "little")
        return {signal.name: value_of(signal, word) for signal in self.message.signals}


def value_of(signal: icd.Signal, word: int) -> float:
    """One signal of a frame word."""
    raw = (word >> signal.start_bit) & ((1 << signal.bits) - 1)
    if signal.signed and raw >> (signal.bits - 1):
        raw -= 1 << signal.bits
    return raw * signal.scale + signal.offset


def crc_of(can_id: int, data: bytes) -> int:
    """The checksum that belongs into byte 0 of one of our messages."""
    crc = int(CRC_OF_COUNTER[can_id][data[1] & 0xF])
    for position in range(POSITIONS):
        crc ^= CRC_TABLE[position][data[position + 1]]
    return crc


@dataclass
class Traffic:
    """Everything heard since it was made, or since the last `restart`."""

    heard: dict[int, Heard] = field(default_factory=dict)
    errors: Account = NO_ERRORS
    """What the interface told of itself."""
    start_s: float = field(default_factory=time.monotonic)

    @property
    def elapsed_s(self) -> float:
        """How long it has listened."""
        return max(time.monotonic() - self.start_s, 1e-9)

    @property
    def frames(self) -> int:
        """Data and remote frames of all identifiers."""
        return sum(heard.frames for heard in self.heard.values())

    @property
    def bits(self) -> int:
        """Their longest possible length on the wire."""
        return sum(heard.bits for heard in self.heard.values())

    def take(self, packet: bytes) -> None:
        """Account for one `struct can_frame`."""
        identifier, dlc, data = CAN_FRAME.unpack(packet)
        if identifier & ERROR_FLAG:
            self.errors = self.errors.plus(identifier, data)
            return
        extended = bool(identifier & EXTENDED_FLAG)
        mask = EXTENDED_MASK | EXTENDED_FLAG if extended else STANDARD_MASK
        key = identifier & mask
        heard = self.heard.get(key)
        if heard is None:
            heard = self.heard[key] = Heard(key)
        heard.frames += 1
        carried = 0 if identifier & REMOTE_FLAG else min(dlc, icd.FRAME_BYTES)
        heard.bits += worst_frame_bits(carried) + (EXTENDED_BITS if extended else 0)
        if key in MESSAGE_OF:
            _check(heard, data[:carried])
        else:
            heard.data = data[:carried]


def _check(heard: Heard, data: bytes) -> None:
    """Length, checksum and sequence of one of our messages."""
    if len(data) != icd.FRAME_BYTES:
        heard.wrong_length += 1
    elif data[0] != crc_of(heard.key, data):
        heard.wrong_crc += 1
    else:
        counter = data[1] & 0xF
        if heard.counter >= 0 and (counter - heard.counter) % icd.COUNTER_VALUES != 1:
            heard.sequence_breaks += 1
        heard.counter = counter
        heard.data = data


def listen(bus: socket.socket, traffic: Traffic, address: str, seconds: float) -> Iterator[None]:
    """Take what goes over the bus for so long, yielding about ten times a second.

    A bus that ends or goes down ends it with BusError.
    """
    end_s = time.monotonic() + seconds
    bus.settimeout(LISTEN_S)
    yield_s = time.monotonic() + LISTEN_S
    while (now_s := time.monotonic()) < end_s:
        bus.settimeout(max(min(LISTEN_S, end_s - now_s), 1e-3))
        try:
            packet = bus.recv(CAN_FRAME.size + 1)
        except TimeoutError:
            packet = None
        except ConnectionResetError:
            continue  # told once, before the frames that still lie there
        except OSError as error:
            raise BusError(f"{address}: bus lost ({error.strerror})") from error
        if packet == b"":
            raise BusError(f"{address}: the bus has ended")
        if packet is not None and len(packet) == CAN_FRAME.size:
            traffic.take(packet)
        if now_s >= yield_s:
            yield_s = now_s + LISTEN_S
            yield


def heard_as_json(heard: Heard, elapsed_s: float) -> dict[str, Any]:
    """One identifier's account for scripts."""
    return {
        "can_id": heard.can_id,
        "message": heard.name,
        "sender": heard.message.sender if heard.message else "",
        "frames": heard.frames,
        "rate_hz": heard.frames / elapsed_s,
        "wrong_length": heard.wrong_length,
        "wrong_crc": heard.wrong_crc,
        "sequence_breaks": heard.sequence_breaks,
        "data": heard.data.hex(),
        "values": heard.values(),
    }


def traffic_as_json(
    traffic: Traffic, address: str, bitrate_bps: int, bus: socket.socket
) -> dict[str, Any]:
    """The whole account for scripts."""
    elapsed_s = traffic.elapsed_s
    rows = sorted(traffic.heard.values(), key=lambda heard: heard.key)
    return {
        "bus": address,
        "listened_s": elapsed_s,
        "frames": traffic.frames,
        "frames_dropped": frames_dropped(bus),
        "foreign_frames": sum(h.frames for h in rows if not h.name),
        "error_frames": traffic.errors.frames,
        "bus_off": traffic.errors.bus_off,
        "bus_errors": list(traffic.errors.words),
        "error_counters": list(traffic.errors.counters),
        "bitrate_bps": bitrate_bps,
        "load_ratio": traffic.bits / elapsed_s / bitrate_bps,
        "messages": [heard_as_json(heard, elapsed_s) for heard in rows],
    }
