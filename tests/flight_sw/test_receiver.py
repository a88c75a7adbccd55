"""The receiver's verdicts, their order, the counter window, and that refusals change nothing."""

import numpy as np
import pytest

from flight_sw import icd
from flight_sw.can.codec import build_codec
from flight_sw.reception import receiver
from flight_sw.reception.receiver import (
    FOREIGN,
    IMPLAUSIBLE,
    LOST,
    OK,
    OUT_OF_RANGE,
    REPEATED,
    RX_STATE,
    UNKNOWN_ID,
    WRONG_CRC,
    WRONG_LENGTH,
    WRONG_SEQUENCE,
    accept,
    is_valid,
    judge,
    receiver_tick,
    reclassify,
    refuse,
    rejected,
    report_counters,
    sequence_verdict,
)
from flight_sw.records.dictionary import FRAME, TICK_ID
from tests.flight_sw.bus_twin import DATABASE, crc8, frame_bytes, word_of

CODEC_ARRAY = build_codec()
CODEC = CODEC_ARRAY[0]
POSITION = icd.slot("NAV_POSITION")
TELEMETRY = icd.slot("TM_LQY")
LON = icd.value_index("NAV_POSITION", "lon_rad")
GOOD = {"lon_rad": 1.0, "lat_rad": -0.5}
FSW = icd.NODES.index("FSW")


@pytest.fixture
def rx() -> np.ndarray:
    return np.zeros(1, RX_STATE)


def frame_of(data: bytes, can_id: int = 0x020, dlc: int = 8) -> np.ndarray:
    frame = np.zeros(1, FRAME)
    frame["can_id"] = can_id
    frame["dlc"] = dlc
    frame["data"] = word_of(data)
    return frame


def position(counter: int, **changes: int) -> np.ndarray:
    return frame_of(frame_bytes("NAV_POSITION", GOOD, counter), **changes)


def wrong_range(counter: int) -> bytes:
    """A well protected frame whose longitude is larger than pi."""
    dbc = DATABASE.get_message_by_name("NAV_POSITION")
    raw = {"lon_rad": 31415928, "lat_rad": 0, "e2e_crc": 0, "e2e_counter": counter}
    data = bytearray(dbc.encode(raw, scaling=False, strict=False))
    data[0] = crc8(data[1:] + bytes([icd.layout("NAV_POSITION").data_ids[counter]]))
    return bytes(data)


def judged(rx: np.ndarray, frame: np.ndarray) -> tuple[int, int, np.ndarray]:
    values = np.full(icd.N_VALUES, np.nan)
    slot, verdict = judge(CODEC, rx[0], frame[0], values)
    return int(slot), int(verdict), values


def take(rx: np.ndarray, counter: int) -> int:
    slot, verdict, _ = judged(rx, position(counter))
    if is_valid(verdict):
        accept(rx[0], slot, counter, verdict)
    else:
        refuse(rx[0], verdict)
    return verdict


def test_a_good_frame_is_decoded_and_changes_the_state_only_when_accepted(rx: np.ndarray) -> None:
    before = rx.tobytes()
    slot, verdict, values = judged(rx, position(7))
    assert (slot, verdict) == (POSITION, OK)
    assert values[LON] == pytest.approx(1.0, abs=1e-12)
    assert rx.tobytes() == before
    accept(rx[0], slot, 7, verdict)
    assert rx["counter"][0, POSITION] == 7
    assert rx["counted"][0, OK] == 1


REFUSED = [
    (position(8, can_id=0x021 + 0x700), UNKNOWN_ID),
    (position(8, can_id=0x7FF), UNKNOWN_ID),
    (position(8, can_id=0x800), UNKNOWN_ID),
    (position(8, can_id=0x020 | 0x80000000), UNKNOWN_ID),
    (position(8, can_id=0x020 | 0x40000000), UNKNOWN_ID),
    (position(8, can_id=0x020 | 0x20000000), UNKNOWN_ID),
    (position(8, can_id=TICK_ID), UNKNOWN_ID),
    (position(8, can_id=0x010), FOREIGN),
    (position(8, dlc=7), WRONG_LENGTH),
    (position(8, dlc=0), WRONG_LENGTH),
    (position(8, dlc=255), WRONG_LENGTH),
    (position(8, can_id=0x021), WRONG_CRC),
    (frame_of(wrong_range(8)), OUT_OF_RANGE),
    (position(7), REPEATED),
    (position(11), WRONG_SEQUENCE),
    (position(6), WRONG_SEQUENCE),
]


