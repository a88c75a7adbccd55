"""Who else is on the bus: other harnesses, other flight computers, computers of other sources.

A harness claims its bus as J1939 claims an address: it listens, says its number, listens again, and
of two that begin at one moment the smaller number stays. It flies with one computer, which it names
in every request. Whoever else is heard before arming is named in one refusal; who appears in flight
is warned of.
"""

import contextlib
import select
import socket
import threading
import time
from dataclasses import dataclass, field

from flight_sw.announcer import ARMED, READY
from flight_sw.can.plain import Read, plain_frame, read_plain
from flight_sw.errors import FlightError
from flight_sw.icd import value_index
from flight_sw.reception.receiver import FOREIGN
from flight_sw.records.dictionary import FRAME, RX_CAPACITY
from flight_sw.records.types_ import Record
from flight_sw.runtime.identity import NOBODY, SOURCES, name_of
from sim_harness.flight.port import FLYING_HERE, WAITING
from sim_harness.flight.slip_watch import SILENCE_MAX_S, SILENCE_MIN_S

LISTEN_S = 0.25  # before the first word, and again before a computer is started or armed
SAY_S = 0.05
DRAIN_PAUSE_S = 0.005
FRESH_S = 0.5  # who has said nothing for so long has gone
SURE = 2  # words of one number: a random frame may be said again, but does not count on
NAVIGATION_SURE = 3  # time messages of a flight that is not ours
FOREIGN_TOLD = value_index("RX_HEALTH_C", "foreign")


@dataclass
class Sighting:
    """One process that said that it is here: when last, how often, and what."""

    heard_s: float = 0.0
    words: int = 0
    counter: int = 0
    raw: dict[str, int] = field(default_factory=dict)

    def hear(self, read: Read, now_s: float) -> None:
        """Take one message of a word; the first after a silence counts from the beginning."""
        if now_s - self.heard_s >= FRESH_S:
            self.words = 1
        elif read.counter != self.counter:
            self.words += 1
        self.heard_s, self.counter = now_s, read.counter
        self.raw.update(read.raw)

    def is_here(self, now_s: float) -> bool:
        """Whether it was heard often enough, and lately."""
        return self.words >= SURE and now_s - self.heard_s < FRESH_S


class Company:
    """What was heard on a bus of those who share it."""

    def __init__(self, bus: str, number: int, crc32: int) -> None:
        self.bus, self.number, self.crc32 = bus, number, crc32
        self.forget()

    def forget(self) -> None:
        """Begin anew: what lay in the queue may be of those who have gone."""
        self.computers: dict[int, Sighting] = {}
        self.harnesses: dict[int, Sighting] = {}
        self.sets = 0

    def hear(self, packet: bytes) -> None:
        """Take one packet."""
        read = read_plain(packet)
        now_s = time.monotonic()
        if read is None:
            return
        if read.message.name in ("FSW_BOOT", "FSW_LOAD"):
            sighting = self.computers.setdefault(read.raw["computer"], Sighting())
            sighting.hear(read, now_s)
        elif read.message.name == "HARNESS_PRESENT":
            self.harnesses.setdefault(read.raw["harness"], Sighting()).hear(read, now_s)
        elif read.message.name == "NAV_TIME":
            self.sets += 1

    def _here(self, sightings: dict[int, Sighting]) -> dict[int, Sighting]:
        now_s = time.monotonic()
        return {number: one for number, one in sightings.items() if one.is_here(now_s)}

    def check_harnesses(self, *, claimed: bool) -> None:
        """Refuse a bus with another harness, unless both claim it now and ours is the smaller."""
        for number, one in self._here(self.harnesses).items():
            flies = one.raw["state"] == FLYING_HERE
            if claimed and not flies and self.number < number:
                continue
            does = "flies" if flies else "waits"
            whom = one.raw["computer"]
            with_whom = f" with flight computer {name_of(whom)}" if whom else ""
            raise FlightError(f"{self.bus}: harness {name_of(number)} {does} there{with_whom}")
        if self.sets >= NAVIGATION_SURE:
            raise FlightError(f"{self.bus}: another harness flies there")

    def check_computers(self, most: int) -> None:
        """Refuse a bus with more computers than that, or with one in another harness's hands."""
        here = self._here(self.computers)
        for number, one in here.items():
            if one.raw.get("state") == ARMED:
                raise FlightError(
                    f"{self.bus}: flight computer {name_of(number)} is armed there by a harness "
                    "that is silent"
                )
        names = " and ".join(name_of(number) for number in sorted(here))
        if len(here) > most:
            if len(here) > 1:
                raise FlightError(f"{self.bus}: flight computers {names} are there, allowed is one")
            raise FlightError(f"{self.bus}: flight computer {names} is there already")

    def ready(self) -> int:
        """The number of the computer that is ready with our load; 0 while there is none."""
        for number, one in self._here(self.computers).items():
            if one.raw.get("state") == READY and one.raw.get("load_crc32") == self.crc32:
                return number
        return NOBODY

    def has_ours(self) -> bool:
        """Whether a computer with our load is heard, ready or not."""
        here = self._here(self.computers).values()
        return any(one.raw.get("load_crc32") == self.crc32 for one in here)

    def other_loads(self) -> str:
        """Which computers have another load, as the end of a sentence."""
        others = [
            f"; flight computer {name_of(number)} has load 0x{one.raw['load_crc32']:08x}"
            for number, one in self._here(self.computers).items()
            if one.raw.get("load_crc32", self.crc32) != self.crc32
        ]
        return "".join(others)

    def other_sources(self, computer: int) -> str:
        """A sentence if that computer was built from other sources than ours."""
        theirs = self.computers[computer].raw["sources"]
        if theirs == SOURCES:
            return ""
        return (
            f"{self.bus}: flight computer {name_of(computer)} was built from other sources, "
            f"{name_of(theirs)}, ours are {name_of(SOURCES)}"
        )


