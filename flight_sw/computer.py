"""The minor frame: receive, navigation, mode, guidance, limit, transmit.

A pure function of records and CAN frames. A cycle is closed by the time message, which the other
side sends last; how the frames before it were cut into calls makes no difference to the result.
"""

import math

import numpy as np
import numpy.typing as npt

from flight_sw import icd, modes
from flight_sw.can.codec import pack
from flight_sw.can.e2e import protect
from flight_sw.guidance import law_coast, law_module, law_step
from flight_sw.limits import LIMITER, limit
from flight_sw.model.onboard import FORCES
from flight_sw.reception import plausibility as gate
from flight_sw.reception.candidate import CANDIDATE
from flight_sw.reception.navigation_set import ASIDE, NO_SLOT, close_set, receive
from flight_sw.reception.receiver import RX_STATE, receiver_tick, report_counters
from flight_sw.records import status
from flight_sw.records.dictionary import GUIDANCE, NAV
from flight_sw.records.types_ import Frames, Record
from flight_sw.runtime.identity import ALONE, NOBODY
from flight_sw.runtime.jit import kernel

COMMAND = icd.slot("FSW_COMMAND")
STATUS = icd.slot("FSW_STATUS")
HEALTH = (icd.slot("RX_HEALTH_A"), icd.slot("RX_HEALTH_B"), icd.slot("RX_HEALTH_C"))
TICKED = icd.value_index("RX_HEALTH_C", "ticked")

BANK_CMD = icd.value_index("FSW_COMMAND", "bank_cmd_rad")
ALPHA_CMD = icd.value_index("FSW_COMMAND", "alpha_cmd_rad")

CYCLE = icd.value_index("FSW_STATUS", "cycle")
MODE = icd.value_index("FSW_STATUS", "mode")
PHASE = icd.value_index("FSW_STATUS", "phase")
TRACKING = icd.value_index("FSW_STATUS", "tracking")
FIX_VALID = icd.value_index("FSW_STATUS", "fix_valid")
BANK_SATURATED = icd.value_index("FSW_STATUS", "bank_saturated")
ALPHA_SATURATED = icd.value_index("FSW_STATUS", "alpha_saturated")
LAW_STATUS = icd.value_index("FSW_STATUS", "law_status")
SEAL = icd.value_index("FSW_STATUS", "command_seal")
SEAL_SHIFTS = (np.uint64(16), np.uint64(32), np.uint64(48))
SEAL_MASK = np.uint64(0xFFFF)

CYCLE_MODULUS = 1 << 20  # of the cycle number in FSW_STATUS
COUNTER_MODULUS = 16


def state_dtype(law: str) -> np.dtype[np.void]:
    """Everything the computer remembers between cycles: its bytes are a checkpoint."""
    return np.dtype(
        [
            ("cycle", "u4"),
            ("cycles_run", "u4"),  # since boot; wraps
            ("mode", "u4"),
            ("armed", "u4"),
            ("number", "u4"),  # that this computer drew for itself
            ("harness", "u4"),  # number of the one that it flies with; 0: none has named it
            ("stop", "u4"),
            ("radius_m", "f8"),  # of the planet, beside the fix for the gates
            ("fix_valid", "u4"),  # this cycle's navigation set was complete and consistent
            ("had_fix", "u4"),
            ("cycles_without_fix", "u4"),
            ("fixes_in_row", "u4"),
            ("incomplete_sets", "u4"),
            ("bank_saturated", "u4"),
            ("alpha_saturated", "u4"),
            ("tx_refused", "u4"),
            ("nav", NAV),
            ("received", "f8", (icd.N_VALUES,)),  # as decoded, before acceptance
            ("accepted", "f8", (icd.N_VALUES,)),
            ("sent", "f8", (icd.N_VALUES,)),
            ("fresh", "i4", (icd.N_MESSAGES,)),  # counter of this cycle's message, -1: none
            ("aside", ASIDE),
            ("candidate", CANDIDATE),
            ("modelled", FORCES.dtype),  # at the last fix, for a gate that asks
            ("tx_counter", "u4", (icd.N_MESSAGES,)),
            ("rx", RX_STATE),
            ("bank_limiter", LIMITER.dtype),
            ("alpha_limiter", LIMITER.dtype),
            ("guidance", GUIDANCE),
            ("law", law_module(law).STATE.dtype),
        ],
        align=True,
    )


