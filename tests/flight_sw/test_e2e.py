"""End-to-end protection: published checksums, cantools, and every wrong bit found."""

import random

import numpy as np
import pytest
from cantools.autosar.end_to_end import apply_profile2_crc, check_profile2_crc

from flight_sw import icd
from flight_sw.can.codec import build_codec
from flight_sw.can.e2e import counter_of, crc_ok, protect
from flight_sw.runtime.jit import kernel
from tests.flight_sw.bus_twin import crc8, word_of

CODEC_ARRAY = build_codec()
ONE = np.uint64(1)
FRAMES_A_MESSAGE = 200
PUBLISHED = [  # [AUTOSAR-E2E] takes its checksum from the CRC library's CRC8H2F and these vectors
    ("00 00 00 00", 0x12),
    ("F2 01 83", 0xC2),
    ("0F AA 00 55", 0xC6),
    ("00 FF 55 11", 0x77),
    ("33 22 55 AA BB CC DD EE FF", 0x11),
    ("92 6B 55", 0x33),
    ("FF FF FF FF", 0x6C),
]


@kernel
def protect_once(codec, slot, words, counter):  # type: ignore[no-untyped-def]
    """Protect words[0] in place."""
    words[0] = protect(codec[0], slot, words[0], counter)


@kernel
def right_after_one_wrong_bit(codec, slot, words):  # type: ignore[no-untyped-def]
    """How many of the 64 words with one wrong bit pass the check."""
    passed = 0
    for i in range(64):
        if crc_ok(codec[0], slot, words[0] ^ (ONE << np.uint64(i))):
            passed += 1
    return passed


@kernel
def right_after_two_wrong_bits(codec, slot, words):  # type: ignore[no-untyped-def]
    """How many of the 2016 words with two wrong bits pass the check."""
    passed = 0
    for i in range(64):
        for j in range(i):
            flipped = words[0] ^ (ONE << np.uint64(i)) ^ (ONE << np.uint64(j))
            if crc_ok(codec[0], slot, flipped):
                passed += 1
    return passed


def protected(slot: int, payload: int, counter: int) -> np.ndarray:
    words = np.array([payload], np.uint64)
    protect_once(CODEC_ARRAY, slot, words, counter)
    return words


@pytest.mark.parametrize(("data", "crc"), PUBLISHED)
def test_the_twin_gives_the_published_checksums(data: str, crc: int) -> None:
    assert crc8(bytes.fromhex(data)) == crc


@pytest.mark.parametrize("message", icd.LAYOUT, ids=icd.MESSAGES)
def test_protection_is_that_of_cantools_and_of_the_twin(message: icd.Message) -> None:
    rng = random.Random(20260103)
    for i in range(FRAMES_A_MESSAGE):
        counter = i % 16
        words = protected(icd.slot(message.name), rng.getrandbits(64), counter)
        data = words.astype("<u8").tobytes()
        data_id = message.data_ids[counter]
        assert data[1] & 0xF == counter == counter_of(words[0])
        assert data == apply_profile2_crc(data, data_id)
        assert data[0] == crc8(data[1:] + bytes([data_id]))
        assert crc_ok(CODEC_ARRAY[0], icd.slot(message.name), words[0])


def test_protection_keeps_the_payload_and_takes_the_counter_modulo_16() -> None:
    for counter in (0, 15, 16, 31, 1_000_003):
        words = protected(0, 0x0123_4567_89AB_CDEF, counter)
        assert int(words[0]) >> 12 == 0x0123_4567_89AB_C
        assert int(counter_of(words[0])) == counter % 16


def test_the_check_agrees_with_cantools_on_random_frames_right_or_wrong() -> None:
    rng = random.Random(20260104)
    passed = 0
    for i in range(10_000):
        message = icd.LAYOUT[i % icd.N_MESSAGES]
        data = rng.randbytes(8)
        expected = check_profile2_crc(data, message.data_ids[data[1] & 0xF])
        assert crc_ok(CODEC_ARRAY[0], icd.slot(message.name), word_of(data)) == expected
        passed += bool(expected)
    assert 10_000 / 256 * 0.5 < passed < 10_000 / 256 * 1.5  # one random frame in 256


@pytest.mark.parametrize("message", icd.LAYOUT, ids=icd.MESSAGES)
def test_every_single_wrong_bit_is_found(message: icd.Message) -> None:
    rng = random.Random(20260105)
    slot = icd.slot(message.name)
    for i in range(FRAMES_A_MESSAGE):
        words = protected(slot, rng.getrandbits(64), i)
        assert right_after_one_wrong_bit(CODEC_ARRAY, slot, words) == 0


@pytest.mark.parametrize("message", icd.LAYOUT, ids=icd.MESSAGES)
def test_every_two_wrong_bits_are_found(message: icd.Message) -> None:
    rng = random.Random(20260106)
    slot = icd.slot(message.name)
    for counter in range(16):
        words = protected(slot, rng.getrandbits(64), counter)
        assert right_after_two_wrong_bits(CODEC_ARRAY, slot, words) == 0


def test_a_frame_passes_as_no_other_message() -> None:
    for counter in range(16):
        for sent in range(icd.N_MESSAGES):
            word = protected(sent, 0x0123_4567_89AB_C000, counter)[0]
            passes = [s for s in range(icd.N_MESSAGES) if crc_ok(CODEC_ARRAY[0], s, word)]
            assert passes == [sent]
