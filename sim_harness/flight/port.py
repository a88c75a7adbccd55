"""The harness's end of the bus: navigation out, commands in.

A cycle's navigation messages all carry the cycle number modulo 16 as their counter, and the time
message goes last. A command is flown once the status message that follows it names this cycle.
"""

import numpy as np

from flight_sw import icd
from flight_sw.can.address import ERROR_FLAG
from flight_sw.can.codec import pack, unpack
from flight_sw.can.e2e import counter_of, crc_ok, protect
from flight_sw.can.error_frames import ERRORS, note_error
from flight_sw.computer import (
    ALPHA_CMD,
    ALPHA_SATURATED,
    BANK_CMD,
    BANK_SATURATED,
    COMMAND,
    COUNTER_MODULUS,
    CYCLE,
    CYCLE_MODULUS,
    FIX_VALID,
    LAW_STATUS,
    MODE,
    PHASE,
    SEAL,
    STATUS,
    TRACKING,
    seal_of,
)
from flight_sw.reception.candidate import NAV_SLOTS
from flight_sw.reception.plausibility import TIME
from flight_sw.reception.receiver import (
    FOREIGN,
    RX_STATE,
    accept,
    is_valid,
    judge,
    receiver_tick,
    refuse,
)
from flight_sw.reception.requests import (
    PRESENT,
    PRESENT_COMPUTER,
    PRESENT_HARNESS,
    PRESENT_STATE,
    REQUEST,
    REQUEST_CODE,
    REQUEST_COMPUTER,
    REQUEST_HARNESS,
)
from flight_sw.records.types_ import Frames, Record
from flight_sw.runtime.identity import ALONE, NOBODY
from sim_harness.jit import kernel

SENT_SLOTS = (*NAV_SLOTS, TIME)
BOOT = icd.slot("FSW_BOOT")
BOOT_COMPUTER = icd.value_index("FSW_BOOT", "computer")
WAITING, FLYING_HERE = 0, 1  # states of HARNESS_PRESENT

PORT = np.dtype(
    [
        ("values", "f8", (icd.N_VALUES,)),  # to be sent
        ("withheld", "u4"),  # bits of the navigation messages that are not
        ("received", "f8", (icd.N_VALUES,)),
        ("rx", RX_STATE),
        ("request_counter", "u4"),
        ("present_counter", "u4"),
        ("harness", "u4"),  # number of this harness
        ("computer", "u4"),  # number of the one that it flies with; 0: none yet
        ("other_harness", "u4"),  # number of another one heard; 0: none
        ("other_computer", "u4"),
        ("frames_sent", "i8"),
        ("frames_received", "i8"),
        ("errors", ERRORS),  # what the interface told of itself
        ("tx_refused", "i8"),  # messages whose values the DBC does not carry
        ("command", "u8"),  # word of the command that waits for its status message
        ("flown", "u8"),  # word of the last command that was complete in time
        ("bank_wanted_rad", "f8"),  # in the command that waits
        ("alpha_wanted_rad", "f8"),
        ("bank_cmd_rad", "f8"),  # flown
        ("alpha_cmd_rad", "f8"),
        ("answered", "u4"),  # this cycle's status message has come
        ("stale_answers", "i8"),  # status messages of another cycle
        ("mode", "u4"),
        ("phase", "u4"),
        ("tracking", "u4"),
        ("fix_valid", "u4"),
        ("bank_saturated", "u4"),
        ("alpha_saturated", "u4"),
        ("law_status", "u4"),
    ],
    align=True,
)
"""What the harness's end remembers."""


def new_port(bank_rad: float, alpha_rad: float) -> np.ndarray:
    """A port that has heard nothing, shape (1,): the attitude at entry is held until it does."""
    port = np.zeros(1, PORT)
    port["rx"]["sender"] = icd.NODES.index("FSW")
    port["harness"] = port["computer"] = ALONE
    port["bank_cmd_rad"] = bank_rad
    port["alpha_cmd_rad"] = alpha_rad
    return port


@kernel
def _put(codec: Record, port: Record, slot: int, counter: int, tx: Frames, n_tx: int) -> int:
    word, code = pack(codec, slot, port["values"])
    if code != 0:
        port["tx_refused"] += 1
        return n_tx
    frame = tx[n_tx]
    frame["can_id"] = codec["can_id"][slot]
    frame["dlc"] = codec["dlc"][slot]
    frame["pad"] = 0
    frame["res0"] = 0
    frame["len8_dlc"] = 0
    frame["data"] = protect(codec, slot, word, counter)
    port["frames_sent"] += 1
    return n_tx + 1


