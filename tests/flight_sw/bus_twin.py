"""Slow and obvious twins of codec and protection: cantools, and the checksum bit by bit."""

import random
from pathlib import Path

import numpy as np
from cantools.autosar.end_to_end import apply_profile2_crc
from cantools.database.can import Database

from flight_sw import icd

DATABASE = Database(strict=True)
DATABASE.add_dbc_file(icd.DBC_PATH)
CRC_8_2F = 0x2F


def crc8(data: bytes) -> int:
    """CRC-8 with polynomial 0x2F, start 0xFF, final exclusive or 0xFF, one bit at a time."""
    register = 0xFF
    for byte in data:
        for bit in range(7, -1, -1):
            carry = (register >> 7) ^ (byte >> bit & 1)
            register = (register << 1) & 0xFF
            if carry:
                register ^= CRC_8_2F
    return register ^ 0xFF


def dbc_text() -> str:
    """The DBC as it stands in the package."""
    return Path(icd.DBC_PATH).read_text(encoding="utf-8")


def frame_bytes(message: str, values: dict[str, float], counter: int) -> bytes:
    """The protected frame as cantools makes it."""
    dbc = DATABASE.get_message_by_name(message)
    plain = dbc.encode({**values, "e2e_crc": 0, "e2e_counter": counter}, strict=True)
    protected = apply_profile2_crc(plain, icd.layout(message).data_ids[counter])
    assert protected is not None
    return bytes(protected)


def decoded(message: str, data: bytes) -> dict[str, float]:
    """The signals of a frame as cantools reads them."""
    return DATABASE.decode_message(message, data, decode_choices=False)


def random_values(message: icd.Message, rng: random.Random) -> dict[str, float]:
    """One allowed value for each signal: an end of the range, zero, or anything between."""
    values = {}
    for signal in message.signals:
        choice = rng.random()
        if choice < 0.05:
            value = signal.low
        elif choice < 0.1:
            value = signal.high
        elif choice < 0.2:
            value = min(max(0.0, signal.low), signal.high)
        else:
            value = rng.uniform(signal.low, signal.high)
        is_whole = signal.scale == 1.0 and signal.low >= 0.0
        values[signal.name] = float(round(value)) if is_whole else value
    return values


def value_vector(message: str, values: dict[str, float]) -> np.ndarray:
    """The flat vector with one message's values in it, all others NaN."""
    vector = np.full(icd.N_VALUES, np.nan)
    for name, value in values.items():
        vector[icd.value_index(message, name)] = value
    return vector


def word_of(data: bytes) -> np.uint64:
    """Eight data bytes as the codec's word."""
    return np.uint64(int.from_bytes(data, "little"))
