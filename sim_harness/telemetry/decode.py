"""CAN frames to signal values in bulk, compiled, after the same DBC as the flight codec.

This is the ground's decoder. It takes the messages of any of our DBC files, so that a recording
made with another one is still read, and it shares nothing with the flight codec but the DBC.
"""

import functools
import logging
import math
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from flight_sw import icd
from flight_sw.can.crc import POSITIONS, counter_table, crc_table
from flight_sw.errors import IcdError, RecordingError
from flight_sw.icd import FRAME_BYTES, Message
from flight_sw.records.dictionary import CAN_ID_MASK
from flight_sw.records.types_ import F8, U8
from flight_sw.runtime.echo import echoed
from sim_harness.jit import kernel

I8 = npt.NDArray[np.int64]
Rows = npt.NDArray[np.void]

logging.getLogger("cantools").addHandler(logging.NullHandler())  # a refusal says it, or nobody

NO_SLOT = -1
DBC_BYTES_MAX = 1 << 17  # ours has a sixth
WIDTH_MAX = 8 * FRAME_BYTES
QUOTED = re.compile(rb'"(?:\\"|[^"])*?"')
WIDTHS = re.compile(rb":\s*(\d+)|\|\s*(\d+)\s*@")
"""Where a message says how long it is, and a signal where it begins and how long it is."""
TICK_SLACK = 1e-6  # of a sample interval: k / rate may come out just below the whole number
CRC_TABLE = crc_table()
BYTE, NIBBLE, BYTE_BITS = np.uint64(0xFF), np.uint64(0xF), np.uint64(8)

SIGNAL = np.dtype(
    [
        ("shift", "u8"),
        ("mask", "u8"),  # of the raw value, after the shift
        ("sign", "u8"),  # the raw value's sign bit, 0 for an unsigned signal
        ("scale", "f8"),
        ("offset", "f8"),
    ],
    align=True,
)

MESSAGE = np.dtype(
    [
        ("n_signals", "i8"),
        ("crc_counter", "u1", (icd.COUNTER_VALUES,)),  # share of the data id in the checksum
        ("signals", SIGNAL, (8 * FRAME_BYTES,)),  # none has fewer bits than one
    ],
    align=True,
)


@kernel
def _judge(rows: Rows, slot_of_id: I8, messages: Rows, slots: I8) -> None:
    """Write the message of each frame; NO_SLOT where identifier, length or checksum is wrong."""
    for i in range(len(rows)):
        frame = rows[i]["frame"]
        slots[i] = NO_SLOT
        can_id = frame["can_id"]
        if can_id > CAN_ID_MASK or frame["dlc"] != FRAME_BYTES:
            continue
        slot = slot_of_id[can_id]
        if slot == NO_SLOT:
            continue
        rest = frame["data"] >> BYTE_BITS
        crc = np.uint64(messages[slot]["crc_counter"][rest & NIBBLE])
        for position in range(POSITIONS):
            crc ^= np.uint64(CRC_TABLE[position, rest & BYTE])
            rest >>= BYTE_BITS
        if crc == frame["data"] & BYTE:
            slots[i] = slot


@kernel
def _decode(slots: I8, data: U8, messages: Rows, raw: I8, physical: F8) -> None:
    """Write raw and physical values, one row a frame."""
    for i in range(len(slots)):
        message = messages[slots[i]]
        for k in range(message["n_signals"]):
            signal = message["signals"][k]
            bits = (data[i] >> signal["shift"]) & signal["mask"]
            value = np.int64(bits ^ signal["sign"]) - np.int64(signal["sign"])
            raw[i, k] = value
            physical[i, k] = value * signal["scale"] + signal["offset"]


@kernel
def _pick(t_s: F8, kinds: I8, rate_hz: float, last_tick: I8, picked: I8) -> int:
    """Write the indexes of the first of each kind in every interval; returns how many."""
    n = 0
    for i in range(len(kinds)):
        kind = kinds[i]
        if kind == NO_SLOT:
            continue
        tick = np.int64(math.floor(t_s[i] * rate_hz + TICK_SLACK))
        if tick > last_tick[kind]:
            last_tick[kind] = tick
            picked[n] = i
            n += 1
    return n


