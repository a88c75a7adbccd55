"""Boot: read and check the load, open the bus, announce, compile, serve, report.

From opening the bus until the first cycle the computer announces itself with FSW_BOOT, so that the
ground can tell a computer that compiles from one that is not there; and again while its harness is
silent, so that whoever comes then hears that the bus is taken.
"""

import gc
import json
import signal
import time
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import numpy.typing as npt

from flight_sw import icd
from flight_sw.announcer import ARMED, READY, Announcer
from flight_sw.can.address import frames_dropped, identifiers_from, open_bus
from flight_sw.can.error_frames import account_of
from flight_sw.can.sockets import new_io
from flight_sw.computer import new_state
from flight_sw.errors import FlightError
from flight_sw.executive import (
    BUS_LOST,
    EXECUTIVE,
    LOCKSTEP,
    RUNNING,
    SYNCHRONISATIONS,
    serve,
)
from flight_sw.load_image import activate, read_image
from flight_sw.reception.receiver import LOST, OK, VERDICTS
from flight_sw.records.dictionary import FRAME, RX_CAPACITY, TX_CAPACITY
from flight_sw.runtime.histogram import filled_bins_us, percentiles_us
from flight_sw.runtime.identity import SOURCES, draw_number, name_of
from flight_sw.runtime.kernel_cache import on_compiling
from flight_sw.runtime.privileges import lock_memory, punctual_processor, take_priority
from flight_sw.runtime.scheduling import run_in_bursts
from flight_sw.runtime.streams import say, tell
from flight_sw.timing import Timing

SLICE_NS = 100_000_000  # between two looks at signals
DISCARD_MAX_S, DISCARD_PAUSE_S = 1.0, 0.002
NOT_PERMITTED = "flight computer: not as punctual as it could be:"
COMPILES = "flight computer: compiling law"
HEARD = (*identifiers_from("HARNESS"), icd.layout("FSW_BOOT").can_id)
SILENCE_TOLD_S = 1.0  # of the harness, after which the computer says again that it is here


class HarnessWatch:
    """Tells how long no frame of a harness was accepted; `look` is called ten times a second."""

    def __init__(self, state: npt.NDArray[np.void]) -> None:
        self._counted = state["rx"]["counted"][0]
        self._accepted, self._heard_s = 0, time.monotonic()

    def look(self) -> float:
        """Seconds of silence so far."""
        now_s, accepted = time.monotonic(), int(self._counted[OK] + self._counted[LOST])
        if accepted != self._accepted:
            self._accepted, self._heard_s = accepted, now_s
        return now_s - self._heard_s


