"""The minor frame: what a frame may change, and what none may."""

import itertools
from typing import Any

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flight_sw import icd, modes
from flight_sw.reception.requests import STOP
from flight_sw.records import status
from flight_sw.records.dictionary import FRAME, RX_CAPACITY, TICK_ID
from tests.system.flights import (
    NAV_FRAMES,
    Computer,
    Frames,
    Recorded,
    World,
    cantools_values,
    commands,
    recorded,
    request,
)

CYCLES = 120
PIECE = "tracking"
AGREEING_CYCLES = 25  # 0.5 s of hyperion-1's design
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


def modes_of(answers: Frames) -> list[str]:
    """Modes that the status messages of the answers tell, as cantools reads them."""
    database = cantools.database.load_file(icd.DBC_PATH)
    word = icd.layout("FSW_STATUS").can_id
    found = answers[answers["can_id"] == word]
    return [
        str(database.decode_message(word, int(f["data"]).to_bytes(8, "little"))["mode"])
        for f in found
    ]


def test_replayed_frames_give_the_commands_of_the_flight(flight: Recorded) -> None:
    _, answers = replay(flight, flight.navigation.ravel())
    assert answers.tobytes() == flight.answers.tobytes()
    assert len(commands(answers)) == CYCLES
    assert len(np.unique(commands(answers)["data"])) > CYCLES // 2  # it does command something


def test_the_flight_passes_through_the_modes_up_to_entry(flight: Recorded) -> None:
    assert [mode for mode, _ in itertools.groupby(modes_of(flight.answers))] == ["COAST", "ENTRY"]


