"""False frames with right checksums among true ones: what they can displace, and for how long."""

from typing import Any

import numpy as np
import pytest

from flight_sw import icd
from flight_sw.can.codec import pack, unpack
from flight_sw.can.e2e import counter_of, protect
from flight_sw.reception.candidate import GAP_MAX_CYCLES
from flight_sw.records.dictionary import FRAME, TICK_ID
from tests.system.flights import (
    NAV_FRAMES,
    Computer,
    Frames,
    Recorded,
    cantools_values,
    commands,
    recorded,
)

CYCLES = 120
AGREEING_CYCLES = 25  # 0.5 s of hyperion-1's design
START, AT = 40, 60
MESSAGES = tuple(m for m in icd.LAYOUT if m.name.startswith("NAV_"))
TIME = NAV_FRAMES - 1  # the last of a set


@pytest.fixture(scope="module")
def flight() -> Recorded:
    """A piece of flight whose frames are replayed."""
    return recorded("lqy", "tracking", CYCLES)


def altered(flight: Recorded, frame: Any, ahead: int = 0, **changes: float) -> Any:
    """The frame with its counter so far ahead and these signals moved, its checksum right."""
    codec = flight.made.load["codec"][0]
    slot = int(codec["slot_of_id"][int(frame["can_id"])])
    values = np.zeros(icd.N_VALUES)
    unpack(codec, slot, frame["data"], values)
    for name, change in changes.items():
        values[icd.value_index(icd.MESSAGES[slot], name)] += change
    word, code = pack(codec, slot, values)
    assert code == 0
    copy = np.zeros(1, FRAME)
    copy[0] = frame
    copy["data"] = protect(codec, slot, word, int(counter_of(frame["data"])) + ahead)
    return copy[0]


def replay(flight: Recorded, frames: list[Any]) -> tuple[Computer, Frames]:
    """A fresh computer that was handed these frames, and its answers."""
    computer = Computer(flight.made)
    return computer, computer.feed(np.array(frames, FRAME))


def with_false(flight: Recorded, false: dict[tuple[int, int], list[Any]]) -> list[Any]:
    """The flight's frames with false ones before frame j of cycle i."""
    parts: list[Any] = []
    for (i, j), frame in np.ndenumerate(flight.navigation):
        parts += [*false.get((i, j), []), frame]
    return parts


def holds(flight: Recorded, frames: list[Any]) -> Computer:
    """That the commands are those of the flight to the bit; the computer that gave them."""
    computer, answers = replay(flight, frames)
    assert commands(answers).tobytes() == commands(flight.answers).tobytes()
    assert computer.state["incomplete_sets"][0] == 0
    return computer


@pytest.mark.parametrize("ahead", [1, 2, 3])
@pytest.mark.parametrize("j", range(NAV_FRAMES))
def test_a_frame_ahead_of_its_cycle_displaces_no_true_one(
    flight: Recorded, j: int, ahead: int
) -> None:
    false = {(i, 0): [altered(flight, flight.navigation[i, j], ahead)] for i in range(20, 100, 3)}
    computer = holds(flight, with_false(flight, false))
    assert computer.counted == {"OK": CYCLES * NAV_FRAMES + 1, "WRONG_SEQUENCE": len(false)}


@pytest.mark.parametrize("ahead", [1, 2, 3])
def test_whole_sets_ahead_but_for_their_time_displace_nothing(flight: Recorded, ahead: int) -> None:
    false = {
        (i, 0): [altered(flight, frame, ahead) for frame in flight.navigation[i, :TIME]]
        for i in range(20, 100)
    }
    holds(flight, with_false(flight, false))


def test_of_two_frames_of_one_cycle_the_one_nearer_to_dead_reckoning_is_taken(
    flight: Recorded,
) -> None:
    far = {
        "NAV_POSITION": {"lat_rad": 4e-5}, "NAV_VERTICAL": {"v_rel_mps": 6.0, "alt_m": 100.0},
        "NAV_DIRECTION": {"heading_rad": 0.015}, "NAV_AERO": {"drag_mps2": 5.0},
        "NAV_ATTITUDE": {"bank_rad": 0.04}, "NAV_HEATING": {"heat_flux_wpm2": 6e4},
    }  # fmt: skip
    for j, message in enumerate(MESSAGES[:TIME]):
        for i in (70, 90):
            false = altered(flight, flight.navigation[i, j], **far[message.name])
            for frames in (
                with_false(flight, {(i, j): [false]}),  # before the true one
                with_false(flight, {(i, j + 1): [false]}),  # and behind it
            ):
                computer = holds(flight, frames)
                assert computer.counted["REPEATED"] == 1


def test_frames_whose_time_message_was_lost_are_those_of_the_lost_cycle(flight: Recorded) -> None:
    frames = [f for (i, j), f in np.ndenumerate(flight.navigation) if (i, j) != (AT, TIME)]
    computer, answers = replay(flight, frames)
    assert len(commands(answers)) == CYCLES - 1
    assert computer.state["fix_valid"][0] == 1
    assert computer.state["incomplete_sets"][0] == 0
    assert computer.counted == {"OK": CYCLES * NAV_FRAMES - 1, "LOST": 1}


def test_a_time_message_ahead_of_its_cycle_needs_its_set_beside_it(flight: Recorded) -> None:
    computer, _ = replay(flight, list(flight.navigation[:AT].ravel()))
    alone = computer.feed(flight.navigation[AT + 1, TIME:])
    assert len(alone) == 0  # a lone one closes nothing
    whole = computer.feed(flight.navigation[AT + 1])
    assert len(commands(whole)) == 1
    assert computer.state["fix_valid"][0] == 1


