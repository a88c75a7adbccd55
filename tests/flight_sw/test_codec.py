"""The codec against cantools, against frames worked out by hand, and at the ends of every range."""

import dataclasses
import math
import random

import numpy as np
import pytest

from flight_sw import icd
from flight_sw.can.codec import (
    CODEC,
    OK,
    OUT_OF_RANGE,
    _fill_signal,
    build_codec,
    pack,
    unpack,
)
from flight_sw.can.e2e import protect
from flight_sw.runtime.jit import kernel
from tests.flight_sw.bus_twin import (
    DATABASE,
    decoded,
    frame_bytes,
    random_values,
    value_vector,
    word_of,
)

CODEC_ARRAY = build_codec()
SIGNALS = [(message.name, signal) for message in icd.LAYOUT for signal in message.signals]
SIGNAL_NAMES = [f"{message}.{signal.name}" for message, signal in SIGNALS]

# NAV_POSITION: 1 rad is raw 10^7 = 0x989680, -0.5 rad is -10^7, in 26 bits 0x3676980. The word is
# 0x3676980 << 38 | 0x989680 << 12 | counter << 8, lowest byte first; the checksum is the twin's.
WORKED = [
    ("FSW_COMMAND", (-1.0, 0.7), 5, "56 05 98 76 36 f0 b3 1a"),
    ("NAV_POSITION", (1.0, -0.5), 10, "4f 0a 68 89 09 60 da d9"),
    ("NAV_VERTICAL", (120000.0, 7800.0), 15, "ce 0f 34 14 17 f0 c5 94"),
    ("NAV_DIRECTION", (-0.1, 1.5), 4, "a2 04 b8 17 3e 70 38 39"),
    ("NAV_AERO", (10.0, 2.5), 9, "fe 09 d4 30 00 d4 30 00"),
    ("NAV_ATTITUDE", (-3.0, 0.7), 14, "7a 0e c8 63 23 f0 b3 1a"),
    ("NAV_HEATING", (1700000.0,), 3, "97 03 32 1b 08 00 00 00"),
    ("NAV_TIME", (900.02,), 8, "9d 08 72 53 5a 03 00 00"),
    ("FSW_STATUS", (45001, 2, 3, 1, 1, 0, 1, 1, 0xBEEF), 13, "dd 9d fc 0a 32 1b ef be"),
    ("FSW_BOOT", (0x89ABC, 1, 2, 0xDEF01), 2, "09 c2 ab 89 21 10 f0 de"),
    ("GROUND_REQUEST", (0x89ABC, 0xDEF01, 1), 7, "6a c7 ab 89 01 ef 1d 00"),
    ("FSW_LOAD", (0x12345, 0x89ABCDEF), 12, "fa 5c 34 12 ef cd ab 89"),
    ("HARNESS_PRESENT", (0x89ABC, 0x12345, 1), 1, "0d c1 ab 89 45 23 11 00"),
    ("FSW_TIMING", (200, 300, 2, 5), 6, "c0 86 0c c0 12 20 40 01"),
    ("TM_NOMINAL_A", (2.0, -0.05), 12, "71 0c d0 12 13 70 2f fc"),
    ("TM_NOMINAL_B", (3.15, 0.98), 1, "f5 01 0b 01 03 b4 5f 00"),
    ("TM_SAG", (-0.5, 1.25), 4, "0c 04 4c 3b bb 38 01 00"),
    ("TM_HEAT_FLUX", (1.7e6, -2500.0), 9, "75 09 99 0d 04 96 e7 ff"),
    ("TM_MODEL", (0.125, -0.2), 15, "be 0f 2d 31 01 e0 5e f8"),
    ("TM_DRAG_A", (12.5, -0.75), 2, "ef 02 09 3d 00 5a f1 ff"),
    ("TM_DRAG_B", (-0.3, 0.02), 7, "8d 07 ad f8 3f f4 01 00"),
    ("TM_DRAG_C", (0.015, -1.25), 10, "3c ca 5d 00 00 4c 3b fb"),
    ("TM_DRAG_D", (-4000000.0, 1234.5), 13, "1c 0d dc 0b 7f 0e 0c 00"),
    ("TM_OBSERVED", (1.05, -0.004), 3, "4c 83 a2 19 00 9c ff ff"),
    ("TM_PREDICTED", (-2500.0, 0.125), 8, "0f 88 e5 f9 3f 12 7a 00"),
    ("TM_PLAN_A", (1.25, -0.5), 2, "78 02 2d 31 01 98 76 f6"),
    ("TM_PLAN_B", (-1234.5, 800.0), 7, "16 b7 65 ff 3f 90 01 00"),
    ("TM_PLAN_C", (35.25, -1.5), 11, "7c 5b dc 00 00 12 fd ff"),
    ("TM_PLAN_D", (-0.125, 3, 1, 1, 4, 9), 5, "ca c5 f2 fc 4f 44 90 00"),
    ("TM_PLAN_E", (0.5, 12.3), 14, "a5 5e 00 00 c0 1e 00 00"),
    ("TM_LQY", (-0.02, -8000.0), 6, "3c 06 96 e7 3f 78 ec ff"),
    ("RX_HEALTH_A", (1, 2, 3, 100, 33), 11, "ca 1b 00 04 c0 00 20 87"),
    ("RX_HEALTH_B", (4, 5, 6, 7), 0, "02 40 00 0a 80 01 38 00"),
    ("RX_HEALTH_C", (8191, 256, 33, 400_000, 1), 5, "fc f5 ff 01 42 08 a8 e1"),
]


