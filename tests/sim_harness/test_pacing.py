"""The pace is that of the clock: no drift, nothing early, what is late is counted."""

import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from flight_sw import icd
from flight_sw.can.sockets import new_io
from flight_sw.records.dictionary import FRAME, RX_CAPACITY
from sim_harness.bus.bus_listener import no_listener
from sim_harness.flight.loop import COMPUTER_SILENT, Wire
from sim_harness.flight.pacing import fly_in_real_time
from sim_harness.world.records import FLYING
from tests.system.flights import built, run_of

pytestmark = [pytest.mark.jit_only, pytest.mark.alone]

PERIOD_S = 0.02
STALL_S = 0.05
TIME_ID = icd.layout("NAV_TIME").can_id


class Paced:
    """A harness that flies against the clock, and nobody who answers."""

    def __init__(self, folder: Path, patience_s: float) -> None:
        self.run = run_of(built("lqy"), folder / "x.load", "unix", pace=1.0, recorded=False)
        self.run.pacer["silence_max_ns"] = round(patience_s * 1e9)
        self.ours, self.theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.ours.setblocking(False)
        self.wire = Wire(self.ours.fileno(), new_io(RX_CAPACITY), self.run.rx, self.run.tx,
                         no_listener())  # fmt: skip
        self.arrivals_ns: list[int] = []
        self.fly(0)
        self.listener = threading.Thread(target=self._listen)
        self.listener.start()

    def _listen(self) -> None:
        while raw := self.theirs.recv(FRAME.itemsize):
            if int(np.frombuffer(raw, FRAME)["can_id"][0]) == TIME_ID:
                self.arrivals_ns.append(time.monotonic_ns())

    def fly(self, cycles: int) -> int:
        run = self.run
        return int(fly_in_real_time(run.harness, run.pacer, self.wire, run.logs, cycles))

    def close(self) -> np.ndarray:
        """Seconds from the first frame's beginning to the end of each navigation set."""
        self.ours.close()
        self.listener.join()
        self.theirs.close()
        return (np.array(self.arrivals_ns) - int(self.run.pacer["start_ns"][0])) / 1e9


def test_frames_begin_on_the_clock_and_a_stall_is_made_up_for(tmp_path: Path) -> None:
    paced = Paced(tmp_path, patience_s=10.0)
    assert paced.fly(10) == FLYING
    time.sleep(STALL_S)
    assert paced.fly(40) == FLYING
    begun_s = paced.close()
    due_s = np.arange(50) * PERIOD_S
    pacer = paced.run.pacer[0]
    assert len(begun_s) == 50
    assert (begun_s >= due_s).all(), "a frame began early"
    assert begun_s[10] - due_s[10] >= STALL_S
    # The stall is made up for unless the machine stalls again: see test_simulated_clock.py.
    assert (begun_s - due_s)[20:].min() < STALL_S
    assert int(pacer["slips"]) >= 2  # 50 ms late, then 30: more than a period
    assert float(pacer["late_max_ns"]) / 1e9 >= STALL_S


def test_without_an_answer_the_actuators_stay_and_every_command_is_late(tmp_path: Path) -> None:
    paced = Paced(tmp_path, patience_s=10.0)
    port = paced.run.harness["port"][0]
    before = float(port["bank_cmd_rad"]), float(port["alpha_cmd_rad"])
    assert paced.fly(20) == FLYING
    paced.close()
    assert (float(port["bank_cmd_rad"]), float(port["alpha_cmd_rad"])) == before
    assert int(paced.run.pacer["late_commands"][0]) == 20
    assert float(paced.run.harness["truth"]["t_s"][0]) == pytest.approx(20 * PERIOD_S)
    trip = paced.run.pacer["round_trip"][0]
    assert int(trip["n"]) == 20
    assert int(trip["sum_ns"]) >= 20 * PERIOD_S * 1e9, "a late command flatters the round trip"


def test_silence_ends_a_flight_when_patience_does(tmp_path: Path) -> None:
    paced = Paced(tmp_path, patience_s=0.2)
    start_s = time.monotonic()
    assert paced.fly(1000) == COMPUTER_SILENT
    took_s = time.monotonic() - start_s
    paced.close()
    assert took_s >= 0.2
    assert int(paced.run.pacer["frames"][0]) <= 0.2 / PERIOD_S + 1
