"""A third sender on the bus: false frames under the identifiers of both sides.

Many have right checksums, so that they move counters and are sometimes believed: which of two
frames came first decides what the computer does.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from flight_sw import icd
from flight_sw.can.address import open_bus
from flight_sw.can.e2e import protect
from flight_sw.errors import BusError
from flight_sw.records.dictionary import FRAME
from tests.system.flights import Frames, built

BURST_S = 0.001
DEADLY = ("NAV_TIME", "FSW_COMMAND", "FSW_STATUS")


def false_frames(n: int, seed: int, is_deadly: bool) -> Frames:
    """Frames of every message of the DBC and some strangers, many with a right checksum.

    A time message, a command or a status that is believed ends a flight in lockstep: they have a
    right checksum where that is wanted, as is any flight against the clock, and else a wrong one.
    """
    rng = np.random.default_rng(seed)
    frames = np.zeros(n, FRAME)
    frames["dlc"], frames["data"] = 8, rng.integers(0, 1 << 64, n, dtype=np.uint64)
    codec = built("lqy").load["codec"][0]
    for frame in frames:
        message = icd.LAYOUT[rng.integers(0, len(icd.LAYOUT))]
        frame["can_id"] = message.can_id
        chance = rng.random()
        if chance < 0.5 or message.name in DEADLY:
            slot, counter = icd.slot(message.name), int(rng.integers(0, 16))
            harm = np.uint64(message.name in DEADLY and not is_deadly)
            frame["data"] = protect(codec, slot, frame["data"], counter) ^ harm
        elif chance < 0.8:
            frame["can_id"] = int(rng.integers(0x600, 0x7FF))
        elif chance < 0.85:
            frame["dlc"] = int(rng.integers(0, 8))
    return frames


class ThirdSender:
    """Bursts of false frames on a bus, from the moment that there is one."""

    def __init__(self, seed: int, is_deadly: bool) -> None:
        self.frames, self.sent = false_frames(4096, seed, is_deadly), 0
        self._rng = np.random.default_rng(seed)

    def talk(self, address: Callable[[], str], over: threading.Event) -> None:
        """Send until told to stop."""
        bus = None
        while bus is None and not over.is_set():
            try:
                bus = open_bus(address())
            except BusError:
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
def third_sender(
    address: Callable[[], str], seed: int, *, is_deadly: bool
) -> Iterator[ThirdSender]:
    """One that talks on a bus, as soon as there is one."""
    over, sender = threading.Event(), ThirdSender(seed, is_deadly)
    thread = threading.Thread(target=sender.talk, args=(address, over))
    thread.start()
    try:
        yield sender
    finally:
        over.set()
        thread.join()
