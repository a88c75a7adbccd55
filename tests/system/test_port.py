"""The harness's end of the bus: what it sends is the truth, what it flies is sealed."""

from typing import Any

import cantools
import numpy as np
import pytest

from flight_sw import icd
from flight_sw.records.dictionary import FRAME, RX_CAPACITY
from sim_harness.flight.port import new_port, put_navigation, take
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.navigation import LAT, LON, NAV_STATE, V_REL, measure
from tests.system.flights import (
    NAV_FRAMES,
    Frames,
    Recorded,
    commands,
    is_from_computer,
    recorded,
)

CYCLES = 40
CYCLE = 25  # whose answer is spoilt
COMMAND_ID, STATUS_ID = (icd.layout(name).can_id for name in ("FSW_COMMAND", "FSW_STATUS"))


@pytest.fixture(scope="module")
def flight() -> Recorded:
    """A piece of flight whose answers are given again."""
    return recorded("lqy", "tracking", CYCLES)


class Heard:
    """A port that hears answers, cycle by cycle."""

    def __init__(self, flight: Recorded) -> None:
        self.codec = flight.made.load["codec"]
        self.port = new_port(0.5, 0.6)
        self.spare = np.zeros(RX_CAPACITY, FRAME)

    def hear(self, cycle: int, frames: Any) -> bool:
        """One cycle's answer; whether a command was flown on it."""
        put_navigation(self.codec[0], self.port[0], cycle, self.spare)
        for frame in frames:
            take(self.codec[0], self.port[0], frame, cycle)
        return bool(self.port["answered"][0])

    @property
    def flown(self) -> tuple[float, float]:
        """The command that is flown."""
        return float(self.port["bank_cmd_rad"][0]), float(self.port["alpha_cmd_rad"][0])


def answers_of(flight: Recorded) -> list[Frames]:
    """The computer's frames of each cycle."""
    ends = np.flatnonzero(flight.answers["can_id"] == STATUS_ID) + 1
    return np.split(flight.answers, ends)[:-1]


def heard_until(flight: Recorded, cycle: int) -> Heard:
    """A port that has heard everything before a cycle."""
    listener = Heard(flight)
    for i, frames in enumerate(answers_of(flight)[:cycle]):
        assert listener.hear(i, frames)
    return listener


def test_until_it_hears_anything_the_attitude_at_entry_is_held(flight: Recorded) -> None:
    listener = Heard(flight)
    assert not listener.hear(0, [])
    assert listener.flown == (0.5, 0.6)


def test_each_answer_is_flown_in_its_cycle(flight: Recorded) -> None:
    database = cantools.database.load_file(icd.DBC_PATH)
    listener = Heard(flight)
    for i, frames in enumerate(answers_of(flight)):
        assert listener.hear(i, frames)
        (command,) = commands(frames)
        told = database.decode_message(COMMAND_ID, int(command["data"]).to_bytes(8, "little"))
        assert listener.flown == pytest.approx(
            (told["bank_cmd_rad"], told["alpha_cmd_rad"]), abs=1e-15
        )
    assert listener.port["mode"][0] == 2
    assert listener.port["phase"][0] > 0
    assert listener.port["fix_valid"][0] == 1
    assert listener.port["stale_answers"][0] == 0


@pytest.mark.parametrize("can_id", [COMMAND_ID, STATUS_ID])
def test_an_answer_with_a_wrong_bit_is_not_flown(flight: Recorded, can_id: int) -> None:
    right = answers_of(flight)[CYCLE]
    for bit in range(64):
        listener = heard_until(flight, CYCLE)
        before = listener.flown
        frames = right.copy()
        frames["data"][frames["can_id"] == can_id] ^= np.uint64(1 << bit)
        assert not listener.hear(CYCLE, frames)
        assert listener.flown == before
        assert listener.hear(CYCLE + 1, answers_of(flight)[CYCLE + 1])  # and the next one is


def test_wrong_frames_beside_the_right_ones_change_nothing(flight: Recorded) -> None:
    listener, calm = heard_until(flight, CYCLE), heard_until(flight, CYCLE)
    right = answers_of(flight)[CYCLE]
    wrong = np.repeat(right, 64)
    wrong["data"] ^= np.tile(np.uint64(1) << np.arange(64, dtype=np.uint64), len(right))
    foreign = flight.navigation[CYCLE]
    assert listener.hear(CYCLE, np.concatenate([wrong, foreign, right]))
    assert calm.hear(CYCLE, right)
    assert listener.flown == calm.flown
    counted = listener.port["rx"]["counted"][0]
    assert counted.sum() - calm.port["rx"]["counted"][0].sum() == len(wrong) + len(foreign)


def test_an_answer_to_another_cycle_is_stale(flight: Recorded) -> None:
    listener = heard_until(flight, CYCLE)
    before = listener.flown
    assert not listener.hear(CYCLE + 1, answers_of(flight)[CYCLE])
    assert listener.flown == before
    assert listener.port["stale_answers"][0] == 1


def test_a_command_without_its_own_status_is_not_flown(flight: Recorded) -> None:
    listener = heard_until(flight, CYCLE)
    before = listener.flown
    mixed = np.concatenate(
        [commands(answers_of(flight)[CYCLE + 1]), answers_of(flight)[CYCLE][-1:]]
    )
    assert not listener.hear(CYCLE, mixed)
    assert listener.flown == before


def test_a_navigation_set_carries_the_truth_to_the_resolution_of_the_bus(flight: Recorded) -> None:
    database = cantools.database.load_file(icd.DBC_PATH)
    for i in range(0, CYCLES, 7):
        told: dict[str, float] = {}
        for frame in flight.navigation[i]:
            decoded = database.decode_message(
                int(frame["can_id"]), int(frame["data"]).to_bytes(8, "little")
            )
            assert decoded["e2e_counter"] == i % 16
            told |= {k: float(v) for k, v in decoded.items()}
        truth = flight.truth[i]
        for message in (m for m in icd.LAYOUT if m.name.startswith("NAV_")):
            for signal in message.signals:
                expected = (
                    abs(truth[signal.name]) if signal.name == "lift_mps2" else truth[signal.name]
                )
                close = pytest.approx(expected, abs=0.501 * signal.scale)
                assert told[signal.name] == close, signal.name
    assert flight.navigation["can_id"][0][-1] == icd.layout("NAV_TIME").can_id


def test_a_value_that_the_bus_does_not_carry_is_not_sent(flight: Recorded) -> None:
    listener = Heard(flight)
    world, truth = world_of(flight.made.mission), truth_of(flight.made.mission)
    measure(world[0], truth[0], np.zeros(1, NAV_STATE)[0], listener.port["values"][0])
    assert put_navigation(listener.codec[0], listener.port[0], 0, listener.spare) == NAV_FRAMES
    for index, value in ((V_REL, 2e4), (LON, 4.0), (LAT, np.nan)):
        kept = listener.port["values"][0, index]
        listener.port["values"][0, index] = value
        assert (
            put_navigation(listener.codec[0], listener.port[0], 1, listener.spare) == NAV_FRAMES - 1
        )
        listener.port["values"][0, index] = kept
    assert listener.port["tx_refused"][0] == 3
    assert not is_from_computer(listener.spare[:NAV_FRAMES]).any()
