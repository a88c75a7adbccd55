"""Signals to frame words and back: a frame is one little-endian 64-bit word.

All that the kernels need to know of a message stands in one record of flat arrays, built from the
DBC at boot. Rounding and scaling are those of cantools: to the nearest raw value, ties to even.
Bits that belong to no signal are sent as zero, and a received word that has one set is refused.
"""

import functools

import numpy as np
import numpy.typing as npt

from flight_sw.can.crc import POSITIONS, counter_table, crc_table
from flight_sw.icd import (
    COUNTER_VALUES,
    E2E_SIGNALS,
    FRAME_BYTES,
    LAYOUT,
    N_MESSAGES,
    N_VALUES,
    NODES,
    Message,
    Signal,
)
from flight_sw.records.dictionary import CAN_ID_MASK
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel

OK = 0
OUT_OF_RANGE = 1  # a value outside its signal's range, or not a number
NO_SLOT = -1
PROTECTION = sum(((1 << bits) - 1) << first for first, bits in E2E_SIGNALS.values())
WORD = (1 << 64) - 1
NO_BITS = np.uint64(0)
BASE_CYCLE_MS = 20  # one minor frame at the rate the DBC is written for

CODEC = np.dtype(
    [
        ("slot_of_id", "i4", (CAN_ID_MASK + 1,)),  # NO_SLOT where the DBC has no message
        ("can_id", "u4", (N_MESSAGES,)),
        ("sender", "u4", (N_MESSAGES,)),  # number in icd.NODES
        ("period_cycles", "i8", (N_MESSAGES,)),  # minor frames from one to the next, at least 1
        ("dlc", "u1", (N_MESSAGES,)),
        ("first_value", "u4", (N_MESSAGES,)),  # of a message, in the flat vector of values
        ("n_signals", "u4", (N_MESSAGES,)),  # unsigned: no index from the end to be told apart
        ("spare", "u8", (N_MESSAGES,)),  # bits of a word that belong to nothing
        ("shift", "u8", (N_VALUES,)),
        ("mask", "u8", (N_VALUES,)),  # of the raw value, after the shift
        ("sign", "u8", (N_VALUES,)),  # the raw value's sign bit, 0 for an unsigned signal
        ("raw_low", "i8", (N_VALUES,)),
        ("raw_high", "i8", (N_VALUES,)),
        ("scale", "f8", (N_VALUES,)),
        ("offset", "f8", (N_VALUES,)),
        ("low", "f8", (N_VALUES,)),
        ("high", "f8", (N_VALUES,)),
        ("crc", "u1", (POSITIONS, 256)),  # share of each data byte in the checksum
        ("crc_counter", "u1", (N_MESSAGES, COUNTER_VALUES)),  # share of data id and constants
    ],
    align=True,
)
"""The layout of every message, as the kernels read it."""


def _fill_signal(codec: Record, index: int, signal: Signal) -> None:
    mask = (1 << signal.bits) - 1
    raw_low = round((signal.low - signal.offset) / signal.scale)
    raw_high = round((signal.high - signal.offset) / signal.scale)
    codec["shift"][index] = signal.start_bit
    codec["mask"][index] = mask
    codec["sign"][index] = (mask >> 1) + 1 if signal.signed else 0
    codec["raw_low"][index] = raw_low
    codec["raw_high"][index] = raw_high
    codec["scale"][index] = signal.scale
    codec["offset"][index] = signal.offset
    # A limit that was received must not be refused for the last bit of its product.
    codec["low"][index] = min(signal.low, raw_low * signal.scale + signal.offset)
    codec["high"][index] = max(signal.high, raw_high * signal.scale + signal.offset)


def _fill_message(codec: Record, slot: int, first_value: int, message: Message) -> None:
    codec["slot_of_id"][message.can_id] = slot
    codec["can_id"][slot] = message.can_id
    codec["sender"][slot] = NODES.index(message.sender)
    codec["period_cycles"][slot] = max(1, message.cycle_ms // BASE_CYCLE_MS)
    codec["dlc"][slot] = FRAME_BYTES
    codec["first_value"][slot] = first_value
    codec["n_signals"][slot] = len(message.signals)
    codec["crc_counter"][slot] = counter_table(message.data_ids)
    used = sum(((1 << s.bits) - 1) << s.start_bit for s in message.signals)
    codec["spare"][slot] = ~(used | PROTECTION) & WORD
    for index, signal in enumerate(message.signals, start=first_value):
        _fill_signal(codec, index, signal)


@functools.cache
def build_codec() -> npt.NDArray[np.void]:
    """The codec of the DBC's messages: shape (1,), read-only."""
    codec = np.zeros(1, CODEC)
    codec["slot_of_id"] = NO_SLOT
    codec["crc"] = crc_table()
    first_value = 0
    for slot, message in enumerate(LAYOUT):
        _fill_message(codec[0], slot, first_value, message)
        first_value += len(message.signals)
    codec.setflags(write=False)
    return codec


@kernel
def raw_value(codec: Record, index: int, word: np.uint64) -> np.int64:
    """The raw value of one signal."""
    raw = (word >> codec["shift"][index]) & codec["mask"][index]
    sign = codec["sign"][index]
    return np.int64(raw ^ sign) - np.int64(sign)


@kernel
def in_range(codec: Record, slot: int, word: np.uint64) -> bool:
    """Whether every signal of the word lies in its range, and no bit is set that has no meaning."""
    if word & codec["spare"][slot] != NO_BITS:
        return False
    first = codec["first_value"][slot]
    low = codec["raw_low"]
    high = codec["raw_high"]
    for i in range(first, first + codec["n_signals"][slot]):
        raw = raw_value(codec, i, word)
        if raw < low[i] or raw > high[i]:
            return False
    return True


@kernel
def unpack(codec: Record, slot: int, word: np.uint64, values: F8) -> int:
    """Write the word's signals into `values`; one out of range refuses all of them."""
    if not in_range(codec, slot, word):
        return OUT_OF_RANGE
    first = codec["first_value"][slot]
    scale = codec["scale"]
    offset = codec["offset"]
    for i in range(first, first + codec["n_signals"][slot]):
        values[i] = raw_value(codec, i, word) * scale[i] + offset[i]
    return OK


@kernel
def pack(codec: Record, slot: int, values: F8) -> tuple[np.uint64, int]:
    """The word that carries a message's `values`, without protection, and a status.

    A value out of its range or not a number refuses the word: it is zero and must not be sent.
    """
    first = codec["first_value"][slot]
    word = np.uint64(0)
    for i in range(first, first + codec["n_signals"][slot]):
        value = values[i]
        if not codec["low"][i] <= value <= codec["high"][i]:
            return np.uint64(0), OUT_OF_RANGE
        raw = np.int64(round((value - codec["offset"][i]) / codec["scale"][i]))
        word |= (np.uint64(raw) & codec["mask"][i]) << codec["shift"][i]
    return word, OK
