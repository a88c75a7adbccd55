"""Finds the records of an MCAP file, compiled. No length is believed before it was compared.

A length is read as the unsigned number that it is, and compared with what is left behind it: every
sum and every index below is then at most the number of bytes there are.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mcap.opcode import Opcode

from sim_harness.jit import kernel
from sim_harness.telemetry.wire import HEAD_BYTES, OPCODE_MESSAGE, UNCOUNTED_BYTES

I8 = npt.NDArray[np.int64]
U1 = npt.NDArray[np.uint8]

PASSED_OVER = tuple(
    int(opcode)
    for opcode in (
        Opcode.MESSAGE_INDEX,
        Opcode.CHUNK_INDEX,
        Opcode.ATTACHMENT_INDEX,
        Opcode.STATISTICS,
        Opcode.METADATA_INDEX,
        Opcode.SUMMARY_OFFSET,
    )
)
IS_PASSED_OVER = np.array([opcode in PASSED_OVER for opcode in range(256)])
"""Records of the data section that say nothing new."""

CHANNELS = 1 << 16
UNKNOWN, UNWANTED = 0, 1  # of a channel; what is more is wanted
BATCH = 4096
OCTET_BITS = np.uint64(8)


@kernel
def _word(octets: U1, at: int, n: int) -> np.uint64:
    """A little-endian number of `n` bytes."""
    value = np.uint64(0)
    for i in range(n - 1, -1, -1):
        value = (value << OCTET_BITS) | np.uint64(octets[at + i])
    return value


@kernel
def _end_of(octets: U1, at: int) -> np.int64:
    """Where the record that begins at `at` ends; -1 if it does not end within the bytes."""
    left = len(octets) - at - UNCOUNTED_BYTES
    if left < 0:
        return np.int64(-1)
    length = _word(octets, at + 1, 8)
    if length > np.uint64(left):
        return np.int64(-1)
    return np.int64(at + UNCOUNTED_BYTES) + np.int64(length)


@kernel
def next_record(octets: U1, at: int, is_passed_over: npt.NDArray[np.bool_]) -> np.int64:
    """The first record from `at` on that is to be looked at, or that does not fit."""
    while at < len(octets) and is_passed_over[octets[at]]:
        end = _end_of(octets, at)
        if end < 0:
            break
        at = end
    return np.int64(at)


@kernel
def _definitions(octets: U1, at: int, places: I8, ends: I8) -> tuple[int, int]:
    """Write where other records than messages are, up to a batch; returns how many, and the end."""
    n = 0
    while at < len(octets) and n < len(places):
        end = _end_of(octets, at)
        if end < 0 or (octets[at] == OPCODE_MESSAGE and end - at < HEAD_BYTES):
            break
        if octets[at] != OPCODE_MESSAGE:
            places[n] = at
            ends[n] = end
            n += 1
        at = end
    return n, at


@kernel
def _messages(
    octets: U1, until: int, wanted: U1, starts: I8, sizes: I8, numbers: I8
) -> tuple[int, int]:
    """Write where the messages of wanted channels are, as far as there is room for them.

    `until` is where the last whole record ends, as `_definitions` found. Returns how many wanted
    ones there are, and how many are of a channel that is not known.
    """
    n = 0
    strange = 0
    at = 0
    while at < until:
        end = _end_of(octets, at)
        if end < 0:
            break
        if octets[at] == OPCODE_MESSAGE and end - at >= HEAD_BYTES:
            number = np.int64(_word(octets, at + UNCOUNTED_BYTES, 2))
            if wanted[number] == UNKNOWN:
                strange += 1
            elif wanted[number] > UNWANTED:
                if n < len(starts):
                    starts[n] = at
                    sizes[n] = end - at
                    numbers[n] = wanted[number]
                n += 1
        at = end
    return n, strange


class Found(NamedTuple):
    """The wanted messages of a chunk."""

    starts: I8
    sizes: I8
    numbers: I8
    """What each one's channel is wanted as."""
    strange: int
    """Messages of channels that are not known."""


def octets_of(blob: bytes) -> U1:
    """Bytes as the kernels take them, which are not to be written to."""
    return np.frombuffer(blob, np.uint8)


def definitions(octets: U1, take: Callable[[int, int], None]) -> int:
    """Hand over where each record begins and ends that is no message; returns the whole's end."""
    places, ends = np.zeros(BATCH, np.int64), np.zeros(BATCH, np.int64)
    n, at = BATCH, 0
    while n == BATCH:
        n, at = _definitions(octets, at, places, ends)
        for place, end in zip(places[:n].tolist(), ends[:n].tolist(), strict=True):
            take(place, end)
    return at


def messages(octets: U1, until: int, wanted: U1) -> Found:
    """The messages of wanted channels, in the order of the chunk."""
    none = np.zeros(0, np.int64)
    n, strange = _messages(octets, until, wanted, none, none, none)
    starts, sizes, numbers = np.zeros((3, n), np.int64)
    _messages(octets, until, wanted, starts, sizes, numbers)
    return Found(starts, sizes, numbers, strange)


def load_kernels() -> None:
    """Compile, or read from the cache, what taking a file apart needs."""
    octets = octets_of(b"")
    next_record(octets, 0, IS_PASSED_OVER)
    definitions(octets, lambda place, end: None)
    messages(octets, 0, np.zeros(CHANNELS, np.uint8))
