"""The bus listener logs every frame of the bus in its order, and counts what it could not."""

import socket
import time
from pathlib import Path

import numpy as np
import pytest

from flight_sw.records.dictionary import FRAME
from sim_harness.bus import hub_log as tapping
from sim_harness.bus.bus_listener import BusListener, hub_listener, no_listener, socket_listener
from sim_harness.bus.hub import Hub
from sim_harness.bus.hub_log import HUB_LOG, RING_FRAMES
from sim_harness.flight.flight import FlightRun
from sim_harness.jit import kernel
from sim_harness.telemetry.logs import BUS
from tests.sim_harness.test_hub import Client, numbered
from tests.system.flights import Frames, built, run_of

BATCHES = 4096  # of 64 frames: more than the ring holds


@kernel
def keep_batches(taps: Frames, ring: Frames, frames: Frames, batches: int) -> None:
    """What a hub's thread does, so many times; each frame carries its number."""
    n = 0
    for _ in range(batches):
        for i in range(len(frames)):
            frames[i]["data"] = np.uint64(n)
            n += 1
        tapping.keep(taps[0], ring, frames, len(frames))


@pytest.fixture
def run(tmp_path: Path) -> FlightRun:
    """A flight whose log the bus listener fills."""
    run = run_of(built("lqy"), tmp_path / "x.load", "unix")
    run.harness["has_bus_listener"] = 1
    return run


def heard(run: FlightRun, bus_listener: BusListener) -> list[int]:
    """The numbers that the log has got since the last call, heard until nothing is left."""
    numbers: list[int] = []
    while run_hear(run, bus_listener):
        rows = run.logs.bus[int(run.harness["taken"][0, BUS]) : int(run.harness["written"][0, BUS])]
        numbers += rows["frame"]["data"].tolist()
        run.harness["taken"][0, BUS] = run.harness["written"][0, BUS] = 0
    return numbers


def run_hear(run: FlightRun, bus_listener: BusListener) -> int:
    """One call of what the flight loop calls."""
    from sim_harness.flight.loop import hear_outside

    return int(hear_outside(run.harness, run.logs, bus_listener, 2))


def test_an_ear_on_a_hub_of_our_own_hears_all_in_order(run: FlightRun) -> None:
    hub_log, ring = np.zeros(1, HUB_LOG), np.zeros(RING_FRAMES, FRAME)
    keep_batches(hub_log, ring, np.zeros(64, FRAME), 100)
    assert heard(run, hub_listener(hub_log, ring)) == list(range(6400))
    assert run.harness["bus_rows_lost"][0] == 0


def test_what_the_ring_could_not_keep_is_counted(run: FlightRun) -> None:
    hub_log, ring = np.zeros(1, HUB_LOG), np.zeros(RING_FRAMES, FRAME)
    kept = 64 * (BATCHES + 5)
    assert kept > RING_FRAMES
    keep_batches(hub_log, ring, np.zeros(64, FRAME), BATCHES + 5)
    numbers = heard(run, hub_listener(hub_log, ring))
    assert numbers == list(range(kept - RING_FRAMES, kept))
    assert run.harness["bus_rows_lost"][0] == kept - RING_FRAMES


def test_a_frame_overwritten_while_it_was_copied_is_counted(run: FlightRun) -> None:
    hub_log, ring = np.zeros(1, HUB_LOG), np.zeros(RING_FRAMES, FRAME)
    keep_batches(hub_log, ring, np.zeros(64, FRAME), 1)
    hub_log["claimed"] = RING_FRAMES + 3  # a hub that is writing over the first three
    assert run_hear(run, hub_listener(hub_log, ring)) == 64
    assert run.harness["bus_rows_lost"][0] == 3


def test_an_ear_on_anothers_hub_hears_those_who_do_not_hear_themselves(
    tmp_path: Path, run: FlightRun
) -> None:
    with Hub(tmp_path / "bus") as hub:
        listener_socket = Client(hub.path)
        listener_socket.socket.setblocking(False)
        a, b = Client(hub.path), Client(hub.path)
        while hub.stats.clients < 3:  # let in, not only connected
            time.sleep(0.001)
        assert a.send(numbered(3)) == 3
        assert len(b.receive(3)) == 3
        assert b.send(numbered(2)) == 2
        assert len(a.receive(2)) == 2
        assert heard(run, socket_listener(listener_socket.socket.fileno())) == [
            *numbered(3)["data"].tolist(), *numbered(2)["data"].tolist(),
        ]  # fmt: skip


def test_no_ear_hears_nothing_and_a_dead_socket_ends_nothing(run: FlightRun) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setblocking(False)
    theirs.close()
    assert run_hear(run, socket_listener(ours.fileno())) == 0
    ours.close()
    run.harness["has_bus_listener"] = 0
    assert run_hear(run, no_listener()) == 0
