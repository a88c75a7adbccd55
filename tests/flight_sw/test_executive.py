"""The cyclic loop on a socket: the minor frame's answers, its accounts, and how it ends."""

import socket
from collections.abc import Iterator

import numpy as np
import pytest

from flight_sw.can.sockets import new_io
from flight_sw.executive import BUS_LOST, EXECUTIVE, RUNNING, STOPPED, serve
from flight_sw.reception.requests import STOP
from flight_sw.records.dictionary import FRAME, RX_CAPACITY, TICK_ID, TX_CAPACITY
from tests.flight_sw.test_reception import altered
from tests.system.flights import Computer, Frames, commands, recorded, request

SLICE_NS = 2_000_000
CYCLES = 40
CYCLES_A_SLICE = 10  # what a socket's buffer holds without waiting
SLICES_MAX = 1000  # that serve what lies in a buffer, however slow the machine


class Loop:
    """A computer that serves one end of a socket pair."""

    def __init__(self, law: str = "lqy") -> None:
        self.flight = recorded(law, "tracking", CYCLES)
        self.computer = Computer(self.flight.made)
        self.near, self.far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        for end in (self.near, self.far):
            end.setblocking(False)
        self.executive = np.zeros(1, EXECUTIVE)
        self.io = new_io(RX_CAPACITY)
        self.rx, self.tx = np.zeros(RX_CAPACITY, FRAME), np.zeros(TX_CAPACITY, FRAME)

    def serve(self, slice_ns: int = SLICE_NS) -> int:
        """One slice of the loop."""
        return int(
            serve(self.near.fileno(), self.io, self.flight.made.load, self.computer.state,
                  self.executive, self.rx, self.tx, slice_ns)
        )  # fmt: skip

    def send(self, frames: Frames) -> None:
        """Frames to the computer, one a packet."""
        for frame in frames.ravel():
            self.far.send(frame.tobytes())

    def serve_sent(self, count: int) -> None:
        """Slices until so many frames have been received since boot: one may end early."""
        for _ in range(SLICES_MAX):
            if self.executive["frames_received"][0] >= count:
                break
            assert self.serve() == RUNNING
        assert self.executive["frames_received"][0] == count

    def answers(self) -> Frames:
        """What came back."""
        parts = []
        while True:
            try:
                parts.append(self.far.recv(1024))
            except BlockingIOError:
                return np.frombuffer(b"".join(parts), FRAME)

    def fly(self) -> Frames:
        """All cycles of the piece, a few a slice; the answers."""
        parts = []
        sent = 0
        for start in range(0, CYCLES, CYCLES_A_SLICE):
            cycles = self.flight.navigation[start : start + CYCLES_A_SLICE]
            self.send(cycles)
            sent += cycles.size
            self.serve_sent(sent)
            parts.append(self.answers())
        return np.concatenate(parts)


@pytest.fixture
def loop() -> Iterator[Loop]:
    """A loop whose sockets are closed afterwards."""
    made = Loop()
    yield made
    made.near.close()
    made.far.close()


def test_the_loop_answers_as_the_minor_frame_does(loop: Loop) -> None:
    assert loop.fly().tobytes() == loop.flight.answers.tobytes()
    executive = loop.executive[0]
    assert executive["frames_received"] == loop.flight.navigation.size
    assert executive["frames_sent"] == len(loop.flight.answers)
    assert executive["cycles"] == CYCLES
    assert 0 < executive["step_time"]["n"] <= CYCLES  # one for each batch that closed cycles


def test_a_tick_from_the_bus_is_dropped_and_counted(loop: Loop) -> None:
    false = np.zeros(3, FRAME)
    false["can_id"] = TICK_ID
    sent = 0
    for start in range(0, CYCLES, CYCLES_A_SLICE):
        for cycle in loop.flight.navigation[start : start + CYCLES_A_SLICE]:
            loop.send(np.concatenate([cycle[:2], false, cycle[2:]]))
            sent += len(cycle) + len(false)
        loop.serve_sent(sent)
    assert loop.answers().tobytes() == loop.flight.answers.tobytes()
    assert loop.executive["false_ticks"][0] == 3 * CYCLES


def test_packets_that_are_no_frames_are_dropped_and_counted(loop: Loop) -> None:
    for size in (1, 15, 17, 64):
        loop.far.send(b"x" * size)
    assert loop.fly().tobytes() == loop.flight.answers.tobytes()
    assert loop.io["wrong_size"][0] == 4


def test_a_stop_request_ends_the_loop_at_once(loop: Loop) -> None:
    loop.send(request(loop.flight.made, STOP, counter=1))
    assert loop.serve(slice_ns=10_000_000_000) == STOPPED


def test_a_bus_that_closes_ends_the_loop_at_once(loop: Loop) -> None:
    loop.far.close()
    assert loop.serve(slice_ns=10_000_000_000) == BUS_LOST


def test_a_slice_without_frames_ends_in_time_and_changes_nothing(loop: Loop) -> None:
    before = loop.computer.state.tobytes()
    assert loop.serve() == RUNNING
    assert loop.computer.state.tobytes() == before
    assert loop.executive["cycles"][0] == 0


def test_a_slice_of_zero_only_compiles(loop: Loop) -> None:
    loop.send(loop.flight.navigation[0])
    assert loop.serve(slice_ns=0) == RUNNING
    assert loop.executive["frames_received"][0] == 0


def test_in_lockstep_a_set_whose_time_was_refused_is_answered_once_the_bus_is_silent(
    loop: Loop,
) -> None:
    before = loop.flight.navigation[:CYCLES_A_SLICE]
    late = loop.flight.navigation[CYCLES_A_SLICE].copy()
    late[-1] = altered(loop.flight, late[-1], t_s=1.0)
    loop.send(before)
    loop.serve_sent(before.size)
    loop.answers()
    loop.send(late[-1:])  # alone it is no set, and is not waited for
    loop.serve_sent(before.size + 1)
    for _ in range(3):
        assert loop.serve() == RUNNING
    assert len(loop.answers()) == 0
    loop.send(late)
    loop.serve_sent(before.size + 1 + late.size)
    assert len(loop.answers()) == 0
    for _ in range(3):
        assert loop.serve() == RUNNING
    assert len(commands(loop.answers())) == 1
    assert loop.computer.state["cycles_without_fix"][0] == 1