def new_state(law: str, number: int = ALONE) -> npt.NDArray[np.void]:
    """A computer's state before its first frame, shape (1,)."""
    state = np.zeros(1, state_dtype(law))
    state["number"] = number
    state["fresh"] = NO_SLOT
    state["aside"]["counter"] = NO_SLOT
    state["cycle"] = CYCLE_MODULUS - 1
    return state


@kernel
def _take_fix(load: Record, state: Record) -> None:
    """A fix is a set of navigation messages that all carry the time message's counter."""
    timed = state["fresh"][gate.TIME] != NO_SLOT
    passed_cycles = np.int64(1)
    found = close_set(load, state)
    if timed:
        cycle = np.int64(math.floor(state["accepted"][gate.T] / load["dt_s"] + 0.5))
        # Cycles of which nothing came count too: the gates widen with all that passed.
        passed_cycles = max(cycle - np.int64(state["cycle"]), np.int64(1))
        state["cycle"] = cycle
        if not found:
            state["incomplete_sets"] += 1
    else:
        state["cycle"] += 1
    if not found:
        state["fix_valid"] = 0
        state["fixes_in_row"] = 0
        state["cycles_without_fix"] += passed_cycles
        return
    state["fix_valid"] = 1
    state["had_fix"] = 1
    state["fixes_in_row"] += 1
    state["cycles_without_fix"] = 0


@kernel
def _guide(load: Record, state: Record) -> None:
    """Run the law where the mode says so; otherwise the wanted command stays what it was."""
    out = state["guidance"]
    mode = state["mode"]
    if mode in (modes.STANDBY, modes.COAST):
        out["bank_cmd_rad"] = load["modes"]["coast_bank_rad"]
        out["alpha_cmd_rad"] = load["modes"]["coast_alpha_rad"]
        out["tracking"] = 0
        if mode == modes.COAST:
            law_coast(load, state["law"], state["nav"], state["fix_valid"] == 1, out)
    elif mode == modes.ENTRY:
        if state["fix_valid"] == 0:
            out["status"] = status.NO_FIX
        elif state["cycle"] % load["guidance_divider"] == 0:
            out["status"] = law_step(load, state["law"], state["nav"], out)
    else:
        out["tracking"] = 0


@kernel
def _limit_commands(load: Record, state: Record) -> None:
    """Bank and angle-of-attack commands within their limits, into the vector of sent values."""
    out = state["guidance"]
    sent = state["sent"]
    bank = state["bank_limiter"]
    alpha = state["alpha_limiter"]
    bank_code = limit(out["bank_cmd_rad"], load["dt_s"], load["bank_limits"], bank)
    alpha_code = limit(out["alpha_cmd_rad"], load["dt_s"], load["alpha_limits"], alpha)
    state["bank_saturated"] = 1 if bank_code == status.SATURATED else 0
    state["alpha_saturated"] = 1 if alpha_code == status.SATURATED else 0
    if status.NONFINITE in (bank_code, alpha_code):
        out["status"] = status.NONFINITE
    sent[BANK_CMD] = bank["command_rad"]
    sent[ALPHA_CMD] = alpha["command_rad"]


@kernel
def seal_of(word: np.uint64) -> int:
    """What FSW_STATUS carries of a command's frame word: its four 16-bit words, exclusive-or."""
    folded = word
    for shift in SEAL_SHIFTS:
        folded ^= word >> shift
    return int(folded & SEAL_MASK)