@kernel
def put_navigation(codec: Record, port: Record, cycle: int, tx: Frames) -> int:
    """The cycle's navigation set from `port["values"]` into `tx`; returns its length."""
    counter = cycle % COUNTER_MODULUS
    n_tx = 0
    withheld = port["withheld"]
    for i in range(len(SENT_SLOTS)):
        if (withheld >> i) & 1 == 0:
            n_tx = _put(codec, port, SENT_SLOTS[i], counter, tx, n_tx)
    port["answered"] = 0
    receiver_tick(port["rx"])
    return n_tx


@kernel
def put_request(codec: Record, port: Record, request: int, tx: Frames) -> int:
    """One ground request into `tx`; returns its length."""
    values = port["values"]
    values[REQUEST_CODE] = request
    values[REQUEST_COMPUTER] = port["computer"]
    values[REQUEST_HARNESS] = port["harness"]
    counter = port["request_counter"]
    port["request_counter"] = (counter + 1) % COUNTER_MODULUS
    return _put(codec, port, REQUEST, counter, tx, 0)


@kernel
def put_presence(codec: Record, port: Record, state: int, tx: Frames) -> int:
    """One message into `tx` that says who flies here with whom; returns its length."""
    values = port["values"]
    values[PRESENT_HARNESS] = port["harness"]
    values[PRESENT_COMPUTER] = port["computer"]
    values[PRESENT_STATE] = state
    counter = port["present_counter"]
    port["present_counter"] = (counter + 1) % COUNTER_MODULUS
    return _put(codec, port, PRESENT, counter, tx, 0)


@kernel
def _note_harness(codec: Record, port: Record, word: np.uint64) -> None:
    """Remember the number of another harness that says it is here."""
    if crc_ok(codec, PRESENT, word) and unpack(codec, PRESENT, word, port["received"]) == 0:
        port["other_harness"] = int(port["received"][PRESENT_HARNESS])


@kernel
def _note_computer(port: Record) -> None:
    """Remember the number of another flight computer that says it is here."""
    number = int(port["received"][BOOT_COMPUTER])
    if port["computer"] not in (NOBODY, number):
        port["other_computer"] = number


@kernel
def _take_status(port: Record, cycle: int) -> None:
    """Fly the waiting command if the status message is this cycle's and seals it."""
    received = port["received"]
    if int(received[CYCLE]) != cycle % CYCLE_MODULUS or int(received[SEAL]) != seal_of(
        port["command"]
    ):
        port["stale_answers"] += 1
        return
    port["answered"] = 1
    port["flown"] = port["command"]
    port["bank_cmd_rad"] = port["bank_wanted_rad"]
    port["alpha_cmd_rad"] = port["alpha_wanted_rad"]
    port["mode"] = int(received[MODE])
    port["phase"] = int(received[PHASE])
    port["tracking"] = int(received[TRACKING])
    port["fix_valid"] = int(received[FIX_VALID])
    port["bank_saturated"] = int(received[BANK_SATURATED])
    port["alpha_saturated"] = int(received[ALPHA_SATURATED])
    port["law_status"] = int(received[LAW_STATUS])


@kernel
def take(codec: Record, port: Record, frame: Record, cycle: int) -> None:
    """Judge one frame from the bus; sets `answered` when the cycle's command is complete."""
    if frame["can_id"] & ERROR_FLAG != 0:
        note_error(port["errors"], frame["can_id"], frame["data"])
        return
    port["frames_received"] += 1
    rx = port["rx"]
    received = port["received"]
    slot, verdict = judge(codec, rx, frame, received)
    if not is_valid(verdict):
        if verdict == FOREIGN and slot == PRESENT:
            _note_harness(codec, port, frame["data"])
        refuse(rx, verdict)
        return
    accept(rx, slot, counter_of(frame["data"]), verdict)
    if slot == COMMAND:
        port["command"] = frame["data"]
        port["bank_wanted_rad"] = received[BANK_CMD]
        port["alpha_wanted_rad"] = received[ALPHA_CMD]
    elif slot == STATUS:
        _take_status(port, cycle)
    elif slot == BOOT:
        _note_computer(port)
