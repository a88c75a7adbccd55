"""The mode table against a slow twin, and each condition on both sides of its threshold."""

import itertools
import math
from typing import Any

import numpy as np
import pytest

from flight_sw import modes
from flight_sw.computer import state_dtype
from flight_sw.modes import MODE_DESIGN, MODES, conditions, next_mode

CONDITIONS = (
    "READY",
    "ENTRY_SENSED",
    "SLOW",
    "NAV_LOST",
    "NAV_BACK",
    "BACK_IN_ENTRY",
    "FAST_AGAIN",
)
BITS = {name: getattr(modes, name) for name in CONDITIONS}


def twin(mode: str, holding: set[str]) -> str:
    """What the mode table says in words."""
    if mode == "STANDBY":
        return "COAST" if "READY" in holding else "STANDBY"
    if mode in ("COAST", "ENTRY") and "NAV_LOST" in holding:
        return "SAFE"  # before anything else
    if mode == "COAST":
        return "ENTRY" if "ENTRY_SENSED" in holding else "COAST"
    if mode == "ENTRY":
        return "TERMINAL" if "SLOW" in holding else "ENTRY"
    if mode == "SAFE":
        back = "COAST" if "NAV_BACK" in holding else "SAFE"
        return "ENTRY" if "BACK_IN_ENTRY" in holding else back
    return "ENTRY" if "FAST_AGAIN" in holding else "TERMINAL"


def test_conditions_are_separate_bits() -> None:
    assert sorted(BITS.values()) == [1, 2, 4, 8, 16, 32, 64]


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_under_every_set_of_conditions(mode: str) -> None:
    for n in range(len(CONDITIONS) + 1):
        for holding in itertools.combinations(CONDITIONS, n):
            bits = sum(BITS[name] for name in holding)
            assert MODES[next_mode(MODES.index(mode), bits)] == twin(mode, set(holding)), holding


@pytest.fixture
def state() -> Any:
    """A computer's state with a fix, in nothing that a condition names."""
    record = np.zeros(1, state_dtype("nominal"))[0]
    record["fix_valid"] = 1
    record["nav"]["v_rel_mps"] = 7000.0
    return record


@pytest.fixture
def design() -> Any:
    """Thresholds of a mode table."""
    record = np.zeros(1, MODE_DESIGN.dtype)[0]
    record["entry_load_mps2"] = 5.0
    record["terminal_speed_mps"] = 2000.0
    record["nav_timeout_cycles"] = 25
    record["nav_return_cycles"] = 10
    return record


def test_nothing_holds_in_quiet_flight(design: Any, state: Any) -> None:
    assert conditions(design, state) == 0


def test_ready_needs_arming_and_a_fix(design: Any, state: Any) -> None:
    state["armed"] = 1
    assert conditions(design, state) == modes.READY
    state["fix_valid"] = 0
    assert conditions(design, state) == 0


@pytest.mark.parametrize(("drag", "lift", "sensed"), [
    (3.0, 4.0, True), (4.0, 3.0, True), (3.0, 3.999, False), (5.0, 0.0, True), (0.0, 4.999, False),
])  # fmt: skip
def test_entry_is_sensed_by_the_magnitude_of_the_deceleration(
    design: Any, state: Any, drag: float, lift: float, sensed: bool
) -> None:
    state["nav"]["drag_mps2"], state["nav"]["lift_mps2"] = drag, lift
    assert conditions(design, state) == (modes.ENTRY_SENSED if sensed else 0)


@pytest.mark.parametrize(("v_mps", "slow"), [
    (2000.0, True), (math.nextafter(2000.0, 9e9), False), (1000.0, True),
])  # fmt: skip
def test_slow_is_at_or_below_the_terminal_speed(
    design: Any, state: Any, v_mps: float, slow: bool
) -> None:
    state["nav"]["v_rel_mps"] = v_mps
    assert conditions(design, state) == (modes.SLOW if slow else 0)


def test_without_a_fix_nothing_is_read_from_the_last_one(design: Any, state: Any) -> None:
    state["nav"]["v_rel_mps"], state["nav"]["drag_mps2"] = 100.0, 50.0
    state["fix_valid"] = 0
    assert conditions(design, state) == 0


@pytest.mark.parametrize(("cycles", "lost"), [(0, False), (25, False), (26, True), (1000, True)])
def test_navigation_is_lost_after_the_time_out(
    design: Any, state: Any, cycles: int, lost: bool
) -> None:
    state["cycles_without_fix"] = cycles
    assert conditions(design, state) == (modes.NAV_LOST if lost else 0)


@pytest.mark.parametrize(("fixes", "back"), [(9, False), (10, True), (11, True)])
def test_navigation_is_back_after_enough_fixes_in_a_row(
    design: Any, state: Any, fixes: int, back: bool
) -> None:
    state["fixes_in_row"] = fixes
    state["nav"]["v_rel_mps"] = 2050.0  # not so fast that an end by a false speed is taken back
    assert conditions(design, state) == (modes.NAV_BACK if back else 0)


@pytest.mark.parametrize(("drag_mps2", "bits"), [
    (0.0, modes.NAV_BACK), (6.0, modes.ENTRY_SENSED | modes.NAV_BACK | modes.BACK_IN_ENTRY),
])  # fmt: skip
def test_navigation_that_is_back_in_entry_is_told_apart(
    design: Any, state: Any, drag_mps2: float, bits: int
) -> None:
    state["fixes_in_row"], state["nav"]["drag_mps2"] = 10, drag_mps2
    state["nav"]["v_rel_mps"] = 2050.0
    assert conditions(design, state) == bits


@pytest.mark.parametrize(("v_mps", "fixes", "again"), [
    (2100.0, 10, False), (2100.1, 10, True), (2100.1, 9, False), (7000.0, 0, False),
])  # fmt: skip
def test_an_end_by_a_false_speed_is_taken_back_by_enough_fixes_well_above_it(
    design: Any, state: Any, v_mps: float, fixes: int, again: bool
) -> None:
    state["nav"]["v_rel_mps"], state["fixes_in_row"] = v_mps, fixes
    assert bool(conditions(design, state) & modes.FAST_AGAIN) is again
