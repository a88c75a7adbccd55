"""Who else is on a bus, from the frames that they send: refused in one sentence that names them."""

import re
from typing import Any

import pytest

from flight_sw.announcer import ARMED, COMPILING, READY
from flight_sw.can.plain import plain_frame
from flight_sw.errors import FlightError
from flight_sw.runtime.identity import SOURCES
from sim_harness.flight import roles
from sim_harness.flight.port import FLYING_HERE, WAITING
from sim_harness.flight.roles import Company

OURS, LOAD = 0x50000, 0xDEADBEEF
LAW = 1


def company() -> Company:
    """A harness of this number on a bus."""
    return Company("unix:bus", OURS, LOAD)


def hear_computer(
    heard: Company, number: int, state: int = READY, load: int = LOAD, sources: int = SOURCES
) -> None:
    """A computer announces itself twice."""
    boot = {"computer": number, "state": state, "law": LAW, "sources": sources}
    for counter in range(2):
        heard.hear(plain_frame("FSW_BOOT", boot, counter))
        heard.hear(plain_frame("FSW_LOAD", {"computer": number, "load_crc32": load}, counter))


def hear_harness(
    heard: Company, number: int, state: int = WAITING, computer: int = 0, words: int = 2
) -> None:
    """Another harness says so often that it is here."""
    raw = {"harness": number, "computer": computer, "state": state}
    for counter in range(words):
        heard.hear(plain_frame("HARNESS_PRESENT", raw, counter))


def refusal(check: Any, **how: Any) -> str:
    """The sentence of a check that refuses."""
    with pytest.raises(FlightError) as caught:
        check(**how)
    return str(caught.value)


def test_a_bus_of_ones_own_is_not_refused() -> None:
    heard = company()
    hear_computer(heard, 7)
    heard.check_harnesses(claimed=False)
    heard.check_computers(most=1)
    assert heard.ready() == 7
    assert heard.other_sources(7) == ""


def test_the_same_false_announcement_said_again_is_nobody() -> None:
    heard = company()
    hear_computer(heard, 7)
    boot = {"computer": 9, "state": ARMED, "law": LAW, "sources": SOURCES}
    for _ in range(5):
        heard.hear(plain_frame("FSW_BOOT", boot, 3))
        raw = {"harness": 8, "computer": 7, "state": FLYING_HERE}
        heard.hear(plain_frame("HARNESS_PRESENT", raw, 3))
    heard.check_computers(most=1)
    heard.check_harnesses(claimed=False)
    assert heard.ready() == 7


class LateHub:
    """A reader's end whose queue is full, and is filled again after a moment."""

    def __init__(self, queues: list[int]) -> None:
        self.queues = queues

    def recv(self, size: int, flags: int) -> bytes:
        """One packet of the queue; nothing while the hub has not brought the next."""
        if self.queues and self.queues[0] == 0:
            self.queues.pop(0)
            raise BlockingIOError
        if not self.queues:
            raise BlockingIOError
        self.queues[0] -= 1
        return bytes(size)


def test_all_that_a_hub_has_kept_for_a_late_reader_is_dropped() -> None:
    near = LateHub([278, 278, 278, 9])
    roles.drain(near)  # type: ignore[arg-type]
    assert near.queues == []


@pytest.mark.parametrize("claimed", [False, True])
@pytest.mark.parametrize("number", [OURS - 1, OURS + 1])
def test_a_harness_that_flies_stays_whatever_its_number(claimed: bool, number: int) -> None:
    heard = company()
    hear_harness(heard, number, FLYING_HERE, computer=0xABCDE)
    wanted = f"unix:bus: harness 0x{number:05x} flies there with flight computer 0xabcde"
    assert refusal(heard.check_harnesses, claimed=claimed) == wanted


@pytest.mark.parametrize(
    ("number", "claimed", "is_refused"),
    [(OURS - 1, True, True), (OURS + 1, True, False), (OURS + 1, False, True)],
)
def test_of_two_that_wait_the_earlier_stays_and_of_two_at_once_the_smaller_number(
    number: int, claimed: bool, is_refused: bool
) -> None:
    heard = company()
    hear_harness(heard, number)
    if is_refused:
        wanted = f"unix:bus: harness 0x{number:05x} waits there"
        assert refusal(heard.check_harnesses, claimed=claimed) == wanted
    else:
        heard.check_harnesses(claimed=claimed)


def test_a_single_word_with_a_right_checksum_refuses_nothing() -> None:
    heard = company()
    for number in range(1, 200):
        hear_harness(heard, number, words=1)
        raw = {"computer": number, "state": ARMED, "law": LAW, "sources": 0}
        heard.hear(plain_frame("FSW_BOOT", raw, number))
    heard.check_harnesses(claimed=False)
    heard.check_computers(most=0)


def test_a_flight_that_does_not_say_its_number_is_noticed_by_its_sets() -> None:
    heard = company()
    for counter in range(3):
        heard.check_harnesses(claimed=True)
        heard.hear(plain_frame("NAV_TIME", {"t_s": 20_000 * counter}, counter))
    assert refusal(heard.check_harnesses, claimed=True) == "unix:bus: another harness flies there"


@pytest.mark.parametrize("state", [COMPILING, READY])
def test_a_second_computer_is_named_beside_the_first(state: int) -> None:
    heard = company()
    hear_computer(heard, 7)
    hear_computer(heard, 0x12345, state, load=1)
    wanted = "unix:bus: flight computers 0x00007 and 0x12345 are there, allowed is one"
    assert refusal(heard.check_computers, most=1) == wanted


def test_a_computer_on_the_bus_is_refused_by_whoever_brings_one() -> None:
    heard = company()
    hear_computer(heard, 7)
    wanted = "unix:bus: flight computer 0x00007 is there already"
    assert refusal(heard.check_computers, most=0) == wanted


def test_a_computer_in_the_hands_of_another_is_refused() -> None:
    heard = company()
    hear_computer(heard, 7, ARMED)
    assert re.fullmatch(
        "unix:bus: flight computer 0x00007 is armed there by a harness that is silent",
        refusal(heard.check_computers, most=1),
    )
    assert heard.ready() == 0


def test_a_computer_of_other_sources_and_one_with_another_load_are_told() -> None:
    heard = company()
    hear_computer(heard, 7, sources=SOURCES ^ 1)
    assert heard.other_sources(7) == (
        "unix:bus: flight computer 0x00007 was built from other sources, "
        f"0x{SOURCES ^ 1:05x}, ours are 0x{SOURCES:05x}"
    )
    hear_computer(heard, 8, load=0x1234)
    assert heard.other_loads() == "; flight computer 0x00008 has load 0x00001234"


def test_who_has_gone_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    heard = company()
    now_s = [100.0]
    monkeypatch.setattr(roles.time, "monotonic", lambda: now_s[0])
    hear_computer(heard, 7)
    hear_harness(heard, OURS - 1)
    now_s[0] += 2.0 * roles.FRESH_S
    heard.check_harnesses(claimed=True)
    heard.check_computers(most=0)
    hear_computer(heard, 8)
    assert heard.ready() == 8
