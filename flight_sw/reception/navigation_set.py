"""From frames to a fix: which frames make the cycle's set, and what is believed after a doubt.

A frame that is due, in sequence and plausible is accepted. One with a right checksum that is not is
set aside: it may belong to the cycle whose time message was lost, or be the truth that the last fix
contradicts. Two frames of one message and one cycle are weighed against dead reckoning.

A time message closes a cycle. Whole sets that were refused, follow each other through the gates and
move as they say they do are a candidate; after `agreeing_cycles` of them without a fix between, the
candidate is believed and the last fix is not.
"""

import math

import numpy as np

from flight_sw import icd
from flight_sw.can.codec import unpack
from flight_sw.can.e2e import counter_of
from flight_sw.reception import plausibility as gate
from flight_sw.reception.candidate import GAP_MAX_CYCLES, NAV_SLOTS, fill_nav, join, surprise
from flight_sw.reception.receiver import (
    COUNTER_MASK,
    IMPLAUSIBLE,
    MISDIRECTED,
    OK,
    REPEATED,
    WRONG_SEQUENCE,
    accept,
    is_valid,
    judge,
    reclassify,
    refuse,
)
from flight_sw.reception.requests import (
    PRESENT,
    REQUEST,
    is_misdirected,
    take_presence,
    take_request,
)
from flight_sw.records.dictionary import TICK_ID
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel, seldom_kernel

SET_SLOTS = (*NAV_SLOTS, gate.TIME)
FIRST_NAV, LAST_NAV = min(SET_SLOTS), max(SET_SLOTS)

NO_SLOT = -1
MAJORITY = 4  # of the six messages: a time message ahead of its cycle needs so many beside it

ASIDE = np.dtype(
    [
        ("counter", "i4", (icd.N_MESSAGES,)),  # of the frame set aside in this cycle, -1: none
        ("fits", "u4", (icd.N_MESSAGES,)),  # 1: it can follow the last fix
        ("sequence", "u4", (icd.N_MESSAGES,)),  # its verdict by sequence
        ("refused_as", "u4", (icd.N_MESSAGES,)),  # and the one it was counted under
        ("values", "f8", (icd.N_VALUES,)),
    ],
    align=True,
)


def _is_one_block() -> bool:
    """Whether the slots of the set are neighbours: the kernels compare with first and last."""
    return LAST_NAV - FIRST_NAV + 1 == len(SET_SLOTS)


if not _is_one_block():
    raise ImportError("the navigation messages of the DBC are not numbered without a gap")


@kernel
def _copy_message(codec: Record, slot: int, source: F8, target: F8) -> None:
    first = codec["first_value"][slot]
    for i in range(first, first + codec["n_signals"][slot]):
        target[i] = source[i]


@kernel
def _receive_other(load: Record, state: Record, frame: Record, slot: int, verdict: int) -> None:
    """A frame that is not of the navigation set: a request, a harness's presence, or nothing."""
    rx = state["rx"]
    if verdict in (REPEATED, WRONG_SEQUENCE):
        unpack(load["codec"], slot, frame["data"], state["received"])
    elif not is_valid(verdict):
        refuse(rx, verdict)
        return
    if is_misdirected(state, slot):
        refuse(rx, MISDIRECTED)
        return
    if not is_valid(verdict):
        refuse(rx, verdict)
        return
    accept(rx, slot, counter_of(frame["data"]), verdict)
    _copy_message(load["codec"], slot, state["received"], state["accepted"])
    if slot == REQUEST:
        take_request(state)
    elif slot == PRESENT:
        take_presence(state)


@kernel
def _is_due(rx: Record, counter: int) -> bool:
    """Whether this is the counter of the cycle that is being collected.

    That is the one after the last time message, or the one that is due by the cycles passed since.
    """
    if rx["received"][gate.TIME] == 0:
        return True
    steps = (counter - np.int64(rx["counter"][gate.TIME])) & COUNTER_MASK
    return steps == 1 or steps == np.int64(rx["age_cycles"][gate.TIME]) & COUNTER_MASK


@kernel
def _backing(state: Record, counter: int) -> int:
    """How many of the six other messages carry this counter, accepted or set aside."""
    n = 0
    fresh = state["fresh"]
    aside = state["aside"]["counter"]
    for slot in NAV_SLOTS:
        if fresh[slot] == counter or aside[slot] == counter:
            n += 1
    return n


@kernel
def is_held_up(state: Record) -> bool:
    """Whether the set of this cycle is there, and its time message was refused."""
    counter = np.int64(state["aside"]["counter"][gate.TIME])
    return counter != NO_SLOT and _backing(state, counter) >= MAJORITY


@kernel
def _time_fits(load: Record, state: Record, counter: int, t_s: float) -> bool:
    """Whether time and counter have moved on together since the last time message."""
    rx = state["rx"]
    if state["had_fix"] == 0 or rx["received"][gate.TIME] == 0:
        return True
    steps = counter - np.int64(rx["counter"][gate.TIME])
    cycles = np.int64(math.floor((t_s - state["accepted"][gate.T]) / load["dt_s"] + 0.5))
    return (cycles - steps) & COUNTER_MASK == 0


@seldom_kernel
def _weigh(load: Record, state: Record, slot: int) -> None:
    """Of two plausible frames of one message and cycle the less surprising one stays."""
    if state["had_fix"] == 0 or not gate.plausible(load, state, slot, state["received"]):
        return
    held = surprise(load, state, slot, state["accepted"])
    if surprise(load, state, slot, state["received"]) < held:
        _copy_message(load["codec"], slot, state["received"], state["accepted"])


