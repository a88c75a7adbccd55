"""Judges received frames: known, ours, whole, unharmed, in range, in sequence.

`judge` looks at a frame and changes nothing but the caller's scratch vector of values; then the
caller either takes the frame (`accept`) or counts why not (`refuse`). So it can still refuse what
no vehicle could have sent before the sequence moves on.

The sequence is that of AUTOSAR E2E profile 2: the next counter is expected, a jump of up to
DELTA_MAX is taken as frames lost, and each period without a frame widens the window by one. After
SILENCE_PERIODS nothing is left to compare with, and any counter is taken. Unlike in AUTOSAR, a
frame outside the window does not move it: a stream that jumped is believed again after the silence.
"""

import numpy as np

from flight_sw.can.codec import NO_SLOT, in_range, unpack
from flight_sw.can.codec import OK as UNPACKED
from flight_sw.can.e2e import counter_of, crc_ok
from flight_sw.icd import COUNTER_VALUES, N_MESSAGES, signal_range, value_index
from flight_sw.records.dictionary import CAN_ID_MASK
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel

OK = 0
LOST = 1  # accepted, but frames before it are missing
REPEATED = 2
WRONG_SEQUENCE = 3
WRONG_CRC = 4
WRONG_LENGTH = 5
OUT_OF_RANGE = 6
UNKNOWN_ID = 7
IMPLAUSIBLE = 8  # the caller's verdict: no vehicle could have sent it
FOREIGN = 9  # carries an identifier that only the receiver itself sends
MISDIRECTED = 10  # the caller's verdict: a harness's word that is meant for another, or not theirs
VERDICTS = (
    "OK",
    "LOST",
    "REPEATED",
    "WRONG_SEQUENCE",
    "WRONG_CRC",
    "WRONG_LENGTH",
    "OUT_OF_RANGE",
    "UNKNOWN_ID",
    "IMPLAUSIBLE",
    "FOREIGN",
    "MISDIRECTED",
)
N_VERDICTS = len(VERDICTS)

DELTA_MAX = 3  # counter steps taken as lost frames rather than as another stream
COUNTER_MASK = COUNTER_VALUES - 1
SILENCE_PERIODS = COUNTER_VALUES - 1  # by then every counter lies in the window
AGE_MAX_CYCLES = 1 << 30  # ages stop here

RX_STATE = np.dtype(
    [
        ("counted", "i8", (N_VERDICTS,)),  # frames by verdict
        ("lost_frames", "i8"),  # missing before accepted ones
        ("sender", "u4"),  # number in icd.NODES of the side that is listened to
        ("counter", "u1", (N_MESSAGES,)),  # of the last accepted frame
        ("received", "u1", (N_MESSAGES,)),  # 1 once a frame was accepted
        ("age_cycles", "i4", (N_MESSAGES,)),  # since the last accepted frame
    ],
    align=True,
)
"""A receiver's memory. All zero: listens to the harness and has heard nothing."""

HEALTH_WRONG_CRC = value_index("RX_HEALTH_A", "wrong_crc")
HEALTH_REPEATED = value_index("RX_HEALTH_A", "repeated")
HEALTH_WRONG_SEQUENCE = value_index("RX_HEALTH_A", "wrong_sequence")
HEALTH_WRONG_LENGTH = value_index("RX_HEALTH_A", "wrong_length")
HEALTH_BELIEVED = value_index("RX_HEALTH_A", "candidates_believed")
HEALTH_OUT_OF_RANGE = value_index("RX_HEALTH_B", "out_of_range")
HEALTH_IMPLAUSIBLE = value_index("RX_HEALTH_B", "implausible")
HEALTH_UNKNOWN_ID = value_index("RX_HEALTH_B", "unknown_id")
HEALTH_INCOMPLETE_SETS = value_index("RX_HEALTH_B", "incomplete_sets")
HEALTH_LOST = value_index("RX_HEALTH_C", "lost")
HEALTH_FOREIGN = value_index("RX_HEALTH_C", "foreign")
HEALTH_MISDIRECTED = value_index("RX_HEALTH_C", "misdirected")
HEALTH_HEARD = value_index("RX_HEALTH_C", "heard")
HEARD_MODULUS = 1 << 19  # of the frames heard, in RX_HEALTH_C
REFUSED_MAX = int(signal_range("RX_HEALTH_A", "wrong_crc")[1])
WRONG_LENGTH_MAX = int(signal_range("RX_HEALTH_A", "wrong_length")[1])
BELIEVED_MAX = int(signal_range("RX_HEALTH_A", "candidates_believed")[1])
MISSED_MAX = int(signal_range("RX_HEALTH_C", "lost")[1])
MISDIRECTED_MAX = int(signal_range("RX_HEALTH_C", "misdirected")[1])


@kernel
def is_valid(verdict: int) -> bool:
    """Whether a frame with this verdict may be used."""
    return verdict <= LOST


@kernel
def slot_of(codec: Record, can_id: np.uint32) -> np.int64:
    """The message with this identifier, NO_SLOT if there is none or a flag bit is set."""
    identifier = np.int64(can_id)
    if identifier > CAN_ID_MASK:
        return np.int64(NO_SLOT)
    return np.int64(codec["slot_of_id"][identifier])


