"""A computer whose navigation fails keeps the time of its cycles, however busy the bus is."""

import socket
import threading
import time

import numpy as np
import pytest

from flight_sw.can.sockets import new_io
from flight_sw.computer import new_state
from flight_sw.executive import EXECUTIVE, RUNNING, SYNCHRONISATIONS, serve
from flight_sw.records.dictionary import FRAME, RX_CAPACITY, TX_CAPACITY
from tests.system.flights import recorded

pytestmark = [pytest.mark.jit_only, pytest.mark.alone]

LAW = "lqy"
PERIOD_NS = 20_000_000
CYCLES = 40  # enough for a clocked computer to leave its arrivals for its deadlines
SILENCE_S = 0.6
FLOOD_INTERVAL_S = 0.0002
FOREIGN_ID = 0x333
HARNESS_NUMBER = 7


def named_state() -> np.ndarray:
    """The state of a computer that a harness has named: another answers nothing."""
    state = new_state(LAW)
    state["harness"] = HARNESS_NUMBER
    return state


class Served:
    """A flight computer's loop in a thread, on one end of a pair of sockets."""

    def __init__(self, synchronisation: str) -> None:
        self.flight = recorded(LAW, "entry", CYCLES)
        self.state = named_state()
        self.account = np.zeros(1, EXECUTIVE)
        self.account["synchronisation"] = SYNCHRONISATIONS.index(synchronisation)
        self.account["period_ns"] = PERIOD_NS
        self.ours, self.theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.theirs.setblocking(False)
        self.rx, self.tx = np.zeros(RX_CAPACITY, FRAME), np.zeros(TX_CAPACITY, FRAME)
        self.io = new_io(RX_CAPACITY)
        self.over = False
        self.serve(named_state(), self.account.copy(), 0)
        self.threads = [threading.Thread(target=part) for part in (self._run, self._drain)]

    def serve(self, state: np.ndarray, account: np.ndarray, slice_ns: int) -> int:
        return int(
            serve(
                self.theirs.fileno(), self.io, self.flight.made.load, state, account,
                self.rx, self.tx, slice_ns,
            )
        )  # fmt: skip

    def _run(self) -> None:
        while not self.over and self.serve(self.state, self.account, 20_000_000) == RUNNING:
            pass

    def _drain(self) -> None:
        self.ours.settimeout(0.05)
        while not self.over:
            try:
                self.ours.recv(FRAME.itemsize)
            except TimeoutError:
                continue

    def __enter__(self) -> "Served":
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.over = True
        for thread in self.threads:
            thread.join()
        self.ours.close()
        self.theirs.close()

    def navigate(self) -> None:
        """All navigation sets, each in its time."""
        start_s = time.monotonic()
        for k, frames in enumerate(self.flight.navigation):
            time.sleep(max(start_s + k * PERIOD_NS / 1e9 - time.monotonic(), 0.0))
            for frame in frames:
                self.ours.send(frame.tobytes())

    def flood(self, seconds: float) -> None:
        """Frames of strangers alone."""
        frame = np.zeros(1, FRAME)
        frame["can_id"], frame["dlc"] = FOREIGN_ID, 8
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self.ours.send(frame.tobytes())
            time.sleep(FLOOD_INTERVAL_S)


@pytest.mark.parametrize("synchronisation", ["frame", "clock"])
@pytest.mark.parametrize("is_busy", [False, True], ids=["quiet", "busy"])
def test_cycles_go_on_at_their_rate_without_navigation(synchronisation: str, is_busy: bool) -> None:
    with Served(synchronisation) as served:
        served.navigate()
        time.sleep(PERIOD_NS / 2e9)
        before, start_s = int(served.account["ticks"][0]), time.monotonic()
        if is_busy:
            served.flood(SILENCE_S)
        else:
            time.sleep(SILENCE_S)
        ticks, took_s = int(served.account["ticks"][0]) - before, time.monotonic() - start_s
    assert ticks == pytest.approx(took_s * 1e9 / PERIOD_NS, abs=2.0)
    assert int(served.account["clocked"][0]) == int(synchronisation == "clock")
    assert int(served.state["cycle"][0]) >= CYCLES - 1 + ticks


def test_a_lockstep_computer_never_ticks() -> None:
    with Served("lockstep") as served:
        served.navigate()
        time.sleep(SILENCE_S / 2)
    assert int(served.account["ticks"][0]) == 0
    assert int(served.account["cycles"][0]) == CYCLES