@kernel
def _is_better_aside(load: Record, state: Record, slot: int, counter: int, fits: bool) -> bool:
    """Whether a frame takes the place of the one of its counter that was set aside before it."""
    aside = state["aside"]
    if aside["counter"][slot] != counter:
        return True
    if aside["fits"][slot] == 1 and not fits:
        return False
    candidate = state["candidate"]
    if candidate["agreeing"] == 0 or slot == gate.TIME:
        return True
    nav = candidate["nav"]
    received = state["received"]
    cycles = np.int64(GAP_MAX_CYCLES)
    return gate.follows(load, state, nav, cycles, slot, received, received) or not gate.follows(
        load, state, nav, cycles, slot, aside["values"], aside["values"]
    )


@seldom_kernel
def _set_aside(
    load: Record, state: Record, slot: int, counter: int, sequence: int, refused_as: int
) -> None:
    """Keep a frame that was not accepted for the end of the cycle."""
    received = state["received"]
    fits = refused_as != IMPLAUSIBLE and gate.plausible(load, state, slot, received)
    if not _is_better_aside(load, state, slot, counter, fits):
        return
    aside = state["aside"]
    aside["counter"][slot] = counter
    aside["fits"][slot] = 1 if fits else 0
    aside["sequence"][slot] = sequence if is_valid(sequence) else OK
    aside["refused_as"][slot] = refused_as
    _copy_message(load["codec"], slot, received, aside["values"])


@kernel
def receive(load: Record, state: Record, frame: Record) -> bool:
    """Judge one frame and keep it if it is good; True when it closed a cycle.

    A refused frame changes no fix and no sequence.
    """
    if frame["can_id"] == TICK_ID:
        return True
    codec = load["codec"]
    rx = state["rx"]
    received = state["received"]
    slot, verdict = judge(codec, rx, frame, received)
    if slot < FIRST_NAV or slot > LAST_NAV:
        _receive_other(load, state, frame, slot, verdict)
        return False
    counter = counter_of(frame["data"])
    refused_as = verdict
    if is_valid(verdict):
        due = _is_due(rx, counter)
        if not due and slot == gate.TIME:
            due = _backing(state, counter) >= MAJORITY
        refused_as = IMPLAUSIBLE if due else WRONG_SEQUENCE
        if due and gate.plausible(load, state, slot, received):
            if slot != gate.TIME or _time_fits(load, state, counter, received[gate.T]):
                accept(rx, slot, counter, verdict)
                _copy_message(codec, slot, received, state["accepted"])
                state["fresh"][slot] = counter
                return slot == gate.TIME
    elif verdict in (REPEATED, WRONG_SEQUENCE):
        unpack(codec, slot, frame["data"], received)
    refuse(rx, refused_as)
    if refused_as == REPEATED and state["fresh"][slot] == counter:
        _weigh(load, state, slot)
    elif refused_as in (REPEATED, WRONG_SEQUENCE, IMPLAUSIBLE):
        _set_aside(load, state, slot, counter, verdict, refused_as)
        if slot == gate.TIME:
            return _agree(load, state, counter)
    return False


@seldom_kernel
def _agree(load: Record, state: Record, counter: int) -> bool:
    """Take a whole set that was refused for a candidate; True once it is to be believed.

    Then the set stands in `state` as an accepted one.
    """
    if _backing(state, counter) < len(NAV_SLOTS):
        return False
    codec = load["codec"]
    rx = state["rx"]
    fresh = state["fresh"]
    aside = state["aside"]
    values = state["received"]
    for slot in SET_SLOTS:
        source = state["accepted"] if fresh[slot] == counter else aside["values"]
        _copy_message(codec, slot, source, values)
    if not join(load, state, counter, values):
        return False
    for slot in SET_SLOTS:
        _copy_message(codec, slot, values, state["accepted"])
        fresh[slot] = counter
        rx["counter"][slot] = counter
        rx["received"][slot] = 1
        rx["age_cycles"][slot] = 0
    return True


@kernel
def _is_complete(state: Record, counter: int) -> bool:
    """Whether all six messages carry the counter and can follow the last fix."""
    fresh = state["fresh"]
    aside = state["aside"]
    for slot in NAV_SLOTS:
        set_aside = aside["counter"][slot] == counter and aside["fits"][slot] == 1
        if fresh[slot] != counter and not set_aside:
            return False
    return True


@kernel
def _take_aside(load: Record, state: Record, counter: int) -> None:
    """Accept what was set aside for this cycle: its time message has come."""
    rx = state["rx"]
    fresh = state["fresh"]
    aside = state["aside"]
    for slot in NAV_SLOTS:
        if fresh[slot] != counter:
            reclassify(rx, aside["refused_as"][slot])
            accept(rx, slot, counter, aside["sequence"][slot])
            _copy_message(load["codec"], slot, aside["values"], state["accepted"])


@kernel
def close_set(load: Record, state: Record) -> bool:
    """At the end of a cycle: whether its set is a fix, which then stands in `accepted`."""
    counter = state["fresh"][gate.TIME]
    found = counter != NO_SLOT and _is_complete(state, counter)
    if found:
        _take_aside(load, state, counter)
        state["candidate"]["agreeing"] = 0
    elif counter != NO_SLOT:
        found = _agree(load, state, counter)
    if found:
        fill_nav(state["nav"], state["accepted"])
    fresh = state["fresh"]
    aside = state["aside"]["counter"]
    for slot in range(FIRST_NAV, LAST_NAV + 1):
        fresh[slot] = NO_SLOT
        aside[slot] = NO_SLOT
    return found