class Sampler:
    """Picks the first of each kind in every interval of the sample rate."""

    def __init__(self, rate_hz: float, kinds: int) -> None:
        self._rate_hz = float(rate_hz)
        self._last_tick = np.full(kinds, -1)

    def pick(self, t_s: F8, kinds: I8) -> I8:
        """Indexes of the rows to keep, ascending; rows of NO_SLOT are not kept."""
        picked = np.empty(len(kinds), np.int64)
        t_s = np.ascontiguousarray(t_s)
        return picked[: _pick(t_s, kinds, self._rate_hz, self._last_tick, picked)]


def messages_of(dbc: bytes) -> tuple[Message, ...]:
    """The messages of a DBC that came with a recording, in slot order."""
    if dbc == icd.DBC_PATH.read_bytes():
        return icd.LAYOUT
    _check_size(dbc)
    with tempfile.NamedTemporaryFile(suffix=".dbc") as file:
        file.write(dbc)
        file.flush()
        try:
            messages = icd.load_messages(Path(file.name))
        except IcdError as error:
            raise IcdError(echoed(error)) from error
        except Exception as error:  # of a library's parser: whatever a hostile text leads it to
            raise IcdError(echoed(str(error).partition("\n")[0] or type(error).__name__)) from error
    if not messages:
        raise IcdError("it has no message")
    return messages


def _check_size(dbc: bytes) -> None:
    """Refuse what would take the parser long, or much memory, before it sees it."""
    if len(dbc) > DBC_BYTES_MAX:
        raise IcdError(f"it has {len(dbc):,} bytes, allowed are {DBC_BYTES_MAX:,}")
    places = WIDTHS.finditer(QUOTED.sub(b"", dbc))
    if wide := [found[0] for found in places if int((found[1] or found[2])[:10]) > WIDTH_MAX]:
        text = echoed(wide[0].decode(errors="replace"))
        raise IcdError(f"'{text}' is in it, allowed are {FRAME_BYTES} bytes and {WIDTH_MAX} bits")


class Decoder:
    """Bit positions, scales and checksums of all messages, by slot."""

    def __init__(self, messages: Sequence[Message]) -> None:
        self.messages = tuple(messages)
        self.width = max(len(message.signals) for message in messages)
        self._slot_of_id = np.full(CAN_ID_MASK + 1, NO_SLOT)
        self._table = np.zeros(len(messages), MESSAGE)
        for slot, message in enumerate(messages):
            self._slot_of_id[message.can_id] = slot
            self._table["n_signals"][slot] = len(message.signals)
            self._table["crc_counter"][slot] = counter_table(message.data_ids)
            for i, signal in enumerate(message.signals):
                mask = (1 << signal.bits) - 1
                sign = (mask >> 1) + 1 if signal.signed else 0
                entry = (signal.start_bit, mask, sign, signal.scale, signal.offset)
                self._table["signals"][slot, i] = entry

    def slot(self, name: str) -> int:
        """The number of a message."""
        names = [message.name for message in self.messages]
        if name not in names:
            raise RecordingError(f"no message {name}, the DBC has {echoed(', '.join(names))}")
        return names.index(name)

    def slots(self, rows: Rows) -> I8:
        """The message in each frame; NO_SLOT where identifier, length or checksum is wrong."""
        slots = np.empty(len(rows), np.int64)
        _judge(rows, self._slot_of_id, self._table, slots)
        return slots

    def values(self, slots: I8, data: U8) -> tuple[I8, F8]:
        """Raw and physical values, one row a frame; columns beyond the message's signals are 0."""
        raw = np.zeros((len(slots), self.width), np.int64)
        physical = np.zeros((len(slots), self.width))
        _decode(slots, np.ascontiguousarray(data), self._table, raw, physical)
        return raw, physical

    def columns(self, slot: int, data: U8) -> dict[str, F8 | I8]:
        """Signals of one message by name: integers where the DBC has no scale, else floats."""
        raw, physical = self.values(np.full(len(data), slot), data)
        return {
            s.name: raw[:, i] if s.scale == 1.0 and s.offset == 0.0 else physical[:, i]
            for i, s in enumerate(self.messages[slot].signals)
        }


@functools.lru_cache(maxsize=8)
def decoder_of(dbc: bytes) -> Decoder:
    """The decoder for a DBC that came with a recording; its tables are made once."""
    return Decoder(messages_of(dbc))
