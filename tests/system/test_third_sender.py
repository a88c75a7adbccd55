"""A flight whose bus has a third sender replays to the bit: the ear heard what the computer heard.

The third sender uses the identifiers of both sides with right checksums, so that its frames move
counters and are sometimes believed: which of two frames came first decides what the computer does.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flight_sw import icd
from flight_sw.can.address import open_bus
from flight_sw.can.e2e import protect
from flight_sw.dictionary import FRAME
from flight_sw.errors import BusError
from sim_harness.bus.hub import Hub
from sim_harness.telemetry.reader import open_recording
from tests.system.flights import Frames, built, run_of
from tests.system.paced import piece
from tests.system.replays import replay
from tools.commands.fly import fly_and_record

pytestmark = pytest.mark.jit_only

BURST_S = 0.001
DEADLY = ("NAV_TIME", "FSW_COMMAND", "FSW_STATUS")
HARNESS_IDS = {m.can_id for m in icd.LAYOUT if m.sender == "HARNESS"}


def false_frames(n: int, seed: int) -> Frames:
    """Frames of every message of the DBC and some strangers, many with a right checksum.

    A time message, a command or a status that is believed would end a flight in lockstep: where
    they are false, they look it.
    """
    rng = np.random.default_rng(seed)
    frames = np.zeros(n, FRAME)
    frames["dlc"], frames["data"] = 8, rng.integers(0, 1 << 64, n, dtype=np.uint64)
    codec = built("lqy").load["codec"][0]
    for frame in frames:
        message = icd.LAYOUT[rng.integers(0, len(icd.LAYOUT))]
        frame["can_id"] = message.can_id
        chance = rng.random()
        if chance < 0.5 and message.name not in DEADLY:
            slot, counter = icd.slot(message.name), int(rng.integers(0, 16))
            frame["data"] = protect(codec, slot, frame["data"], counter)
        elif chance < 0.8:
            frame["can_id"] = int(rng.integers(0x600, 0x7FF))
        elif chance < 0.85:
            frame["dlc"] = int(rng.integers(0, 8))
    return frames


class ThirdSender:
    """Bursts of false frames on a bus, from the moment that there is one."""

    def __init__(self, seed: int) -> None:
        self.frames, self.sent = false_frames(4096, seed), 0
        self._rng = np.random.default_rng(seed)

    def talk(self, path: Path, over: threading.Event) -> None:
        """Send until told to stop."""
        bus = None
        while bus is None and not over.is_set():
            found = list(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
            try:
                bus = open_bus(f"unix:{found[0]}") if found else None
            except BusError:
                bus = None
            time.sleep(BURST_S)
        while bus is not None and not over.is_set():
            for _ in range(self._rng.integers(1, 5)):
                try:
                    bus.send(self.frames[self.sent % len(self.frames)].tobytes())
                except OSError:
                    over.set()
                    break
                self.sent += 1
            time.sleep(BURST_S * self._rng.random())
        if bus is not None:
            bus.close()


@contextmanager
def third_sender(path: Path, seed: int) -> Iterator[ThirdSender]:
    """One that talks on a hub, whose path may be a pattern."""
    over, sender = threading.Event(), ThirdSender(seed)
    thread = threading.Thread(target=sender.talk, args=(path, over))
    thread.start()
    try:
        yield sender
    finally:
        over.set()
        thread.join()


@pytest.fixture(params=["own hub", "another's hub"])
def bus(request: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A bus address, and where its socket is."""
    if request.param == "own hub":
        monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
        yield "unix", tmp_path / "aeroshell-*/bus"
        return
    with Hub(tmp_path / "hub") as hub:
        yield f"unix:{hub.path}", hub.path


@pytest.mark.parametrize(
    ("pace", "seconds", "seed"), [(0.0, 100.0, 1), (0.0, 100.0, 2), (1.0, 4.0, 3), (5.0, 10.0, 4)]
)
def test_a_flight_among_false_frames_replays_to_the_bit(
    tmp_path: Path, bus: tuple[str, Path], pace: float, seconds: float, seed: int
) -> None:
    address, socket = bus
    with third_sender(socket, seed) as sender:
        run = run_of(piece(seconds), tmp_path / "a.load", address, pace=pace)
        fly_and_record(run, tmp_path)
    recording = open_recording(tmp_path / "flight.mcap")
    found = replay(recording.path)
    assert found.is_identical, found
    assert found.cycles >= seconds / 0.02 * 0.9
    assert found.reports == 0, "the computer heard other frames than the ear"
    assert found.unanswered == 0
    assert len(found.ticks) == run.computer["ticks"]
    assert sender.sent > 300
    strange = ~np.isin(recording.bus["frame"]["can_id"], list(HARNESS_IDS))
    assert strange.sum() > 200
    refused = sum(n for name, n in run.computer["verdicts"].items() if name not in ("OK", "LOST"))
    assert refused > 300, "the computer heard too little of it"
