"""One flight from plan to summary: in memory, or as two processes on a bus.

The flight computer of a bus flight is a process of its own. What the harness knows of it comes over
the bus; its standard output only brings the report of its own timing when it has ended.
"""

import hashlib
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from flight_sw import icd
from flight_sw.can.error_frames import account_of
from flight_sw.computer import minor_frame, new_state
from flight_sw.errors import FlightError
from flight_sw.load_image import LoadImage, activate, parse_image
from flight_sw.reception.receiver import VERDICTS
from flight_sw.reception.requests import ARM, STOP
from flight_sw.records.dictionary import FRAME, RX_CAPACITY, TX_CAPACITY
from flight_sw.records.types_ import Frames, Record
from flight_sw.runtime.histogram import HISTOGRAM, filled_bins_us, percentiles_us
from flight_sw.runtime.identity import ALONE, NOBODY, draw_number
from flight_sw.runtime.kernel_cache import on_compiling
from sim_harness.bus.bus_listener import BusListener
from sim_harness.flight.error_watch import ErrorWatch
from sim_harness.flight.loop import (
    BUS_LOST,
    COMPUTER_SILENT,
    HARNESS,
    INTERRUPTED,
    fly_in_memory,
    hear_outside,
)
from sim_harness.flight.navigation_watch import NavigationWatch
from sim_harness.flight.pacing import new_pacer
from sim_harness.flight.port import new_port, put_request
from sim_harness.flight.roles import RoleWatch
from sim_harness.flight.slip_watch import SlipWatch, slips_so_far
from sim_harness.jit import kernel
from sim_harness.mission.mission import Mission
from sim_harness.telemetry.journal import BUS_ROWS, TRUTH_ROWS, Journal
from sim_harness.telemetry.logs import BUS, COMMANDS, TRUTHS, Logs
from sim_harness.telemetry.records import BUS_LOG
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.navigation import beyond_the_bus, report_truth
from sim_harness.world.records import FLYING, OUTCOMES, TRUTH

CHUNK_CYCLES = {"memory": 5000, "bus": 1000}  # minor frames flown between two looks at the outside
RING_S = 2.0  # of a flight against the clock that its logs hold, undrained
RING_CYCLES_MAX = 65536
DRAIN_S = 0.05  # between two looks at the logs of a flight in real time
DRAIN_FLIGHT_S = 0.5  # of flight, at any pace
TIMED_EVERY = 8  # minor frames in memory: the clock takes a thirtieth of each that it is read for
LISTENER_BATCHES = 64  # heard in one go outside the loop
FRAMES_PER_CYCLE = 16  # room in the log for each minor frame; a busier bus ends the chunk early
OTHER_OUTCOMES = {
    BUS_LOST: "bus lost",
    COMPUTER_SILENT: "flight computer silent",
    INTERRUPTED: "interrupted",
}


@dataclass(frozen=True)
class FlightPlan:
    """What is to be flown."""

    mission: Mission
    law: str
    load_image: bytes
    load_path: Path
    bus: str
    """`memory`, `unix` (a hub of its own), `unix:PATH` or another bus address."""
    seed: int = 0
    truth_rate_hz: float = 10.0
    recorded: bool = True
    truth_kept: bool = False
    """The listeners are given the truth's rows although no frame of the bus is recorded."""
    reply_timeout_s: float = 0.8
    pace: float = 0.0
    """Mission seconds per second of the clock; 0: lockstep."""
    synchronisation: str = "frame"
    """How the flight computer waits when there is a pace: `frame` or `clock`."""
    other_sources: bool = False
    """A flight computer of other sources is warned of, not refused."""
    own_computer: bool = True
    """False: a flight computer with this load is on the bus already."""
    case: str | None = None
    """Which of the mission's cases it is."""


class Onboard(NamedTuple):
    """A load image as it was read, and the record that flies."""

    image: LoadImage
    load: npt.NDArray[np.void]


def onboard_of(load_image: bytes, where: str) -> Onboard:
    """Read, check and activate a load image."""
    image = parse_image(load_image, where)
    return Onboard(image, activate(image))


