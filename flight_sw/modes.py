"""Modes of the flight computer: one table of transitions, one function that reads it."""

import math

from flight_sw import icd
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

STANDBY, COAST, ENTRY, TERMINAL, SAFE = 0, 1, 2, 3, 4
MODES = ("STANDBY", "COAST", "ENTRY", "TERMINAL", "SAFE")

READY = 1  # armed by the ground, and a navigation fix is there
ENTRY_SENSED = 2  # sensed deceleration above the threshold
SLOW = 4  # below the speed at which the law ends
NAV_LOST = 8  # no fix for longer than the time-out
NAV_BACK = 16  # fixes again, enough of them in a row
BACK_IN_ENTRY = 32  # the same, and deceleration is sensed: no detour by the attitude of coasting
FAST_AGAIN = 64  # as many fixes, and well above the speed at which the law ends: it was no such end

FAST_AGAIN_RATIO = 1.05  # of that speed, so that noise about it ends nothing twice

TRANSITIONS = (  # first matching row wins
    (STANDBY, READY, COAST),
    (COAST, NAV_LOST, SAFE),
    (ENTRY, NAV_LOST, SAFE),
    (COAST, ENTRY_SENSED, ENTRY),
    (ENTRY, SLOW, TERMINAL),
    (TERMINAL, FAST_AGAIN, ENTRY),
    (SAFE, BACK_IN_ENTRY, ENTRY),
    (SAFE, NAV_BACK, COAST),
)

MODE_DESIGN = RecordSpec(
    "modes",
    Field("entry_load_mps2", 0.0, 1000.0, "sensed deceleration that starts guidance"),
    Field(
        "terminal_speed_mps",
        *icd.signal_range("NAV_VERTICAL", "v_rel_mps"),
        "guidance ends below it",
    ),
    Field("nav_timeout_cycles", 1, 100_000, "cycles without a fix before SAFE", kind="u4"),
    Field("nav_return_cycles", 1, 100_000, "fixes in a row that end SAFE", kind="u4"),
    Field("coast_bank_rad", -math.pi, math.pi, "held before entry is sensed"),
    Field("coast_alpha_rad", -math.pi, math.pi, "held before entry is sensed"),
)


@kernel
def next_mode(mode: int, conditions: int) -> int:
    """The mode after one cycle under these conditions."""
    for here, condition, there in TRANSITIONS:
        if mode == here and conditions & condition:
            return there
    return mode


@kernel
def conditions(design: Record, state: Record) -> int:
    """Which of the transition conditions hold after this cycle's navigation was judged."""
    nav = state["nav"]
    bits = 0
    if state["fix_valid"] == 1:
        if state["armed"] == 1:
            bits |= READY
        load_mps2 = math.sqrt(
            nav["drag_mps2"] * nav["drag_mps2"] + nav["lift_mps2"] * nav["lift_mps2"]
        )
        if load_mps2 >= design["entry_load_mps2"]:
            bits |= ENTRY_SENSED
        if nav["v_rel_mps"] <= design["terminal_speed_mps"]:
            bits |= SLOW
    if state["cycles_without_fix"] > design["nav_timeout_cycles"]:
        bits |= NAV_LOST
    if state["fixes_in_row"] >= design["nav_return_cycles"]:
        bits |= NAV_BACK
        if bits & ENTRY_SENSED:
            bits |= BACK_IN_ENTRY
        if nav["v_rel_mps"] > FAST_AGAIN_RATIO * design["terminal_speed_mps"]:
            bits |= FAST_AGAIN
    return bits