@kernel
def encode_once(codec, slot, values, counter, words):  # type: ignore[no-untyped-def]
    """One protected word; returns the status of packing."""
    word, code = pack(codec[0], slot, values)
    words[0] = protect(codec[0], slot, word, counter)
    return code


@kernel
def decode_once(codec, slot, words, values):  # type: ignore[no-untyped-def]
    """One word's signals into `values`."""
    return unpack(codec[0], slot, words[0], values)


def encoded(message: str, values: np.ndarray, counter: int) -> tuple[bytes, int]:
    words = np.zeros(1, np.uint64)
    code = encode_once(CODEC_ARRAY, icd.slot(message), values, counter, words)
    return words.astype("<u8").tobytes(), code


def read_back(message: str, data: bytes) -> tuple[np.ndarray, int]:
    values = np.full(icd.N_VALUES, np.nan)
    words = np.array([word_of(data)])
    return values, decode_once(CODEC_ARRAY, icd.slot(message), words, values)


def check_frame(message: icd.Message, rng: random.Random, counter: int) -> None:
    """One random frame: same bytes as cantools, and the same numbers read from them."""
    values = random_values(message, rng)
    data, code = encoded(message.name, value_vector(message.name, values), counter)
    assert code == OK, (message.name, values)
    assert data == frame_bytes(message.name, values, counter), (message.name, values)
    found, code = read_back(message.name, data)
    assert code == OK
    for name, value in decoded(message.name, data).items():
        if name not in icd.E2E_SIGNALS:
            assert found[icd.value_index(message.name, name)] == value, (message.name, name)
    assert np.count_nonzero(~np.isnan(found)) == len(message.signals)


def check_frames(count: int, seed: int) -> None:
    rng = random.Random(seed)
    for i in range(count):
        check_frame(icd.LAYOUT[i % icd.N_MESSAGES], rng, i % 16)


def test_ten_thousand_random_frames_are_those_of_cantools() -> None:
    check_frames(10_000, 20260101)


@pytest.mark.slow
@pytest.mark.jit_only
def test_a_million_random_frames_are_those_of_cantools() -> None:
    check_frames(1_000_000, 20260102)


@pytest.mark.parametrize(("message", "values", "counter", "frame"), WORKED)
def test_a_frame_worked_out_by_hand(
    message: str, values: tuple[float, ...], counter: int, frame: str
) -> None:
    named = dict(zip(icd.signal_names(message), map(float, values), strict=True))
    data, code = encoded(message, value_vector(message, named), counter)
    assert (data.hex(" "), code) == (frame, OK)


def test_every_message_has_a_frame_worked_out_by_hand() -> None:
    assert {message for message, *_ in WORKED} == set(icd.MESSAGES)


@pytest.mark.parametrize(("message", "signal"), SIGNALS, ids=SIGNAL_NAMES)
def test_both_ends_of_a_range_come_back_and_can_be_sent_again(
    message: str, signal: icd.Signal
) -> None:
    index = icd.value_index(message, signal.name)
    values = value_vector(message, {s.name: s.low for s in icd.layout(message).signals})
    for end in (signal.low, signal.high):
        values[index] = end
        first, code = encoded(message, values, 0)
        assert code == OK
        found, code = read_back(message, first)
        assert code == OK
        assert found[index] == pytest.approx(end, abs=signal.scale * 1e-6)
        again, code = encoded(message, found, 0)
        assert (again, code) == (first, OK)


