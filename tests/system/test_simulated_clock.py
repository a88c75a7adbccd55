"""The accounts of time by a clock that the test keeps: a machine that keeps time shows no slip."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flight_sw import executive
from flight_sw.can.sockets import new_io
from flight_sw.computer import new_state
from flight_sw.executive import EXECUTIVE, RUNNING, SYNCHRONISATIONS
from flight_sw.reception.requests import ARM
from flight_sw.records.dictionary import FRAME, RX_CAPACITY, TX_CAPACITY
from sim_harness.bus.bus_listener import no_listener
from sim_harness.flight import pacing
from sim_harness.flight.loop import Wire
from sim_harness.world.records import FLYING
from tests.system.flights import (
    NAV_FRAMES,
    Computer,
    Frames,
    World,
    built,
    recorded,
    request,
    run_of,
)
from tests.system.paced import check_account, longer_than
from tests.system.simulated_clock import WAKE_NS, Clock, interpret

pytestmark = pytest.mark.jit_only

LAW, PIECE = "lqy", "tracking"
PERIOD_NS = 20_000_000
CYCLES = 80  # more than a clocked computer needs to leave arrivals for deadlines
ANSWER_NS = 300_000  # of the flight computer
STALLED_CYCLE = 60
STALLS = [0.0, 0.9, 2.5, 5.25]  # periods


def slips_of(stall: float) -> int:
    """Frames that begin more than a period late, when one takes so many periods."""
    return max(math.floor(stall - 1.0), 0)


class Pacer:
    """A harness in real time, answered by a flight computer within a simulated machine."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch, stall: float) -> None:
        self.clock, self.computer = Clock(), Computer(built(LAW, PIECE))
        self.stall_ns = round(stall * PERIOD_NS)
        self.sets, self.answer, self.ready_ns = 0, np.zeros(0, FRAME), 0
        self.run = run_of(built(LAW, PIECE), folder / "x.load", "unix", pace=1.0, recorded=False)
        calls: dict[str, Any] = {"send_frames": self.send, "recv_frames": self.receive}
        interpret(patch, pacing, self.clock, sched_yield=self.step_aside, **calls)
        wire = Wire(-1, new_io(RX_CAPACITY), self.run.rx, self.run.tx, no_listener())
        self.outcome = pacing.fly_in_real_time(
            self.run.harness, self.run.pacer, wire, self.run.logs, CYCLES
        )

    def step_aside(self) -> int:
        """The flight computer runs on the processor of a harness that is late."""
        self.clock.now_ns += ANSWER_NS
        return 0

    def send(self, _fd: int, _io: Any, frames: Frames, n: int) -> int:
        self.answer = self.computer.call(frames[:n].copy())
        self.ready_ns = self.clock.now_ns + ANSWER_NS
        self.sets += n == NAV_FRAMES
        if self.sets == STALLED_CYCLE:
            self.clock.now_ns += self.stall_ns
            self.stall_ns = 0
        return n

    def receive(self, _fd: int, _io: Any, rx: Frames, _most: int, wait_ms: int) -> int:
        if not self.clock.wait(self.ready_ns if len(self.answer) else None, wait_ms):
            return 0
        n = len(self.answer)
        rx[:n] = self.answer
        self.answer = self.answer[:0]
        return n


@pytest.mark.parametrize("stall", STALLS)
def test_a_harness_slips_as_often_as_its_machine_stalled_and_no_more(
    stall: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown = Pacer(tmp_path, monkeypatch, stall)
    pacer = flown.run.pacer[0]
    assert (flown.outcome, int(pacer["frames"])) == (FLYING, CYCLES)
    assert int(pacer["slips"]) == slips_of(stall)
    assert int(pacer["late_commands"]) == 0
    check_account(flown.run)
    on_time = CYCLES - max(math.ceil(stall) - 1, 0)
    assert longer_than(pacer["wake_up"], 2 * WAKE_NS) == (CYCLES - on_time,) * 2
    assert int(pacer["late_max_ns"]) == pytest.approx(max(stall - 1.0, 0.0) * PERIOD_NS, abs=5e5)
    memory = World(built(LAW, PIECE), CYCLES)
    memory.fly(Computer(built(LAW, PIECE)), CYCLES)
    assert flown.run.harness["truth"].tobytes() == memory.harness["truth"].tobytes()


@pytest.mark.parametrize(
    ("count", "wrong"), [("slips", CYCLES), ("slips", 1), ("late_commands", 1), ("frames", 1)]
)
def test_an_account_that_its_histograms_do_not_show_is_refused(
    count: str, wrong: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown = Pacer(tmp_path, monkeypatch, 0.9)
    check_account(flown.run)
    flown.run.pacer[count] += wrong
    with pytest.raises(AssertionError):
        check_account(flown.run)


class Served:
    """A flight computer's loop that hears navigation punctually within a simulated machine."""

    def __init__(self, synchronisation: str, patch: pytest.MonkeyPatch, stall: float) -> None:
        self.clock, self.stall_ns = Clock(), round(stall * PERIOD_NS)
        flight = recorded(LAW, PIECE, CYCLES)
        start_ns = self.clock.now_ns + PERIOD_NS
        self.sets = [(start_ns + k * PERIOD_NS, s) for k, s in enumerate(flight.navigation)]
        self.end_ns = self.sets[-1][0] + PERIOD_NS // 4
        self.answered = 0
        self.account, state = np.zeros(1, EXECUTIVE), new_state(LAW)
        self.account["synchronisation"] = SYNCHRONISATIONS.index(synchronisation)
        self.account["period_ns"] = PERIOD_NS
        rx, tx = np.zeros(RX_CAPACITY, FRAME), np.zeros(TX_CAPACITY, FRAME)
        calls: dict[str, Any] = {"send_frames": self.send, "recv_frames": self.receive}
        interpret(patch, executive, self.clock, recv_rest=lambda *_: 0, **calls)
        self.sets.insert(0, (self.clock.now_ns, request(flight.made, ARM)))
        while self.sets:
            slice_ns = PERIOD_NS // 2
            made = (flight.made.load, state, self.account, rx, tx)
            assert executive.serve(-1, new_io(RX_CAPACITY), *made, slice_ns) == RUNNING

    def send(self, _fd: int, _io: Any, _tx: Frames, n: int) -> int:
        self.answered += 1
        if self.answered == STALLED_CYCLE:
            self.clock.now_ns += self.stall_ns
        return n

    def receive(self, _fd: int, _io: Any, rx: Frames, most: int, wait_ms: int) -> int:
        n = 0
        while self.sets and n + NAV_FRAMES <= most:
            if not self.clock.wait(self.sets[0][0], 0 if n else wait_ms):
                break
            frames = self.sets.pop(0)[1]
            rx[n : n + len(frames)] = frames
            n += len(frames)
        return n


@pytest.mark.parametrize("stall", STALLS)
@pytest.mark.parametrize("synchronisation", ["frame", "clock"])
def test_a_computer_slips_as_often_as_its_machine_stalled_and_no_more(
    synchronisation: str, stall: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    served = Served(synchronisation, monkeypatch, stall)
    account = served.account[0]
    assert int(account["clocked"]) == int(synchronisation == "clock")
    assert int(account["slips"]) == slips_of(stall)
    assert int(account["false_ticks"]) == 0
    if stall < 1.0:
        assert int(account["ticks"]) == 0
        assert int(account["cycles"]) == CYCLES