class Listener(Protocol):
    """Who is told of a flight in progress: recorder, progress bar."""

    def rows(self, bus: npt.NDArray[np.void], truth: npt.NDArray[np.void]) -> None:
        """Take what the last chunk logged; the arrays are used again afterwards."""

    def progress(self, run: "FlightRun") -> None:
        """Show how the flight stands."""

    def waiting(self, text: str) -> None:
        """Show what is waited for; an empty text ends it."""

    def warn(self, t_s: float, text: str) -> None:
        """Show something amiss that does not end the flight."""


@dataclass
class FlightRun:
    """The records of one flight, and what is known of it at its end."""

    plan: FlightPlan
    listeners: list[Listener]
    onboard: "Onboard | None" = None
    """The plan's load image, where it has been read and activated before."""
    outcome: int = FLYING
    compile_s: float = 0.0
    wall_s: float = 0.0
    ended_by: str = ""
    """What ended the flight from outside, in a word; empty if nothing did."""
    unrecorded: str = ""
    """Why the recording ended before the flight, in a sentence; empty if it did not."""
    frames_dropped: int = 0
    """Frames that the harness's socket had no room for."""
    punctuality: dict[str, Any] = field(default_factory=dict)
    """How the flight kept time; empty in lockstep."""
    computer: dict[str, Any] = field(default_factory=dict)
    """The flight computer's report."""

    def __post_init__(self) -> None:
        plan = self.plan
        onboard = self.onboard or onboard_of(plan.load_image, str(plan.load_path))
        self.image, self.load = onboard
        self.harness = new_harness(plan, self.load)
        self.number = ALONE if plan.bus == "memory" else draw_number()
        self.harness["port"]["harness"] = self.number
        if plan.bus != "memory":
            self.harness["port"]["computer"] = NOBODY
        self.pacer = new_pacer(plan.pace, plan.mission.dt_s)
        cycles = CHUNK_CYCLES["memory" if plan.bus == "memory" else "bus"]
        if plan.pace > 0.0:
            wanted = round(RING_S * plan.pace / plan.mission.dt_s)
            cycles = min(max(cycles, wanted), RING_CYCLES_MAX)
        rows = cycles * FRAMES_PER_CYCLE if plan.recorded else 0
        truth_rows = cycles // int(self.harness["truth_divider"][0]) + 1
        self.logs = Logs(
            np.zeros(cycles, FRAME),
            np.zeros(rows, BUS_LOG),
            np.zeros(truth_rows if plan.recorded or plan.truth_kept else 0, TRUTH),
        )
        self.chunk_cycles = cycles
        self.rx = np.zeros(RX_CAPACITY, FRAME)
        self.tx = np.zeros(TX_CAPACITY, FRAME)
        self.journal: Journal | None = None
        self._sha256 = hashlib.sha256()
        self.slip_watch, self.role_watch = SlipWatch(), RoleWatch()
        self.error_watch = ErrorWatch()
        self.navigation_watch = NavigationWatch()

    def waiting(self, text: str) -> None:
        """Tell the listeners what is waited for."""
        for listener in self.listeners:
            listener.waiting(text)

    @contextmanager
    def compiling(self, what: str) -> Iterator[None]:
        """Tell the listeners if something is compiled in this block, and when it is over."""
        with on_compiling(lambda: self.waiting(f"compiling {what} for this processor")):
            yield
        self.waiting("")

    def request(self, code: int) -> Frames:
        """The frame of a request to the flight computer, logged unless a bus listener hears it."""
        harness = self.harness
        n = put_request(harness["codec"][0], harness["port"][0], code, self.tx)
        if self.plan.recorded and not harness["has_bus_listener"][0]:
            rows = np.zeros(n, BUS_LOG)
            rows["t_s"] = harness["truth"]["t_s"]
            rows["frame"] = self.tx[:n]
            self._hand_on(rows, self.journal)
        return self.tx[:n].copy()

    def hear(self, bus_listener: BusListener) -> int:
        """Have frames recorded that passed on the bus outside the loop; how many there were."""
        n = int(hear_outside(self.harness, self.logs, bus_listener, LISTENER_BATCHES))
        rows = self._taken(BUS, self.logs.bus, "written")
        self._hand_on(rows, self.journal if self.plan.pace > 0.0 else None)
        return n

    def _hand_on(self, rows: npt.NDArray[np.void], journal: Journal | None) -> None:
        if journal is not None:
            journal.append(BUS_ROWS, rows)
        for listener in self.listeners:
            listener.rows(rows, np.zeros(0, TRUTH))

    def keep_journal(self, recording: Path, recording_id: str) -> Journal:
        """Keep a journal beside a recording: the loop's own, unless it flies against the clock."""
        self.journal = Journal(recording, recording_id, TRUTH)
        if self.plan.pace <= 0.0:
            logs = self.logs
            self.journal.serve_loop(self.harness, logs.bus, logs.truth, self.plan.mission.dt_s)
        return self.journal

    def _look_after_journal(self, bus: npt.NDArray[np.void], truth: npt.NDArray[np.void]) -> None:
        if self.journal is None:
            return
        if self.plan.pace > 0.0:
            self.journal.append(BUS_ROWS, bus)
            self.journal.append(TRUTH_ROWS, truth)
        if why := self.journal.look(self.harness):
            self.warn(f"{self.journal.path.name} ended, {why}: a kill may lose more than a second")

    def _taken(self, log: int, ring: npt.NDArray[np.void], limit: str) -> npt.NDArray[np.void]:
        """What the loop has put into a ring log since the last look, in order."""
        harness = self.harness[0]
        first, last = int(harness["taken"][log]), int(harness[limit][log])
        if not len(ring) or first >= last:
            return ring[:0]
        at = first % len(ring)
        rows = ring[at : at + last - first].copy()
        if len(rows) < last - first:  # beyond the end of the ring
            rows = np.concatenate([rows, ring[: last - first - len(rows)]])
        harness["taken"][log] = last
        return rows

    def wait_for(self, flight: threading.Thread, interval_s: float) -> None:
        """Drain the logs while a thread flies; Ctrl-C asks it to end."""
        try:
            while flight.is_alive():
                flight.join(interval_s)
                if flight.is_alive():
                    self.drain("published")
        except BaseException:
            self.harness["asked_to_end"] = 1
            flight.join()
            raise

    def drain(self, limit: str = "written") -> None:
        """Hand on what was logged since the last call; of a loop that runs what is `published`."""
        self._sha256.update(self._taken(COMMANDS, self.logs.commands, limit).tobytes())
        bus = self._taken(BUS, self.logs.bus, limit)
        truth = self._taken(TRUTHS, self.logs.truth, limit)
        self._look_after_journal(bus, truth)
        for listener in self.listeners:
            if self.plan.recorded or self.plan.truth_kept:
                listener.rows(bus, truth)
            listener.progress(self)
        port = self.harness["port"][0]
        if self.plan.bus != "memory":
            self.warn(self.role_watch.look(time.monotonic(), self.plan.bus, port))
        self.warn(self.error_watch.look(account_of(port["errors"])))
        for said in self.navigation_watch.look(self.harness[0]["navigation"]):
            self.warn(said)
        if self.plan.pace > 0.0:
            self.warn(self.slip_watch.look(time.monotonic(), slips_so_far(self.pacer[0], port)))

    def warn(self, text: str) -> None:
        """Tell the listeners of something amiss; an empty text is nothing."""
        t_s = float(self.harness["truth"]["t_s"][0])
        for listener in self.listeners if text else ():
            listener.warn(t_s, text)

    def fly_beside(self, fly_all: Callable[[], int]) -> None:
        """Fly to the end in a thread of its own, draining its logs from this one."""
        outcomes: list[int] = []
        flight = threading.Thread(target=lambda: outcomes.append(int(fly_all())), name="flight")
        start_s = time.perf_counter()
        flight.start()
        try:
            self.wait_for(flight, min(DRAIN_S, DRAIN_FLIGHT_S / max(self.plan.pace, 1.0)))
        finally:
            self.wall_s = time.perf_counter() - start_s
            self.outcome = outcomes[0] if outcomes else INTERRUPTED
            self.drain()

    def fly(self, fly_chunk: Callable[[], int]) -> None:
        """Fly chunk by chunk to the end, timing the loop alone."""
        while self.outcome == FLYING:
            start_s = time.perf_counter()
            self.outcome = int(fly_chunk())
            self.wall_s += time.perf_counter() - start_s
            self.drain()

    @property
    def command_sha256(self) -> str:
        """Identity of the flight: over all command frames in order, 16 bytes each."""
        return self._sha256.hexdigest()

    @property
    def outcome_text(self) -> str:
        """The outcome in words."""
        return self.ended_by or OTHER_OUTCOMES.get(self.outcome) or OUTCOMES[self.outcome]


