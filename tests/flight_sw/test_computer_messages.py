"""What the computer sends: which messages, when, in what order, with what in them."""

from typing import Any

import numpy as np
import pytest

from flight_sw import icd
from flight_sw.records.dictionary import FRAME, RX_CAPACITY, TICK_ID
from tests.system.flights import (
    Computer,
    Frames,
    Recorded,
    cantools_values,
    commands,
    recorded,
)

CYCLES = 120
PIECE = "tracking"
TIME_ID = icd.layout("NAV_TIME").can_id
TIMEOUT_CYCLES, RETURN_CYCLES = 25, 10  # 0.5 s and 0.2 s of hyperion-1's design at 50 Hz
BAD_CYCLE = 70  # where single frames are spoilt: in flight, tracking


@pytest.fixture(scope="module", params=["nominal", "lqy"])
def flight(request: Any) -> Recorded:
    """A piece of flight whose frames are replayed."""
    return recorded(request.param, PIECE, CYCLES)


@pytest.fixture(scope="module")
def lqy_flight() -> Recorded:
    """The same, one law."""
    return recorded("lqy", PIECE, CYCLES)


def replay(flight: Recorded, frames: Frames, most: int = RX_CAPACITY) -> tuple[Computer, Frames]:
    """A fresh computer that was handed these frames, and its answers."""
    computer = Computer(flight.made)
    return computer, computer.feed(frames, most)


def with_inserted(flight: Recorded, bad: dict[tuple[int, int], list[Any]]) -> Frames:
    """The flight's frames with others before frame j of cycle i."""
    parts = []
    for (i, j), frame in np.ndenumerate(flight.navigation):
        parts += [*bad.get((i, j), []), frame]
    return np.array(parts, FRAME)


def changed(frame: Any, **fields: int) -> Any:
    """A copy of a frame with fields replaced."""
    copy = np.zeros(1, FRAME)
    copy[0] = frame
    for name, value in fields.items():
        copy[name] = value
    return copy[0]


def test_each_message_comes_at_its_rate(flight: Recorded) -> None:
    ids, counts = np.unique(flight.answers["can_id"], return_counts=True)
    found = {
        m.name: int(n)
        for m in icd.LAYOUT
        for i, n in zip(ids, counts, strict=True)
        if m.can_id == i
    }
    tenth, second = CYCLES // 5, -(-CYCLES // 50)
    expected = {
        "FSW_COMMAND": CYCLES,
        "FSW_STATUS": CYCLES,
        "TM_NOMINAL_A": tenth,
        "TM_NOMINAL_B": tenth,
    }
    if flight.made.law == "lqy":
        expected["TM_LQY"] = tenth
    expected |= {f"RX_HEALTH_{letter}": second for letter in "ABC"}
    assert found == expected


def test_a_cycle_begins_with_the_command_and_ends_with_the_status(flight: Recorded) -> None:
    ids = flight.answers["can_id"]
    command, ending = icd.layout("FSW_COMMAND").can_id, icd.layout("FSW_STATUS").can_id
    assert ids[0] == command
    assert ids[-1] == ending
    assert (np.roll(ids, -1)[ids == ending] == command).all()


def test_status_names_the_cycle_and_seals_the_command(flight: Recorded) -> None:
    states = cantools_values(flight.answers, "FSW_STATUS")
    assert [s["cycle"] for s in states] == list(range(CYCLES))
    for state, command in zip(states, commands(flight.answers), strict=True):
        words = [(int(command["data"]) >> shift) & 0xFFFF for shift in (0, 16, 32, 48)]
        assert state["command_seal"] == words[0] ^ words[1] ^ words[2] ^ words[3]


def test_every_message_counts_up_by_one(flight: Recorded) -> None:
    sent = {m.name for m in icd.LAYOUT if m.can_id in flight.answers["can_id"]}
    assert {"FSW_COMMAND", "FSW_STATUS", "TM_NOMINAL_A", "RX_HEALTH_A"} <= sent
    for message in sent:
        counters = [v["e2e_counter"] for v in cantools_values(flight.answers, message)]
        assert counters == [i % 16 for i in range(len(counters))], message


def test_commands_and_telemetry_carry_what_the_computer_holds(lqy_flight: Recorded) -> None:
    computer, answers = replay(lqy_flight, lqy_flight.navigation[: CYCLES - 4].ravel())
    state = computer.state[0]
    command = cantools_values(answers, "FSW_COMMAND")[-1]
    assert command["bank_cmd_rad"] == pytest.approx(state["bank_limiter"]["command_rad"], abs=6e-8)
    assert command["alpha_cmd_rad"] == pytest.approx(np.radians(20.0), abs=6e-8)
    inner = state["law"]["nominal"]
    a, b = (cantools_values(answers, f"TM_NOMINAL_{letter}")[-1] for letter in "AB")
    assert a["bank_nominal_rad"] == pytest.approx(inner["bank_rad"], abs=6e-8)
    assert a["flight_path_angle_cmd_rad"] == pytest.approx(inner["gamma_cmd_rad"], abs=3e-8)
    assert b["flow_exponent"] == pytest.approx(inner["flow_exponent"], abs=6e-7)
    assert b["tracking_constant_ratio"] == pytest.approx(inner["constant_ratio"], abs=6e-6)
    loop = cantools_values(answers, "TM_LQY")[-1]
    assert loop["bank_correction_rad"] == pytest.approx(state["law"]["correction_rad"], abs=2e-7)
    assert loop["heat_flux_error_wpm2"] == pytest.approx(
        state["law"]["heat_flux_error_wpm2"], abs=0.3
    )


def test_health_tells_what_was_refused(lqy_flight: Recorded) -> None:
    flight = lqy_flight
    frame = flight.navigation[30, 1]
    bad = {(30, 1): [changed(frame, data=int(frame["data"]) ^ 1)] * 3 + [changed(frame, dlc=3)] * 2}
    _, answers = replay(flight, with_inserted(flight, bad))
    last = {}
    for letter in "ABC":
        last |= cantools_values(answers, f"RX_HEALTH_{letter}")[-1]
    told = {k: v for k, v in last.items() if v and not k.startswith("e2e")}
    sets = 1 + cantools_values(answers, "FSW_STATUS")[-1]["cycle"] // 50 * 50  # 50 a report
    heard = 1 + len(bad[30, 1]) + 7 * sets  # a request, and seven messages a set
    assert told == {"wrong_crc": 3, "wrong_length": 2, "heard": heard}


def test_a_cycle_closed_by_a_tick_tells_so_and_what_was_heard_before(flight: Recorded) -> None:
    computer = Computer(flight.made)
    computer.feed(flight.navigation[:3].ravel())
    computer.feed(flight.navigation[3, :4])
    tick = np.zeros(1, FRAME)
    tick["can_id"] = TICK_ID
    answer = computer.feed(tick)
    told = cantools_values(answer, "RX_HEALTH_C")
    assert [(t["heard"], t["ticked"]) for t in told] == [(1 + 3 * 7 + 4, 1)]
    assert cantools_values(answer, "RX_HEALTH_A") == []  # not due
    after = computer.feed(flight.navigation[3:60].ravel())
    told = cantools_values(after, "RX_HEALTH_C")
    assert [(t["heard"], t["ticked"]) for t in told] == [(1 + 51 * 7 + 4, 0)]