@pytest.mark.parametrize(("frame", "expected"), REFUSED)
def test_a_refused_frame_changes_nothing(rx: np.ndarray, frame: np.ndarray, expected: int) -> None:
    take(rx, 7)
    before = rx.tobytes()
    _, verdict, values = judged(rx, frame)
    assert receiver.VERDICTS[verdict] == receiver.VERDICTS[expected]
    assert np.isnan(values).all()
    assert rx.tobytes() == before
    refuse(rx[0], verdict)
    assert rx["counted"][0, expected] == 1
    assert rejected(rx[0]) == 1


def test_verdicts_come_in_the_agreed_order(rx: np.ndarray) -> None:
    """A frame with every fault, healed one by one."""
    take(rx, 7)
    frame = frame_of(wrong_range(7), can_id=0x010 | 0x80000000, dlc=3)
    frame["data"] ^= np.uint64(1)
    seen = [judged(rx, frame)[1]]
    frame["can_id"] = 0x010
    seen.append(judged(rx, frame)[1])
    frame["can_id"] = 0x020
    seen.append(judged(rx, frame)[1])
    frame["dlc"] = 8
    seen.append(judged(rx, frame)[1])
    frame["data"] ^= np.uint64(1)
    seen.append(judged(rx, frame)[1])
    seen.append(judged(rx, position(7))[1])
    seen.append(judged(rx, position(8))[1])
    assert seen == [UNKNOWN_ID, FOREIGN, WRONG_LENGTH, WRONG_CRC, OUT_OF_RANGE, REPEATED, OK]


def test_every_single_wrong_bit_in_the_data_is_refused_as_a_wrong_checksum(
    rx: np.ndarray,
) -> None:
    for counter in range(16):
        for bit in range(64):
            frame = position(counter)
            frame["data"] ^= np.uint64(1) << np.uint64(bit)
            assert judged(rx, frame)[1] == WRONG_CRC


def test_each_side_hears_only_the_other(rx: np.ndarray) -> None:
    assert judged(rx, position(0))[1] == OK
    rx["sender"] = FSW
    assert judged(rx, position(0))[1] == FOREIGN
    command = frame_of(
        frame_bytes("FSW_COMMAND", {"bank_cmd_rad": 0.0, "alpha_cmd_rad": 0.0}, 0), can_id=0x010
    )
    assert judged(rx, command)[1] == OK


def test_the_first_frame_may_carry_any_counter() -> None:
    for counter in range(16):
        assert take(np.zeros(1, RX_STATE), counter) == OK


def test_the_counter_goes_round(rx: np.ndarray) -> None:
    for i in range(40):
        receiver_tick(rx[0])
        assert take(rx, i % 16) == OK
    assert rx["counted"][0, OK] == 40
    assert rx["lost_frames"][0] == 0


def expected_in_sequence(delta: int, age_cycles: int, period_cycles: int) -> int:
    """The rule in words of AUTOSAR: the window opens by one for each period without a frame."""
    periods_missed = 0
    for cycle in range(2, age_cycles + 1):
        if (cycle - 1) % period_cycles == 0:
            periods_missed += 1
    if periods_missed >= 15 or delta == 1:
        return OK
    if delta == 0:
        return REPEATED
    return LOST if delta in range(2, 4 + periods_missed) else WRONG_SEQUENCE


@pytest.mark.parametrize(("slot", "period_cycles"), [(POSITION, 1), (TELEMETRY, 5)])
def test_the_window_opens_with_the_periods_missed(slot: int, period_cycles: int) -> None:
    rx = np.zeros(1, RX_STATE)
    for last in (0, 9, 15):
        for age_cycles in range(0, 18 * period_cycles):
            rx["counter"][0, slot] = last
            rx["received"][0, slot] = 1
            rx["age_cycles"][0, slot] = age_cycles
            found = [sequence_verdict(CODEC, rx[0], slot, (last + d) % 16) for d in range(16)]
            wanted = [expected_in_sequence(d, age_cycles, period_cycles) for d in range(16)]
            assert found == wanted, (last, age_cycles)