@pytest.mark.parametrize(("message", "signal"), SIGNALS, ids=SIGNAL_NAMES)
def test_a_value_outside_its_range_or_no_number_is_refused(
    message: str, signal: icd.Signal
) -> None:
    values = value_vector(message, {s.name: s.low for s in icd.layout(message).signals})
    index = icd.value_index(message, signal.name)
    beyond = signal.high + 0.3 * signal.scale  # would round back into the range
    below = signal.low - 0.3 * signal.scale
    for wrong in (beyond, below, 1e300, -1e300, math.inf, -math.inf, math.nan):
        values[index] = wrong
        assert encoded(message, values, 0)[1] == OUT_OF_RANGE, wrong


def test_a_refused_word_is_zero() -> None:
    values = np.full(icd.N_VALUES, np.nan)
    word, code = pack(CODEC_ARRAY[0], icd.slot("NAV_POSITION"), values)
    assert (int(word), code) == (0, OUT_OF_RANGE)


@pytest.mark.parametrize(("message", "signal"), SIGNALS, ids=SIGNAL_NAMES)
def test_a_raw_value_outside_the_range_is_refused_and_nothing_written(
    message: str, signal: icd.Signal
) -> None:
    dbc = DATABASE.get_message_by_name(message)
    raw = {s.name: round((s.low - s.offset) / s.scale) for s in icd.layout(message).signals}
    raw |= {"e2e_crc": 0, "e2e_counter": 0}
    smallest = -(1 << signal.bits - 1) if signal.signed else 0
    low, high = (round((end - signal.offset) / signal.scale) for end in (signal.low, signal.high))
    outside = {low - 1, smallest, high + 1, smallest + (1 << signal.bits) - 1}
    possible = range(smallest, smallest + (1 << signal.bits))
    for value in (v for v in outside if v in possible and not low <= v <= high):
        data = dbc.encode({**raw, signal.name: value}, scaling=False, strict=False)
        values, code = read_back(message, data)
        assert code == OUT_OF_RANGE
        assert np.isnan(values).all()


@pytest.mark.parametrize(
    ("steps", "raw"), [(0.5, 0), (1.5, 2), (2.5, 2), (-0.5, 0), (-1.5, -2), (0.4, 0), (0.6, 1)]
)
def test_rounding_is_to_the_nearest_and_ties_go_to_even(steps: float, raw: int) -> None:
    values = value_vector("TM_NOMINAL_B", {"flow_exponent": 0.0, "tracking_constant_ratio": 0.0})
    scale = icd.layout("TM_NOMINAL_B").signals[0].scale
    values[icd.value_index("TM_NOMINAL_B", "flow_exponent")] = steps * scale
    assert (steps * scale) / scale == steps
    found, _ = read_back("TM_NOMINAL_B", encoded("TM_NOMINAL_B", values, 0)[0])
    assert found[icd.value_index("TM_NOMINAL_B", "flow_exponent")] == raw * scale


def test_a_limit_that_its_product_misses_by_a_bit_may_still_be_sent() -> None:
    odd = dataclasses.replace(SIGNALS[0][1], scale=0.1, offset=0.0, low=-0.3, high=0.3)
    codec = np.zeros(1, CODEC)
    _fill_signal(codec[0], 0, odd)
    assert 3 * 0.1 > 0.3
    assert (codec["low"][0, 0], codec["high"][0, 0]) == (3 * -0.1, 3 * 0.1)
    assert (codec["raw_low"][0, 0], codec["raw_high"][0, 0]) == (-3, 3)


@pytest.mark.parametrize("bit", range(40, 64))
def test_bits_without_a_signal_are_sent_as_zero_and_refused_if_set(bit: int) -> None:
    data = frame_bytes("NAV_HEATING", {"heat_flux_wpm2": 1.7e6}, 3)
    assert data[5:] == bytes(3)
    word = int.from_bytes(data, "little") | 1 << bit
    values, code = read_back("NAV_HEATING", word.to_bytes(8, "little"))
    assert code == OUT_OF_RANGE
    assert np.isnan(values).all()


def test_the_codec_record_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        CODEC_ARRAY["scale"][0, 0] = 1.0
    assert CODEC_ARRAY.shape == (1,)
    assert CODEC_ARRAY.dtype == CODEC
