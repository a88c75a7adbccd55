"""Frames made and read without a compiled kernel: for what is said before there is one.

The slow twin of codec and E2E: whole numbers only, unscaled.
"""

import struct
from typing import NamedTuple

from flight_sw.icd import COUNTER_VALUES, E2E_SIGNALS, FRAME_BYTES, LAYOUT, Message, layout

CAN_FRAME = struct.Struct("<IB3xQ")  # struct can_frame
COUNTER_BITS_AT = E2E_SIGNALS["e2e_counter"][0]
PROTECTION_BITS = sum(bits for _, bits in E2E_SIGNALS.values())
BYTE = 0xFF
BY_IDENTIFIER = {message.can_id: message for message in LAYOUT}


class Read(NamedTuple):
    """A frame whose checksum is right: its message, the raw values of its signals, its counter."""

    message: Message
    raw: dict[str, int]
    counter: int


def checksum(message: Message, word: int) -> int:
    """The checksum of a frame word, AUTOSAR CRC-8H2F bit by bit."""
    counter = word >> COUNTER_BITS_AT & (COUNTER_VALUES - 1)
    payload = word.to_bytes(FRAME_BYTES, "little")[1:] + bytes([message.data_ids[counter]])
    crc = BYTE
    for byte in payload:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ (0x2F if crc & 0x80 else 0)) & BYTE
    return crc ^ BYTE


def plain_frame(name: str, values: dict[str, int], counter: int) -> bytes:
    """A message as it lies on the wire."""
    message = layout(name)
    word = (counter % COUNTER_VALUES) << COUNTER_BITS_AT
    for signal in message.signals:
        word |= (values[signal.name] & ((1 << signal.bits) - 1)) << signal.start_bit
    return CAN_FRAME.pack(message.can_id, FRAME_BYTES, word | checksum(message, word))


def read_plain(packet: bytes) -> Read | None:
    """What a packet says; None unless it is a whole, unharmed frame of the DBC within its ranges.

    Ranges are those of whole, unscaled signals: of others the raw value is told as it is.
    """
    if len(packet) != CAN_FRAME.size:
        return None
    can_id, length, word = CAN_FRAME.unpack(packet)
    message = BY_IDENTIFIER.get(can_id)
    if message is None or length != FRAME_BYTES:
        return None
    if word & BYTE != checksum(message, word):
        return None
    raw, spare = {}, word >> PROTECTION_BITS << PROTECTION_BITS
    for signal in message.signals:
        mask = (1 << signal.bits) - 1
        raw[signal.name] = word >> signal.start_bit & mask
        spare &= ~(mask << signal.start_bit)
        is_whole = signal.scale == 1.0 and not signal.signed
        if is_whole and not signal.low <= raw[signal.name] <= signal.high:
            return None
    counter = word >> COUNTER_BITS_AT & (COUNTER_VALUES - 1)
    return None if spare else Read(message, raw, counter)
