"""Requests and who they are meant for: a computer obeys the harness that it flies with."""

import pytest

from flight_sw.reception.requests import ARM, STOP
from flight_sw.runtime.identity import ALONE
from tests.flight_sw.test_computer import modes_of, value
from tests.system.flights import Computer, Recorded, commands, presence, recorded, request


@pytest.fixture(scope="module")
def lqy_flight() -> Recorded:
    """A piece of flight whose frames are replayed."""
    return recorded("lqy", "tracking", 40)


@pytest.mark.parametrize("kind", ["only named", "another computer", "stop"])
def test_without_the_right_request_nothing_leaves_standby(lqy_flight: Recorded, kind: str) -> None:
    made = lqy_flight.made
    computer = Computer(made, armed=False)
    computer.feed(presence(made, ALONE))
    if kind == "another computer":
        computer.feed(request(made, ARM, computer=ALONE ^ 1 << 19))
    if kind == "stop":
        computer.feed(request(made, STOP))
    answers = computer.feed(lqy_flight.navigation.ravel())
    assert set(modes_of(answers)) == {"STANDBY"}
    assert len({value(f) for f in commands(answers)}) == 1
    assert computer.state["stop"][0] == (1 if kind == "stop" else 0)
    assert computer.state["armed"][0] == 0


@pytest.mark.parametrize("bit", range(20))
@pytest.mark.parametrize("whose", ["computer", "harness"])
def test_a_request_for_another_or_of_another_has_no_effect_and_is_counted(
    lqy_flight: Recorded, bit: int, whose: str
) -> None:
    made = lqy_flight.made
    computer = Computer(made, armed=False)
    computer.state["number"] = number = 0x5A5A5
    harness = 0x3C3C3
    computer.feed(request(made, ARM, number, harness))
    wrong = {"computer": number, "harness": harness}
    wrong[whose] ^= 1 << bit
    computer.feed(request(made, STOP, **wrong, counter=1))
    assert computer.state["stop"][0] == 0
    assert computer.counted == {"OK": 1, "MISDIRECTED": 1}
    computer.feed(request(made, STOP, number, harness, counter=1))  # it did not move the sequence
    assert computer.state["stop"][0] == 1


def test_a_computer_that_no_harness_has_named_sends_nothing(lqy_flight: Recorded) -> None:
    made = lqy_flight.made
    computer = Computer(made, armed=False)
    other = ALONE + 1
    computer.feed(presence(made, other))
    computer.feed(request(made, ARM, other))
    assert len(computer.feed(lqy_flight.navigation[:20].ravel())) == 0
    computer.feed(presence(made, ALONE, counter=1))
    answers = computer.feed(lqy_flight.navigation[20:40].ravel())
    assert len(commands(answers)) == 20
    assert set(modes_of(answers)) == {"STANDBY"}


def test_before_it_is_armed_a_computer_goes_over_to_whoever_names_it(lqy_flight: Recorded) -> None:
    made = lqy_flight.made
    computer = Computer(made, armed=False)
    for harness in (7, 8):  # the first was ended before it could arm
        computer.feed(presence(made, ALONE, harness, counter=3))
        assert computer.state["harness"][0] == harness
    computer.feed(request(made, ARM, harness=8))
    computer.feed(presence(made, ALONE, harness=7, counter=4))
    assert (computer.state["harness"][0], computer.state["armed"][0]) == (8, 1)


@pytest.mark.parametrize("counter", range(16))
@pytest.mark.parametrize(
    ("computer_of_theirs", "harness"), [(ALONE, 7), (ALONE + 1, 8), (ALONE + 1, 7), (0, 7)]
)
def test_once_armed_the_presence_of_another_is_refused_and_moves_no_sequence(
    lqy_flight: Recorded, computer_of_theirs: int, harness: int, counter: int
) -> None:
    made = lqy_flight.made
    computer = Computer(made, armed=False)
    computer.feed(request(made, ARM, harness=8))
    computer.feed(presence(made, ALONE, 8, counter=3))
    computer.feed(presence(made, computer_of_theirs, harness, counter))
    assert computer.counted == {"OK": 2, "MISDIRECTED": 1}
    computer.feed(presence(made, ALONE, 8, counter=4))  # the next of ours is in sequence
    assert computer.counted == {"OK": 3, "MISDIRECTED": 1}
    assert computer.state["harness"][0] == 8


def test_our_own_repeated_word_is_repeated_not_misdirected(lqy_flight: Recorded) -> None:
    made = lqy_flight.made
    computer = Computer(made, armed=False)
    for frames in (request(made, ARM, harness=8), presence(made, ALONE, 8)) * 2:
        computer.feed(frames)
    assert computer.counted == {"OK": 2, "REPEATED": 2}