class Presence:
    """Says in a thread of its own that a harness is here, until told to stop."""

    def __init__(self, bus: socket.socket, number: int) -> None:
        self.number, self.computer, self.counter = number, NOBODY, 0
        self._bus = bus
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._repeat, name="presence", daemon=True)

    def say(self) -> None:
        """Say it once."""
        values = {"harness": self.number, "computer": self.computer, "state": WAITING}
        frame = plain_frame("HARNESS_PRESENT", values, self.counter)
        self.counter += 1
        with contextlib.suppress(OSError):  # noticed by whoever listens next
            self._bus.send(frame, socket.MSG_DONTWAIT)

    def _repeat(self) -> None:
        while not self._over.wait(SAY_S):
            self.say()

    def start(self) -> None:
        """Say it from here on."""
        self.say()
        self._thread.start()

    def stop(self) -> None:
        """Say no more; twice does no harm."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()


def listen(bus: socket.socket, company: Company, seconds: float) -> None:
    """Hear what comes for so long; a bus that ends is noticed by whoever uses it next."""
    end_s = time.monotonic() + seconds
    while (left_s := end_s - time.monotonic()) > 0.0:
        readable, _, _ = select.select([bus], [], [], left_s)
        if not readable:
            return
        try:
            packet = bus.recv(FRAME.itemsize, socket.MSG_DONTWAIT)
        except BlockingIOError:
            continue
        except OSError:
            return
        if not packet:
            return
        company.hear(packet)


def drain(bus: socket.socket) -> None:
    """Drop what lies in the queue and what a hub has kept behind it.

    Of a bus that never rests the last is dropped that came in a moment.
    """
    end_s, taken = time.monotonic() + LISTEN_S, 0
    with contextlib.suppress(OSError):
        while time.monotonic() < end_s:
            try:
                if not bus.recv(FRAME.itemsize, socket.MSG_DONTWAIT):
                    return
            except BlockingIOError:
                if taken < RX_CAPACITY:
                    return
                taken = 0
                time.sleep(DRAIN_PAUSE_S)  # a hub has more for us
                continue
            taken += 1


class RoleWatch:
    """Warns in flight of whoever else speaks under the names of this flight."""

    def __init__(self) -> None:
        self._told = (0, 0)
        self._computer_told = NOBODY
        self._silence_s, self._next_s = SILENCE_MIN_S, 0.0

    def look(self, now_s: float, bus: str, port: Record) -> str:
        """A sentence if there is something new and it is time to say so, otherwise empty."""
        computer = int(port["other_computer"])
        if computer not in (NOBODY, self._computer_told):
            self._computer_told = computer
            return (
                f"flight computer {name_of(computer)} announces itself on {bus} "
                f"beside {name_of(int(port['computer']))}"
            )
        heard = foreign_frames(port)
        new = tuple(max(a - b, 0) for a, b in zip(heard, self._told, strict=True))
        if now_s < self._next_s or not any(new):
            return ""
        self._told = heard
        self._next_s = now_s + self._silence_s
        self._silence_s = min(2.0 * self._silence_s, SILENCE_MAX_S)
        other = int(port["other_harness"])
        named = f", of harness {name_of(other)}" if other else ""
        return (
            f"another sender on {bus}: {new[0]} frames under the harness's identifiers{named}, "
            f"{new[1]} under the flight computer's"
        )


def foreign_frames(port: Record) -> tuple[int, int]:
    """Frames of others under the harness's identifiers, and as told under the computer's."""
    return int(port["rx"]["counted"][FOREIGN]), int(port["received"][FOREIGN_TOLD])