def test_lost_frames_are_counted_one_by_one(rx: np.ndarray) -> None:
    take(rx, 14)
    assert take(rx, 1) == LOST
    assert rx["lost_frames"][0] == 2
    assert rx["counted"][0, LOST] == 1
    assert rejected(rx[0]) == 0


def test_a_stream_that_jumped_is_believed_again_within_sixteen_cycles(rx: np.ndarray) -> None:
    take(rx, 0)
    verdicts = []
    for i in range(20):
        receiver_tick(rx[0])
        verdicts.append(take(rx, (7 + i) % 16))
    assert verdicts[0] == WRONG_SEQUENCE
    assert all(v == OK for v in verdicts[16:])


def test_silence_ages_every_message(rx: np.ndarray) -> None:
    take(rx, 3)
    for _ in range(15):
        receiver_tick(rx[0])
    assert judged(rx, position(3))[1] == REPEATED
    receiver_tick(rx[0])
    assert judged(rx, position(3))[1] == OK
    take(rx, 3)  # and is young again
    assert judged(rx, position(3))[1] == REPEATED
    assert rx["counted"][0, OK] == 2


def test_a_refusal_taken_back_is_not_counted(rx: np.ndarray) -> None:
    refuse(rx[0], WRONG_SEQUENCE)
    refuse(rx[0], WRONG_SEQUENCE)
    reclassify(rx[0], WRONG_SEQUENCE)
    accept(rx[0], POSITION, 3, OK)
    assert rx["counted"][0, WRONG_SEQUENCE] == 1
    assert receiver.heard(rx[0]) == 2


def test_ages_stop_before_they_overflow(rx: np.ndarray) -> None:
    rx["age_cycles"] = receiver.AGE_MAX_CYCLES
    receiver_tick(rx[0])
    assert (rx["age_cycles"] == receiver.AGE_MAX_CYCLES).all()


def test_the_health_signals_carry_the_counters_and_stop_at_their_top(rx: np.ndarray) -> None:
    values = np.zeros(icd.N_VALUES)
    for verdict in range(receiver.N_VERDICTS):
        rx["counted"][0, verdict] = 100 + verdict
    rx["lost_frames"] = 70_000
    report_counters(rx[0], 9_000, 12, values)
    names = {
        "RX_HEALTH_A": ("wrong_crc", "repeated", "wrong_sequence", "wrong_length"),
        "RX_HEALTH_B": ("out_of_range", "implausible", "unknown_id"),
        "RX_HEALTH_C": ("foreign",),
    }
    for message, signals in names.items():
        for signal in signals:
            wanted = 100 + receiver.VERDICTS.index(signal.upper())
            assert values[icd.value_index(message, signal)] == wanted
    assert values[icd.value_index("RX_HEALTH_B", "incomplete_sets")] == 8191
    assert values[icd.value_index("RX_HEALTH_A", "candidates_believed")] == 12
    assert values[icd.value_index("RX_HEALTH_C", "lost")] == 8191
    assert values[icd.value_index("RX_HEALTH_C", "misdirected")] == 63
    heard = sum(100 + verdict for verdict in range(receiver.N_VERDICTS))
    assert values[icd.value_index("RX_HEALTH_C", "heard")] == heard
    rx["counted"][0, receiver.OK] += 524_288  # what 19 bits carry
    report_counters(rx[0], 0, 1_000, values)
    assert values[icd.value_index("RX_HEALTH_C", "heard")] == heard
    rx["counted"] = 1 << 40
    report_counters(rx[0], 0, 1_000, values)
    assert values[icd.value_index("RX_HEALTH_A", "candidates_believed")] == 63
    for message in names:
        for signal in icd.layout(message).signals:
            assert values[icd.value_index(message, signal.name)] <= signal.high


def test_an_implausible_frame_is_counted_by_its_owner(rx: np.ndarray) -> None:
    refuse(rx[0], IMPLAUSIBLE)
    assert rx["counted"][0, IMPLAUSIBLE] == 1
    assert not is_valid(IMPLAUSIBLE)