class FlightComputer:
    """Owns the records of one flight computer and runs its loop on a bus."""

    def __init__(self, load_path: Path, bus_address: str, timing: Timing) -> None:
        self.image = read_image(load_path)
        self.load: npt.NDArray[np.void] = activate(self.image)
        self.number = draw_number()
        self.state = new_state(self.image.law, self.number)
        self.timing = timing
        self.silence = ""
        self.executive = np.zeros(1, EXECUTIVE)
        self.executive["synchronisation"] = SYNCHRONISATIONS.index(timing.synchronisation)
        self.executive["period_ns"] = round(float(self.load["dt_s"][0]) / timing.pace * 1e9)
        self.address = bus_address
        self.bus = open_bus(bus_address, hears=HEARD)
        self.bus.setblocking(False)
        self.io = new_io(RX_CAPACITY)
        self.rx = np.zeros(RX_CAPACITY, FRAME)
        self.tx = np.zeros(TX_CAPACITY, FRAME)
        self.asked_to_end = False
        self.compile_s = 0.0

    def _serve(
        self, state: npt.NDArray[np.void], executive: npt.NDArray[np.void], slice_ns: int
    ) -> int:
        return int(
            serve(self.bus.fileno(), self.io, self.load, state, executive, self.rx, self.tx,
                  slice_ns)
        )  # fmt: skip

    def take_priority(self, missing: str) -> None:
        """Go before others from here on; what is missing for it is said in one line.

        Last of all: a flight that is under way beside this one is not to wait for a start-up.
        """
        words = [word for word in (missing, take_priority(punctual_processor())) if word]
        if words:
            say(f"{NOT_PERMITTED} {'; '.join(words)}")

    def compile(self) -> None:
        """Load or make the machine code; says so if it has to be made."""
        start_s = time.monotonic()
        with on_compiling(lambda: say(f"{COMPILES} '{self.image.law}' for this processor")):
            self._serve(new_state(self.image.law), self.executive.copy(), 0)
        self.compile_s = time.monotonic() - start_s

    def discard(self) -> None:
        """Drop what came while nobody listened: a full queue would not take the first request."""
        end_s, taken = time.monotonic() + DISCARD_MAX_S, 0
        while time.monotonic() < end_s:
            try:
                raw = self.bus.recv(FRAME.itemsize)
            except BlockingIOError:
                if taken < RX_CAPACITY:
                    return
                taken = 0
                time.sleep(DISCARD_PAUSE_S)  # a hub has more for us
                continue
            except OSError:
                return
            if not raw:
                return
            taken += 1

    def _end(self, number: int, frame: FrameType | None) -> None:
        self.asked_to_end = True

    def _check_alone(self, announcer: Announcer) -> None:
        """Refuse to serve a bus that another computer serves."""
        if other := announcer.who_serves():
            raise FlightError(
                f"{self.address}: flight computer {name_of(other)} serves this bus already"
            )

    def _has_silent_harness(self, watch: HarnessWatch, announcer: Announcer) -> bool:
        """Announce where that is due; True once the harness was silent for too long."""
        silent_s = watch.look()
        is_armed = bool(self.state["armed"][0])
        has_flown = bool(self.executive["cycles"][0])
        if not has_flown or silent_s > SILENCE_TOLD_S:
            announcer.state = ARMED if is_armed else READY
            if announcer.announce() and not has_flown:
                self.executive["down_ns"] = 0
        limit_s = self.timing.silence_timeout_s if is_armed else self.timing.waiting_timeout_s
        if silent_s <= limit_s:
            return False
        cycles = int(self.executive["cycles"][0])
        self.silence = f"no frame from a harness for {limit_s:g} s, after {cycles} cycles"
        return True

    def run(self) -> int:
        """Announce, compile and serve; returns the executive's last word."""
        with Announcer(self.bus, self.image, self.number) as announcer:
            self.compile()
        self._check_alone(announcer)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._end)
        paced = self.executive["synchronisation"][0] != LOCKSTEP
        missing = lock_memory() if paced else ""
        gc.collect()
        gc.freeze()
        gc.disable()
        self.discard()
        if paced:
            self.take_priority(missing)
        else:
            run_in_bursts()
        outcome, watch = RUNNING, HarnessWatch(self.state)  # from here on only the loop takes time
        while outcome == RUNNING and not self.asked_to_end:
            if self._has_silent_harness(watch, announcer):
                break
            outcome = self._serve(self.state, self.executive, SLICE_NS)
        return outcome

    def bus_down_s(self) -> float:
        """How long the interface has been down."""
        total_ns = int(self.executive["down_total_ns"][0])
        if since_ns := int(self.executive["down_ns"][0]):
            total_ns += time.monotonic_ns() - since_ns
        return total_ns / 1e9

    def report(self) -> dict[str, Any]:
        """What the computer can tell of its flight."""
        executive, state = self.executive[0], self.state[0]
        counted = state["rx"]["counted"]
        errors = account_of(executive["errors"])
        return {
            "law": self.image.law,
            "computer": name_of(self.number),
            "sources": name_of(SOURCES),
            "load_crc32": f"0x{self.image.crc32:08x}",
            "cycles": int(executive["cycles"]),
            "frames_received": int(executive["frames_received"]),
            "frames_sent": int(executive["frames_sent"]),
            "verdicts": {name: int(n) for name, n in zip(VERDICTS, counted, strict=True)},
            "wrong_size": int(self.io["wrong_size"][0]),
            "error_frames": errors.frames,
            "bus_off": errors.bus_off,
            "bus_errors": list(errors.words),
            "error_counters": list(errors.counters),
            "frames_dropped": frames_dropped(self.bus),
            "bus_losses": int(executive["bus_losses"]),
            "bus_down_s": round(self.bus_down_s(), 3),
            "false_ticks": int(executive["false_ticks"]),
            "incomplete_sets": int(state["incomplete_sets"]),
            "candidates_believed": int(state["candidate"]["believed"]),
            "tx_refused": int(state["tx_refused"]),
            "mode": int(state["mode"]),
            "compile_s": round(self.compile_s, 3),
            "slips": int(executive["slips"]),
            "ticks": int(executive["ticks"]),
            "step_time_us": percentiles_us(executive["step_time"]),
            "wake_up_us": percentiles_us(executive["wake_up"]),
            "step_time_bins_us": filled_bins_us(executive["step_time"]),
            "wake_up_bins_us": filled_bins_us(executive["wake_up"]),
        }


def boot(load_path: Path, bus_address: str, timing: Timing) -> None:
    """Run a flight computer to its end and print its report; raises AeroshellError if refused."""
    computer = FlightComputer(load_path, bus_address, timing)
    outcome = computer.run()
    tell(json.dumps(computer.report()))
    computer.bus.close()
    if computer.silence:
        raise FlightError(f"{bus_address}: {computer.silence}")
    if outcome == BUS_LOST:
        cycles, down_s = int(computer.executive["cycles"][0]), computer.bus_down_s()
        how = f", its interface down for {down_s:.1f} s" if down_s > 0.0 else ""
        raise FlightError(f"{bus_address}: the bus was lost after {cycles} cycles{how}")