@given(cuts=st.lists(st.integers(1, RX_CAPACITY), min_size=1, max_size=30))
@settings(max_examples=25)
def test_how_frames_are_cut_into_calls_changes_nothing(cuts: list[int]) -> None:
    flight = recorded("lqy", PIECE, CYCLES)
    frames = flight.navigation[: CYCLES // 3].ravel()
    computer = Computer(flight.made)
    answers, at = [], 0
    for size in itertools.cycle(cuts):
        if at >= len(frames):
            break
        answers.append(computer.call(frames[at : at + size].copy()))
        at += size
    assert np.concatenate(answers).tobytes() == flight.answers[: sum(map(len, answers))].tobytes()
    assert sum(map(len, commands(np.concatenate(answers)).reshape(1, -1))) == CYCLES // 3


def test_calls_with_nothing_change_nothing(lqy_flight: Recorded) -> None:
    computer = Computer(lqy_flight.made)
    before = computer.state.tobytes()
    assert len(computer.call(np.zeros(0, FRAME))) == 0
    assert computer.state.tobytes() == before


KINDS = {
    "wrong crc": ("WRONG_CRC", lambda f, _: changed(f, data=int(f["data"]) ^ (1 << 20))),
    "repeated": ("REPEATED", lambda _, last: last),
    "unknown id": ("UNKNOWN_ID", lambda f, _: changed(f, can_id=0x123)),
    "extended id": ("UNKNOWN_ID", lambda f, _: changed(f, can_id=0x80000000 | int(f["can_id"]))),
    "remote frame": ("UNKNOWN_ID", lambda f, _: changed(f, can_id=0x40000000 | int(f["can_id"]))),
    "short": ("WRONG_LENGTH", lambda f, _: changed(f, dlc=7)),
    "long": ("WRONG_LENGTH", lambda f, _: changed(f, dlc=9)),
    "empty": ("WRONG_LENGTH", lambda f, _: changed(f, dlc=0)),
}


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_bad_frame_is_counted_and_moves_no_command(flight: Recorded, kind: str) -> None:
    verdict, spoil = KINDS[kind]
    bad = {}
    for i in range(3, CYCLES):
        j = i % NAV_FRAMES
        bad[i, j] = [spoil(flight.navigation[i, j], flight.navigation[i - 1, j])]
    computer, answers = replay(flight, with_inserted(flight, bad))
    assert commands(answers).tobytes() == commands(flight.answers).tobytes()
    assert computer.counted == {"OK": CYCLES * NAV_FRAMES + 1, verdict: len(bad)}
    assert not computer.state["incomplete_sets"][0]


@pytest.mark.parametrize("age", range(2, 13))
def test_frames_out_of_order_are_counted_and_move_no_command(
    lqy_flight: Recorded, age: int
) -> None:
    flight = lqy_flight
    bad = {
        (i, j): [flight.navigation[i - age, j]] for i in range(20, 60) for j in range(NAV_FRAMES)
    }
    computer, answers = replay(flight, with_inserted(flight, bad))
    assert commands(answers).tobytes() == commands(flight.answers).tobytes()
    assert computer.counted["WRONG_SEQUENCE"] == len(bad)


def test_frames_of_the_computer_itself_are_foreign(flight: Recorded) -> None:
    own = {(i, 2): list(flight.answers[i : i + 3]) for i in range(5, CYCLES)}
    computer, answers = replay(flight, with_inserted(flight, own))
    assert commands(answers).tobytes() == commands(flight.answers).tobytes()
    assert computer.counted["FOREIGN"] == 3 * len(own)


def flipped(frame: Any) -> list[Any]:
    """The frame with each one of its bits wrong: identifier with its flags, length, data."""
    return [
        *(changed(frame, data=int(frame["data"]) ^ (1 << bit)) for bit in range(64)),
        *(changed(frame, can_id=int(frame["can_id"]) ^ (1 << bit)) for bit in range(32)),
        *(changed(frame, dlc=int(frame["dlc"]) ^ (1 << bit)) for bit in range(8)),
    ]


@pytest.mark.parametrize("j", range(NAV_FRAMES))
def test_every_one_bit_error_of_a_navigation_frame_is_refused(flight: Recorded, j: int) -> None:
    wrong = flipped(flight.navigation[BAD_CYCLE, j])
    computer, answers = replay(flight, with_inserted(flight, {(BAD_CYCLE, j): wrong}))
    assert commands(answers).tobytes() == commands(flight.answers).tobytes()
    assert len(answers) == len(flight.answers)
    assert computer.counted["OK"] == CYCLES * NAV_FRAMES + 1
    assert sum(computer.counted.values()) == CYCLES * NAV_FRAMES + 1 + len(wrong)


@pytest.mark.parametrize("j", range(NAV_FRAMES))
@pytest.mark.parametrize("bit", [0, 9, 12, 40, 63])
def test_a_spoilt_frame_in_place_of_the_right_one_costs_one_cycle(
    lqy_flight: Recorded, j: int, bit: int
) -> None:
    frames = lqy_flight.navigation.copy()
    frames["data"][BAD_CYCLE, j] ^= np.uint64(1 << bit)
    computer, answers = replay(lqy_flight, frames.ravel())
    sent, right = commands(answers), commands(lqy_flight.answers)
    if j == NAV_FRAMES - 1:  # the time message: nothing closes this cycle, the next set does
        assert len(sent) == CYCLES - 1
    else:
        assert len(sent) == CYCLES
        assert value(sent[BAD_CYCLE]) == value(right[BAD_CYCLE - 1])  # held
        assert computer.state["incomplete_sets"][0] == 1
    assert sent[:BAD_CYCLE].tobytes() == right[:BAD_CYCLE].tobytes()
    assert computer.counted["WRONG_CRC"] == 1
    assert computer.state["fix_valid"][0] == 1


def value(frame: Any) -> int:
    """The payload of a frame, without counter and checksum."""
    return int(frame["data"]) >> 12


def ticks(n: int) -> Frames:
    """So many cycles that pass without a frame."""
    frames = np.zeros(n, FRAME)
    frames["can_id"] = TICK_ID
    return frames


@pytest.mark.parametrize("how", ["ticks", "time alone"])
def test_without_navigation_the_command_is_held_then_safe_then_it_returns(
    flight: Recorded, how: str
) -> None:
    start, gap = 40, TIMEOUT_CYCLES + 8
    computer, before = replay(flight, flight.navigation[:start].ravel())
    silent = flight.navigation[start : start + gap, -1]
    during = computer.feed(ticks(gap) if how == "ticks" else silent)
    sent = commands(during)
    assert len(sent) == gap
    assert {value(f) for f in sent} == {value(commands(before)[-1])}
    assert modes_of(during) == ["ENTRY"] * TIMEOUT_CYCLES + ["SAFE"] * (gap - TIMEOUT_CYCLES)
    after = computer.feed(flight.navigation[start + gap :].ravel())
    found = [(mode, len(list(run))) for mode, run in itertools.groupby(modes_of(after))]
    rest = CYCLES - start - gap
    assert found == [("SAFE", RETURN_CYCLES - 1), ("ENTRY", rest - RETURN_CYCLES + 1)]
    held = commands(after)[: RETURN_CYCLES - 1]
    assert {value(f) for f in held} == {value(commands(before)[-1])}
    alphas = {v["alpha_cmd_rad"] for v in cantools_values(after, "FSW_COMMAND")}
    assert alphas == {cantools_values(before, "FSW_COMMAND")[-1]["alpha_cmd_rad"]}


def test_navigation_lost_and_found_while_coasting_goes_on_coasting() -> None:
    flight = recorded("lqy", "entry", 80)
    computer, _ = replay(flight, flight.navigation[:10].ravel())
    assert set(modes_of(computer.feed(ticks(40)))) == {"COAST", "SAFE"}
    after = modes_of(computer.feed(flight.navigation[50:].ravel()))
    assert after == ["SAFE"] * (RETURN_CYCLES - 1) + ["COAST"] * (30 - RETURN_CYCLES + 1)


def test_every_tick_is_a_cycle_without_a_fix(lqy_flight: Recorded) -> None:
    computer, _ = replay(lqy_flight, lqy_flight.navigation[:30].ravel())
    cycle = int(computer.state["cycle"][0])
    answers = computer.feed(ticks(3))
    assert computer.state["cycle"][0] == cycle + 3
    assert computer.state["cycles_without_fix"][0] == 3
    assert len(commands(answers)) == 3
    assert computer.state["guidance"]["status"][0] == status.NO_FIX


def test_a_request_that_was_heard_is_not_heard_again(lqy_flight: Recorded) -> None:
    computer = Computer(lqy_flight.made)
    computer.feed(request(lqy_flight.made, STOP))  # the counter of the request before
    assert computer.state["stop"][0] == 0
    assert computer.counted["REPEATED"] == 1


@pytest.mark.parametrize("jump", [1, 2, 3, 7, 8, 11, 15, 16, 17, 32, 61])
def test_after_a_jump_in_time_and_counters_the_sender_is_believed_again(jump: int) -> None:
    start = 40
    until = start + jump + AGREEING_CYCLES + 2  # one set may be repeated by chance, one is the fix
    flight = recorded("lqy", PIECE, until)
    computer, _ = replay(flight, flight.navigation[:start].ravel())
    computer.feed(flight.navigation[start + jump :].ravel())
    assert computer.state["fix_valid"][0] == 1
    assert computer.state["nav"]["t_s"][0] == pytest.approx((until - 1) * 0.02, abs=1e-6)
    assert modes.MODES[int(computer.state["mode"][0])] == "ENTRY"


def test_a_harness_that_starts_anew_is_believed_again(lqy_flight: Recorded) -> None:
    flight = lqy_flight
    computer, _ = replay(flight, flight.navigation[:50].ravel())
    computer.feed(flight.navigation[:30].ravel())
    assert computer.state["fix_valid"][0] == 1
    assert computer.state["cycle"][0] == 29


def test_single_refused_times_do_not_add_up_to_a_new_start(lqy_flight: Recorded) -> None:
    flight = lqy_flight
    old = {(i, 6): [flight.navigation[i - 5, 6]] * (AGREEING_CYCLES - 1) for i in range(20, 100)}
    computer, answers = replay(flight, with_inserted(flight, old))
    assert commands(answers).tobytes() == commands(flight.answers).tobytes()
    assert computer.state["candidate"]["agreeing"][0] == 0


def test_a_command_that_is_no_number_holds_the_last_one(lqy_flight: Recorded) -> None:
    flight = lqy_flight
    computer, before = replay(flight, flight.navigation[:90].ravel())
    computer.state["law"]["nominal"]["gamma_integral_rads"] = np.nan
    after = computer.feed(flight.navigation[90:].ravel())
    assert {value(f) for f in commands(after)} == {value(commands(before)[-1])}
    assert computer.state["guidance"]["status"][0] == status.NONFINITE


def test_state_bytes_are_a_checkpoint(flight: Recorded) -> None:
    middle = 60
    computer, _ = replay(flight, flight.navigation[:middle].ravel())
    kept = computer.state.tobytes()
    rest = computer.feed(flight.navigation[middle:].ravel())
    other = Computer(flight.made, armed=False)
    other.state = np.frombuffer(bytearray(kept), other.state.dtype)
    assert other.feed(flight.navigation[middle:].ravel()).tobytes() == rest.tobytes()


def test_the_mode_tells_coast_commands_before_entry() -> None:
    flight = recorded("lqy", "entry", 20)
    assert set(modes_of(flight.answers)) == {"COAST"}
    (command,) = {value(f) for f in commands(flight.answers)}
    sent = cantools_values(flight.answers, "FSW_COMMAND")[0]
    assert sent["bank_cmd_rad"] == 0.0
    assert sent["alpha_cmd_rad"] == pytest.approx(np.radians(45.0), abs=6e-8)
    assert command != 0
    assert flight.truth["drag_mps2"].max() < 0.0005 * 9.81  # where the load's threshold is


def test_a_divider_runs_the_law_once_in_so_many_cycles(lqy_flight: Recorded) -> None:
    load = lqy_flight.made.load.copy()
    load["guidance_divider"], load["guidance_dt_s"] = 3, 0.06
    load.setflags(write=False)
    made = lqy_flight.made._replace(load=load)
    world = World(made, CYCLES)
    world.fly(Computer(made), CYCLES)
    words = [value(f) for f in commands(world.frames)]
    changes = [i for i in range(1, CYCLES) if words[i] != words[i - 1]]
    assert len(changes) > CYCLES // 6
    assert {i % 3 for i in changes} == {0}


def test_terminal_mode_holds_the_last_command(lqy_flight: Recorded) -> None:
    made = lqy_flight.made
    load = made.load.copy()
    load["modes"]["terminal_speed_mps"] = float(lqy_flight.truth["v_rel_mps"][80])
    load.setflags(write=False)
    computer = Computer(made._replace(load=load))
    answers = computer.feed(lqy_flight.navigation.ravel())
    found = modes_of(answers)
    assert found.index("TERMINAL") in (80, 81)  # resolution of the speed on the bus
    assert modes.MODES[int(computer.state["mode"][0])] == "TERMINAL"
    words = {value(f) for f in commands(answers)[found.index("TERMINAL") - 1 :]}
    assert len(words) == 1
    assert computer.state["guidance"]["tracking"][0] == 0
