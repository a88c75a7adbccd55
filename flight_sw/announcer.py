"""Says on the bus that this computer is here, and hears who else says so, before it serves."""

import contextlib
import socket
import threading
import time
from dataclasses import dataclass, field

from flight_sw.can.plain import plain_frame, read_plain
from flight_sw.guidance import NUMBERS
from flight_sw.icd import layout
from flight_sw.load_image import LoadImage
from flight_sw.records.dictionary import FRAME
from flight_sw.runtime.identity import SOURCES

ANNOUNCE_S = layout("FSW_BOOT").cycle_ms / 1e3
COMPILING, READY, ARMED = 0, 1, 2
FRESH_S = 5.0 * ANNOUNCE_S  # after so long without a word another computer has gone
SURE = 2  # words of one number: a random frame may be said again, but does not count on


def boot_frames(number: int, image: LoadImage, state: int, counter: int) -> tuple[bytes, bytes]:
    """FSW_BOOT and FSW_LOAD as they lie on the wire."""
    law = NUMBERS[image.law]
    boot = {"computer": number, "state": state, "law": law, "sources": SOURCES}
    load = {"computer": number, "load_crc32": image.crc32}
    return plain_frame("FSW_BOOT", boot, counter), plain_frame("FSW_LOAD", load, counter)


@dataclass
class Other:
    """Another flight computer on the bus, as it was last heard."""

    state: int
    heard_s: float
    counter: int
    words: int = 1


@dataclass
class Announcer:
    """Sends FSW_BOOT and FSW_LOAD in its own thread until told to stop, and hears the others'."""

    bus: socket.socket
    image: LoadImage
    number: int
    state: int = COMPILING
    counter: int = 0
    others: dict[int, Other] = field(default_factory=dict)
    _over: threading.Event = field(default_factory=threading.Event)

    def announce(self) -> bool:
        """Say it once; a bus that takes nothing is noticed by the loop that follows."""
        frames = boot_frames(self.number, self.image, self.state, self.counter)
        self.counter += 1
        try:
            for frame in frames:
                self.bus.send(frame, socket.MSG_DONTWAIT)
        except OSError:
            return False
        return True

    def hear(self, packet: bytes) -> None:
        """Take one packet from the bus."""
        read = read_plain(packet)
        if read is None or read.message.name != "FSW_BOOT":
            return
        number, now_s = read.raw["computer"], time.monotonic()
        before = self.others.get(number)
        words = 1
        if before and now_s - before.heard_s < FRESH_S:
            words = before.words + (read.counter != before.counter)
        self.others[number] = Other(read.raw["state"], now_s, read.counter, words)

    def who_serves(self) -> int:
        """The number of another computer that is ready on this bus; 0 if there is none."""
        now_s = time.monotonic()
        for number, other in self.others.items():
            is_here = other.words >= SURE and now_s - other.heard_s < FRESH_S
            if is_here and other.state != COMPILING:
                return number
        return 0

    def _hear_all(self) -> None:
        with contextlib.suppress(OSError):
            while packet := self.bus.recv(FRAME.itemsize, socket.MSG_DONTWAIT):
                self.hear(packet)

    def __enter__(self) -> "Announcer":
        self._thread = threading.Thread(target=self._repeat, daemon=True)
        self._thread.start()
        return self

    def _repeat(self) -> None:
        while not self._over.is_set():
            self.announce()
            self._hear_all()
            self._over.wait(ANNOUNCE_S)

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