@kernel
def sequence_verdict(codec: Record, rx_state: Record, slot: int, counter: int) -> int:
    """OK, LOST, REPEATED or WRONG_SEQUENCE."""
    delta = (counter - np.int64(rx_state["counter"][slot])) & COUNTER_MASK
    if delta == 1 or rx_state["received"][slot] == 0:
        return OK
    missed = max(rx_state["age_cycles"][slot] - 1, 0) // codec["period_cycles"][slot]
    if missed >= SILENCE_PERIODS:
        return OK
    if delta == 0:
        return REPEATED
    if delta <= DELTA_MAX + missed:
        return LOST
    return WRONG_SEQUENCE


@kernel
def frame_verdict(codec: Record, rx_state: Record, slot: int, frame: Record) -> int:
    """What can be said of a frame without its signals and its sequence."""
    if slot == NO_SLOT:
        return UNKNOWN_ID
    if codec["sender"][slot] != rx_state["sender"]:
        return FOREIGN
    if frame["dlc"] != codec["dlc"][slot]:
        return WRONG_LENGTH
    if not crc_ok(codec, slot, frame["data"]):
        return WRONG_CRC
    return OK


@kernel
def judge(codec: Record, rx_state: Record, frame: Record, values: F8) -> tuple[int, int]:
    """Slot and verdict of a frame; `values` gets its signals if the verdict is a valid one."""
    slot = slot_of(codec, frame["can_id"])
    verdict = frame_verdict(codec, rx_state, slot, frame)
    if verdict != OK:
        return slot, verdict
    word = frame["data"]
    verdict = sequence_verdict(codec, rx_state, slot, counter_of(word))
    if not is_valid(verdict):
        return slot, verdict if in_range(codec, slot, word) else OUT_OF_RANGE
    if unpack(codec, slot, word, values) != UNPACKED:
        return slot, OUT_OF_RANGE
    return slot, verdict


@kernel
def accept(rx_state: Record, slot: int, counter: int, verdict: int) -> None:
    """Move the message's sequence on to `counter` and count the frame."""
    if verdict == LOST:
        delta = (counter - np.int64(rx_state["counter"][slot])) & COUNTER_MASK
        rx_state["lost_frames"] += delta - 1
    rx_state["counter"][slot] = counter
    rx_state["received"][slot] = 1
    rx_state["age_cycles"][slot] = 0
    rx_state["counted"][verdict] += 1


@kernel
def refuse(rx_state: Record, verdict: int) -> None:
    """Count a frame that is not used."""
    rx_state["counted"][verdict] += 1


@kernel
def reclassify(rx_state: Record, verdict: int) -> None:
    """Take back a refusal: the frame is accepted after all, and counted then."""
    rx_state["counted"][verdict] -= 1


@kernel
def receiver_tick(rx_state: Record) -> None:
    """Age all messages by one cycle."""
    age = rx_state["age_cycles"]
    for slot in range(N_MESSAGES):
        age[slot] = min(age[slot] + 1, AGE_MAX_CYCLES)  # no branch: several slots at a time


@kernel
def rejected(rx_state: Record) -> np.int64:
    """Frames refused so far, whatever for."""
    total = np.int64(0)
    for verdict in range(REPEATED, N_VERDICTS):
        total += rx_state["counted"][verdict]
    return total


@kernel
def heard(rx_state: Record) -> np.int64:
    """Frames judged so far."""
    return rx_state["counted"][OK] + rx_state["counted"][LOST] + rejected(rx_state)


@kernel
def report_counters(rx_state: Record, incomplete_sets: int, believed: int, values: F8) -> None:
    """The RX_HEALTH signals of a receiver; counts stay at the most that their signal carries."""
    counted = rx_state["counted"]
    values[HEALTH_WRONG_CRC] = min(counted[WRONG_CRC], REFUSED_MAX)
    values[HEALTH_REPEATED] = min(counted[REPEATED], REFUSED_MAX)
    values[HEALTH_WRONG_SEQUENCE] = min(counted[WRONG_SEQUENCE], REFUSED_MAX)
    values[HEALTH_WRONG_LENGTH] = min(counted[WRONG_LENGTH], WRONG_LENGTH_MAX)
    values[HEALTH_BELIEVED] = min(believed, BELIEVED_MAX)
    values[HEALTH_OUT_OF_RANGE] = min(counted[OUT_OF_RANGE], REFUSED_MAX)
    values[HEALTH_IMPLAUSIBLE] = min(counted[IMPLAUSIBLE], REFUSED_MAX)
    values[HEALTH_UNKNOWN_ID] = min(counted[UNKNOWN_ID], REFUSED_MAX)
    values[HEALTH_INCOMPLETE_SETS] = min(incomplete_sets, REFUSED_MAX)
    values[HEALTH_LOST] = min(rx_state["lost_frames"], MISSED_MAX)
    values[HEALTH_FOREIGN] = min(counted[FOREIGN], MISSED_MAX)
    values[HEALTH_MISDIRECTED] = min(counted[MISDIRECTED], MISDIRECTED_MAX)
    values[HEALTH_HEARD] = heard(rx_state) % HEARD_MODULUS