@kernel
def _send(load: Record, state: Record, slot: int, tx: Frames, n_tx: int) -> int:
    """Append message `slot` made of the sent values; a value out of range sends nothing."""
    codec = load["codec"]
    word, code = pack(codec, slot, state["sent"])
    if code != status.OK or n_tx >= len(tx):
        state["tx_refused"] += 1
        return n_tx
    counters = state["tx_counter"]
    frame = tx[n_tx]
    frame["can_id"] = codec["can_id"][slot]
    frame["dlc"] = codec["dlc"][slot]
    frame["pad"] = 0
    frame["res0"] = 0
    frame["len8_dlc"] = 0
    frame["data"] = protect(codec, slot, word, counters[slot])
    counters[slot] = (counters[slot] + 1) % COUNTER_MODULUS
    return n_tx + 1


@kernel
def _send_telemetry(load: Record, state: Record, ticked: bool, tx: Frames, n_tx: int) -> int:
    """The law's telemetry and the receiver's counters, each at its own sub-rate.

    A cycle that no time message closed tells so: where its tick fell among the frames heard, a
    recording does not show otherwise.
    """
    sent = state["sent"]
    wiring = load["wiring"]
    if state["cycle"] % wiring["telemetry_divider"] == 0:
        telemetry = state["guidance"]["telemetry"]
        value_index = wiring["value_index"]
        for i in range(len(value_index)):
            if value_index[i] >= 0:
                sent[value_index[i]] = telemetry[i]
        slots = wiring["slot"]
        for i in range(wiring["n_messages"]):
            n_tx = _send(load, state, slots[i], tx, n_tx)
    due = state["cycle"] % wiring["health_divider"] == 0
    if due or ticked:
        believed = state["candidate"]["believed"]
        report_counters(state["rx"], state["incomplete_sets"], believed, sent)
        sent[TICKED] = 1 if ticked else 0
        for i in range(0 if due else len(HEALTH) - 1, len(HEALTH)):
            n_tx = _send(load, state, HEALTH[i], tx, n_tx)
    return n_tx


@kernel
def _send_status(load: Record, state: Record, tx: Frames, n_tx: int) -> int:
    """The message that ends a cycle's answer: it names the cycle and seals the command."""
    sent = state["sent"]
    out = state["guidance"]
    sent[CYCLE] = state["cycle"] % CYCLE_MODULUS
    sent[MODE] = state["mode"]
    sent[PHASE] = out["phase"]
    sent[TRACKING] = out["tracking"]
    sent[FIX_VALID] = state["fix_valid"]
    sent[BANK_SATURATED] = state["bank_saturated"]
    sent[ALPHA_SATURATED] = state["alpha_saturated"]
    sent[LAW_STATUS] = out["status"]
    return _send(load, state, STATUS, tx, n_tx)


@kernel
def step(load: Record, state: Record, tx: Frames, n_tx: int) -> int:
    """One cycle, its navigation set closed: appends the answer to `tx`, returns its new length.

    A computer that no harness has named keeps silent: whoever flies on this bus flies with another.
    """
    state["cycles_run"] += 1
    ticked = state["fresh"][gate.TIME] == NO_SLOT
    _take_fix(load, state)
    receiver_tick(state["rx"])
    state["radius_m"] = load["onboard"]["planet"]["radius_m"]
    state["mode"] = modes.next_mode(state["mode"], modes.conditions(load["modes"], state))
    _guide(load, state)
    _limit_commands(load, state)
    if state["harness"] == NOBODY:
        return n_tx
    before = n_tx
    n_tx = _send(load, state, COMMAND, tx, n_tx)
    if n_tx > before:
        state["sent"][SEAL] = seal_of(tx[before]["data"])
    n_tx = _send_telemetry(load, state, ticked, tx, n_tx)
    return _send_status(load, state, tx, n_tx)


@kernel
def minor_frame(load: Record, state: Record, rx: Frames, n_rx: int, tx: Frames) -> int:
    """Take `n_rx` frames, run each cycle they close; frames to send are left in `tx`.

    Returns how many. `tx` holds dictionary.TX_CAPACITY frames, enough for every cycle that
    dictionary.RX_CAPACITY frames can close.
    """
    n_tx = 0
    for i in range(n_rx):
        if receive(load, state, rx[i]):
            n_tx = step(load, state, tx, n_tx)
    return n_tx