@pytest.mark.parametrize("lost", [1, 2, 3, 7, 20])
def test_after_ticks_the_set_that_is_due_by_them_is_a_fix(flight: Recorded, lost: int) -> None:
    computer, _ = replay(flight, list(flight.navigation[:AT].ravel()))
    silent = np.zeros(lost, FRAME)
    silent["can_id"] = TICK_ID
    computer.feed(silent)
    computer.feed(flight.navigation[AT + lost])
    assert computer.state["fix_valid"][0] == 1


def test_a_false_time_costs_its_own_cycle_and_no_other(flight: Recorded) -> None:
    early = {(AT, 3): [flight.navigation[AT, TIME]]}  # the right one, but amid its set
    computer, answers = replay(flight, with_false(flight, early))
    assert computer.state["incomplete_sets"][0] == 1
    assert computer.state["fix_valid"][0] == 1
    assert commands(answers)["data"][AT - 1] >> 12 == commands(answers)["data"][AT] >> 12


@pytest.mark.parametrize("step_s", [-0.02, 0.02, 0.1, 0.3, 7.0])
def test_a_time_that_does_not_go_with_its_counter_is_refused(
    flight: Recorded, step_s: float
) -> None:
    false = {(AT, TIME): [altered(flight, flight.navigation[AT, TIME], t_s=step_s)]}
    computer = holds(flight, with_false(flight, false))
    assert computer.counted["IMPLAUSIBLE"] == 1


def test_eight_false_times_open_no_gate(flight: Recorded) -> None:
    wrong = [altered(flight, flight.navigation[AT, TIME], t_s=100.0 + k) for k in range(8)]
    then = [altered(flight, flight.navigation[AT, 1], alt_m=50e3)]
    computer = holds(flight, with_false(flight, {(AT, 0): wrong, (AT, 1): then}))
    assert computer.counted["IMPLAUSIBLE"] == len(wrong) + 1


def shifted(flight: Recorded, cycles: range, **changes: float) -> list[Any]:
    """These sets with signals moved in each of the messages that have them."""
    found: list[Any] = []
    for i in cycles:
        for j, frame in enumerate(flight.navigation[i]):
            names = icd.signal_names(MESSAGES[j].name)
            mine = {name: change for name, change in changes.items() if name in names}
            found.append(altered(flight, frame, **mine) if mine else frame)
    return found


@pytest.mark.parametrize(("n", "believed"), [(AGREEING_CYCLES - 1, 0), (AGREEING_CYCLES, 1)])
def test_sets_that_agree_are_believed_after_the_stated_number_and_not_before(
    flight: Recorded, n: int, believed: int
) -> None:
    frames = list(flight.navigation[:START].ravel())
    computer, _ = replay(flight, frames)
    computer.feed(np.array(shifted(flight, range(START, START + n), alt_m=5e3), FRAME))
    assert computer.state["candidate"]["believed"][0] == believed
    assert computer.state["fix_valid"][0] == believed
    answers = computer.feed(np.array(shifted(flight, range(START + n, CYCLES), alt_m=5e3), FRAME))
    told = [one["candidates_believed"] for one in cantools_values(answers, "RX_HEALTH_A")]
    assert told == [1]  # one report in what is left, by then believed in either case


def test_one_true_set_between_ends_a_candidate(flight: Recorded) -> None:
    computer, _ = replay(flight, list(flight.navigation[:START].ravel()))
    first = START + AGREEING_CYCLES - 1
    computer.feed(np.array(shifted(flight, range(START, first), alt_m=5e3), FRAME))
    computer.feed(flight.navigation[first])
    assert computer.state["fix_valid"][0] == 1
    assert computer.state["candidate"]["agreeing"][0] == 0


@pytest.mark.parametrize(("gap", "goes_on"), [(GAP_MAX_CYCLES, True), (GAP_MAX_CYCLES + 1, False)])
def test_a_candidate_bridges_a_few_lost_sets(flight: Recorded, gap: int, goes_on: bool) -> None:
    computer, _ = replay(flight, list(flight.navigation[:START].ravel()))
    middle = START + 10
    computer.feed(np.array(shifted(flight, range(START, middle), alt_m=5e3), FRAME))
    silent = np.zeros(gap - 1, FRAME)
    silent["can_id"] = TICK_ID
    computer.feed(silent)
    after = middle + gap - 1
    computer.feed(np.array(shifted(flight, range(after, after + 1), alt_m=5e3), FRAME))
    assert computer.state["candidate"]["agreeing"][0] == (11 if goes_on else 1)


def test_sets_that_do_not_move_as_they_say_are_no_candidate(flight: Recorded) -> None:
    """Each step passes every gate, yet the altitude climbs by 5 km/s on a level path."""
    computer, _ = replay(flight, list(flight.navigation[:START].ravel()))
    for i in range(START, START + AGREEING_CYCLES + 10):
        climb_m = 5e3 + 100.0 * (i - START)
        computer.feed(np.array(shifted(flight, range(i, i + 1), alt_m=climb_m), FRAME))
    assert computer.state["candidate"]["believed"][0] == 0
    assert computer.state["candidate"]["agreeing"][0] < AGREEING_CYCLES


def test_a_liar_beside_the_truth_is_never_believed(flight: Recorded) -> None:
    false = {
        (i, 1): [altered(flight, flight.navigation[i, 1], alt_m=5e3)] for i in range(START, CYCLES)
    }
    computer = holds(flight, with_false(flight, false))
    assert computer.state["candidate"]["believed"][0] == 0
    assert computer.counted["IMPLAUSIBLE"] == len(false)