def refuse_beyond_the_bus(mission: Mission, truth: Record) -> None:
    """Raise FlightError where navigation could not report the entry state."""
    values = np.zeros(icd.N_VALUES)
    report_truth(truth, values)
    if beyond := beyond_the_bus(values):
        raise FlightError(f"{mission.path.name}: entry state: {beyond}")


def new_harness(plan: FlightPlan, load: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """The harness's records at entry, shape (1,)."""
    mission = plan.mission
    harness = np.zeros(1, HARNESS)
    world = world_of(mission, plan.seed)
    harness["world"] = world
    harness["codec"] = load["codec"]
    harness["truth"] = truth_of(mission, plan.seed, world)
    refuse_beyond_the_bus(mission, harness["truth"][0])
    harness["navigation"]["seed"] = plan.seed
    truth = harness["truth"][0]
    harness["port"] = new_port(float(truth["bank_rad"]), float(truth["alpha_rad"]))
    metrics = harness["metrics"][0]
    metrics["heat_flux_limit_wpm2"] = mission.limits.heat_flux_max_kwpm2 * 1e3
    metrics["load_factor_limit_g"] = mission.limits.load_factor_max_g
    metrics["dynamic_pressure_limit_pa"] = mission.limits.dynamic_pressure_max_kpa * 1e3
    harness["truth_divider"] = max(round(1.0 / (mission.dt_s * plan.truth_rate_hz)), 1)
    if float(load["dt_s"][0]) != float(harness["world"]["dt_s"][0]):
        raise FlightError(
            f"{plan.load_path}: minor frame is {load['dt_s'][0]:g} s, "
            f"mission {mission.name} has {mission.dt_s:g} s"
        )
    return harness


@kernel
def hand_over(loads: Frames, states: Frames, rx: Frames, n_rx: int, tx: Frames) -> int:
    """One call of the minor frame outside the flight loop."""
    return minor_frame(loads[0], states[0], rx, n_rx, tx)


def memory_loop(run: FlightRun, timed_every: int) -> tuple[Callable[[int], int], Frames, Frames]:
    """What flies up to so many cycles, the computer's state, and the histogram of its steps."""
    state = new_state(run.image.law)
    step_time = np.zeros(1, HISTOGRAM)
    run.harness["timed_every"] = timed_every

    def chunk(cycles: int) -> int:
        return int(
            fly_in_memory(run.harness, run.load, state, step_time, run.rx, run.tx, run.logs, cycles)
        )

    return chunk, state, step_time


def fly_memory(run: FlightRun, timed_every: int = TIMED_EVERY) -> None:
    """Fly with the minor frame called in the same compiled loop as the world.

    One of so many steps of the computer is timed; 0: none.
    """
    start_s = time.perf_counter()
    with run.compiling("the flight loop"):
        chunk, state, step_time = memory_loop(run, timed_every)
        chunk(0)
        armed = run.request(ARM)
        hand_over(run.load, state, armed, len(armed), run.tx)
    run.compile_s = time.perf_counter() - start_s
    run.fly(lambda: chunk(run.chunk_cycles))
    stop = run.request(STOP)
    hand_over(run.load, state, stop, len(stop), run.tx)
    run.computer = {
        "compile_s": round(run.compile_s, 3),
        "verdicts": verdicts(state["rx"]["counted"][0]),
        "incomplete_sets": int(state["incomplete_sets"][0]),
        "candidates_believed": int(state["candidate"]["believed"][0]),
    }
    if timed_every > 0:
        run.computer["step_time_us"] = percentiles_us(step_time[0])
        run.computer["step_time_bins_us"] = filled_bins_us(step_time[0])


def verdicts(counted: npt.NDArray[np.int64]) -> dict[str, int]:
    """A receiver's counters by name."""
    return {name: int(n) for name, n in zip(VERDICTS, counted, strict=True)}
