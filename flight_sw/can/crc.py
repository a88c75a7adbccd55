"""Tables for the checksum of AUTOSAR E2E profile 2: CRC-8, polynomial 0x2F, over one frame word.

A CRC is linear: the checksum of a message is the exclusive or of what each of its bytes would give
alone. With one table a byte position, the seven look-ups do not wait for each other.
"""

import numpy as np
import numpy.typing as npt

POLYNOMIAL = 0x2F
INITIAL = 0xFF
XOR_OUT = 0xFF
POSITIONS = 7  # data bytes 1 to 7; the data id follows them

U1 = npt.NDArray[np.uint8]


def shifted(crc: int) -> int:
    """The register after eight more zero bits."""
    for _ in range(8):
        crc = (crc << 1) ^ (POLYNOMIAL if crc & 0x80 else 0)
        crc &= 0xFF
    return crc


def shifted_bytes(crc: int, count: int) -> int:
    """The register after `count` more zero bytes."""
    for _ in range(count):
        crc = shifted(crc)
    return crc


def crc_table() -> U1:
    """Row i, column b: what value b of data byte i + 1 adds to the checksum."""
    rows = [
        [shifted_bytes(value, POSITIONS + 1 - position) for value in range(256)]
        for position in range(POSITIONS)
    ]
    return np.array(rows, np.uint8)


def counter_table(data_ids: tuple[int, ...]) -> U1:
    """What the data id of each counter value adds, with the start and end values of the CRC."""
    start = shifted_bytes(INITIAL, POSITIONS + 1)
    return np.array([shifted(data_id) ^ start ^ XOR_OUT for data_id in data_ids], np.uint8)
