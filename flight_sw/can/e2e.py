"""AUTOSAR end-to-end protection, profile 2, on a frame word.

    byte 0      checksum over bytes 1 to 7 and the data id
    byte 1      low nibble: counter 0..15; high nibble: payload
    bytes 2..7  payload

The data id is not sent; which of a message's sixteen is meant follows from the counter.
"""

import numpy as np

from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

BYTE = np.uint64(0xFF)
NIBBLE = np.uint64(0xF)
COUNTER_SHIFT = np.uint64(8)
PAYLOAD = np.uint64(0xFFFF_FFFF_FFFF_F000)
BIT_8, BIT_16, BIT_24, BIT_32 = np.uint64(8), np.uint64(16), np.uint64(24), np.uint64(32)
BIT_40, BIT_48, BIT_56 = np.uint64(40), np.uint64(48), np.uint64(56)


@kernel
def counter_of(word: np.uint64) -> np.int64:
    """The sequence counter of a frame word."""
    return np.int64((word >> COUNTER_SHIFT) & NIBBLE)


@kernel
def checksum(codec: Record, slot: int, word: np.uint64) -> np.uint64:
    """The checksum that belongs into byte 0, whatever stands there."""
    table = codec["crc"]
    crc = np.uint64(codec["crc_counter"][slot, (word >> COUNTER_SHIFT) & NIBBLE])
    crc ^= np.uint64(table[0, (word >> BIT_8) & BYTE])
    crc ^= np.uint64(table[1, (word >> BIT_16) & BYTE])
    crc ^= np.uint64(table[2, (word >> BIT_24) & BYTE])
    crc ^= np.uint64(table[3, (word >> BIT_32) & BYTE])
    crc ^= np.uint64(table[4, (word >> BIT_40) & BYTE])
    crc ^= np.uint64(table[5, (word >> BIT_48) & BYTE])
    crc ^= np.uint64(table[6, word >> BIT_56])
    return crc


@kernel
def protect(codec: Record, slot: int, word: np.uint64, counter: int) -> np.uint64:
    """The word with counter (modulo 16) and checksum put in."""
    counted = (word & PAYLOAD) | ((np.uint64(counter) & NIBBLE) << COUNTER_SHIFT)
    return counted | checksum(codec, slot, counted)


@kernel
def crc_ok(codec: Record, slot: int, word: np.uint64) -> bool:
    """Whether the word carries its own checksum."""
    return (word & BYTE) == checksum(codec, slot, word)
