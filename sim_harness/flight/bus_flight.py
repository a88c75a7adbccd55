"""A flight over a bus, in lockstep: each minor frame waits for the flight computer's answer."""

import os
import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from flight_sw.can.address import frames_dropped, open_bus
from flight_sw.can.sockets import new_io, send_frames
from flight_sw.errors import BusError, FlightError
from flight_sw.reception.requests import ARM, STOP
from flight_sw.records.dictionary import FRAME, RX_CAPACITY
from flight_sw.records.types_ import Frames
from flight_sw.runtime.privileges import (
    MCL_CURRENT,
    leave_processor,
    lock_memory,
    punctual_processor,
    take_priority,
    unlock_memory,
)
from flight_sw.runtime.scheduling import run_in_bursts
from sim_harness.bus.bus_listener import no_listener, socket_listener
from sim_harness.bus.hub import Hub
from sim_harness.bus.socket_path import socket_path
from sim_harness.flight.computer_process import ComputerProcess
from sim_harness.flight.flight import FlightPlan, FlightRun
from sim_harness.flight.loop import BUS_LOST, COMPUTER_SILENT, Wire, fly_in_lockstep
from sim_harness.flight.pacing import fly_in_real_time, punctuality, stolen_s
from sim_harness.flight.roles import LISTEN_S, Company, Presence, drain, listen

SIGN_OF_LIFE_S = 10.0  # longest silence of a computer that boots; it announces every 0.1 s
START_UP_S = 120.0  # before the first: a process of ours that imports on a machine with no time
LISTEN_ONCE_S = 0.05
HEARD_ONCE_MAX = 256  # packets between two looks at who is here
HEAR_PAUSE_S = 0.02
REST_S, REST_MAX_S = 0.005, 0.05  # for frames on their way at the end of a flight
WAITING_TIMEOUT_S = 60.0  # of our own computer for us, should we end without ending it
STOPS_MAX, STOP_AGAIN_S = 10, 0.2
CYCLES_MAX = 1 << 40


def computer_options(plan: FlightPlan) -> list[str]:
    """What the flight computer is told of the pace."""
    options = ["--waiting-timeout-s", f"{WAITING_TIMEOUT_S:g}"]
    if plan.pace <= 0.0:
        return options
    return [*options, "--synchronisation", plan.synchronisation, "--pace", f"{plan.pace:g}"]


def why_lost(address: str) -> str:
    """What is wrong with a bus that was lost, as the end of a sentence; empty if not known."""
    if address == "unix":
        return ""
    try:
        open_bus(address).close()
    except BusError as error:
        return ": " + str(error).removeprefix(f"{address}: ")
    return ""


class BusFlight:
    """One flight over the bus of its plan; owns hub, socket and flight computer while it flies."""

    def __init__(self, run: FlightRun, resources: ExitStack) -> None:
        self.run = run
        self.bus_listener = no_listener()
        plan = run.plan
        address = plan.bus
        if plan.bus == "unix":
            path = resources.enter_context(socket_path())
            with run.compiling("the bus"):
                hub = Hub(path, prompt=plan.pace > 0.0, logged=plan.recorded, tell=run.warn)
                self.bus_listener = resources.enter_context(hub).bus_listener
            address = f"unix:{path}"
        elif plan.recorded:  # before the socket for the answers, so that it hears them first
            self.bus_listener = socket_listener(self._open(resources, address).fileno())
        run.harness["has_bus_listener"] = int(plan.recorded)
        run.hear(self.bus_listener)  # compiles its kernels before there is anything to miss
        self.bus = self._open(resources, address)
        self.company = Company(plan.bus, run.number, run.image.crc32)
        self.presence = Presence(self.bus, run.number)
        resources.callback(self.presence.stop)
        self.listen_s = 0.0 if plan.bus == "unix" else LISTEN_S
        self._claim()
        self.computer: ComputerProcess | None = None
        if plan.own_computer:
            self.computer = resources.enter_context(
                ComputerProcess(plan.load_path, address, computer_options(plan), run.warn)
            )
        self.processor = punctual_processor()
        self.wire = Wire(self.bus.fileno(), new_io(RX_CAPACITY), run.rx, run.tx, self.bus_listener)

    @staticmethod
    def _open(resources: ExitStack, address: str) -> socket.socket:
        bus: socket.socket = resources.enter_context(open_bus(address))
        bus.setblocking(False)
        return bus

    def fly_paced(self) -> int:
        """Fly to the end against the clock; for a thread of its own."""
        run = self.run
        take_priority(self.processor)
        return int(fly_in_real_time(run.harness, run.pacer, self.wire, run.logs, CYCLES_MAX))

    def chunk(self, cycles: int) -> int:
        """Fly up to `cycles` minor frames."""
        run = self.run
        timeout_ns = int(run.plan.reply_timeout_s * 1e9)
        return int(fly_in_lockstep(run.harness, self.wire, run.logs, cycles, timeout_ns))

    def _hear(self) -> None:
        """Take what has come from the bus, after a moment's wait for it."""
        select.select([self.bus], [], [], LISTEN_ONCE_S)
        for _ in range(HEARD_ONCE_MAX):
            try:
                packet = self.bus.recv(FRAME.itemsize)
            except BlockingIOError:
                return
            except OSError as error:
                raise FlightError(
                    f"bus {self.run.plan.bus} was lost before the flight began ({error.strerror})"
                ) from error
            if not packet:
                raise FlightError("the bus was closed before the flight began")
            self.company.hear(packet)

    def _claim(self) -> None:
        """Say that the bus is this harness's, unless somebody is there already."""
        company, plan = self.company, self.run.plan
        listen(self.bus, company, self.listen_s)
        company.check_harnesses(claimed=False)
        company.check_computers(most=0 if plan.own_computer else 1)
        self.presence.start()
        listen(self.bus, company, self.listen_s)
        company.check_harnesses(claimed=True)

    def await_computer(self) -> None:
        """Wait until the flight computer announces our load as ready, and nobody else is here."""
        company = self.company
        drain(self.bus)  # what lies there may be of those who have gone
        company.forget()
        start_s = heard_s = time.monotonic()
        silence_max_s = SIGN_OF_LIFE_S if self.computer is None else START_UP_S
        while not company.ready() or time.monotonic() - start_s < self.listen_s:
            self._hear()
            self.run.hear(self.bus_listener)
            if self.computer is not None:
                self.computer.fail_if_ended()
            company.check_harnesses(claimed=True)
            company.check_computers(most=1)
            now_s = time.monotonic()
            if company.has_ours():
                heard_s, silence_max_s = now_s, SIGN_OF_LIFE_S
                does = "compiles" if self.computer and self.computer.is_compiling else "loads"
                self.run.waiting(
                    f"flight computer {does} law '{self.run.image.law}' ({now_s - start_s:.0f} s)"
                )
            if now_s - heard_s > silence_max_s:
                raise FlightError(
                    f"no flight computer with load 0x{self.run.image.crc32:08x} announced itself "
                    f"on {self.run.plan.bus} for {silence_max_s:g} s{company.other_loads()}"
                )
        self._take_on(company.ready())

    def _take_on(self, number: int) -> None:
        """Fly with this computer: it is named in all that is said from here on."""
        if sentence := self.company.other_sources(number):
            if not self.run.plan.other_sources:
                raise FlightError(sentence)
            self.run.warn(sentence)
        port = self.run.harness["port"]
        self.presence.stop()
        self.presence.computer = number
        self.presence.say()
        port["computer"], port["present_counter"] = number, self.presence.counter

    def _send(self, frames: Frames) -> None:
        """Send outside the loop; a bus that takes nothing ends the flight."""
        if send_frames(self.wire.fd, self.wire.io[0], frames, len(frames)) < len(frames):
            self.run.outcome = BUS_LOST

    def fly(self) -> None:
        """Compile, wait for the computer, arm, fly, stop, take its report."""
        run = self.run
        start_s = time.perf_counter()
        with run.compiling("the flight loop"), self._hearing():
            if run.plan.pace > 0.0:
                fly_in_real_time(run.harness, run.pacer, self.wire, run.logs, 0)
            else:
                self.chunk(0)
        run.harness["port"]["rx"]["counted"] = 0
        run.harness["port"]["frames_received"] = 0
        self.await_computer()
        run.compile_s = time.perf_counter() - start_s
        run.waiting("")
        if run.plan.pace <= 0.0:
            run_in_bursts()
        self._send(run.request(ARM))
        if run.outcome != BUS_LOST:
            self._fly_to_the_end()
        if run.plan.pace <= 0.0 and run.outcome not in (BUS_LOST, COMPUTER_SILENT):
            self._send(run.request(STOP))  # against the clock the loop itself has sent it
        run.frames_dropped = frames_dropped(self.bus)
        if self.computer is not None and run.outcome not in (BUS_LOST, COMPUTER_SILENT):
            self._see_it_end(self.computer)
            run.computer = self.computer.report()
        self._hear_the_rest()

    @contextmanager
    def _hearing(self) -> Iterator[None]:
        """Have the bus listener emptied while something else takes long."""
        over = threading.Event()

        def hear() -> None:
            while not over.wait(HEAR_PAUSE_S):
                self.run.hear(self.bus_listener)

        thread = threading.Thread(target=hear, name="bus-listener")
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def _hear_the_rest(self) -> None:
        """Have recorded what is still on its way; a bus that never rests is left after a moment."""
        end_s = time.monotonic() + REST_MAX_S
        while self.run.harness["has_bus_listener"][0] and time.monotonic() < end_s:
            if self.run.hear(self.bus_listener) == 0:
                return
            time.sleep(REST_S)

    def _see_it_end(self, computer: ComputerProcess) -> None:
        """Ask again while the flight computer goes on: a request is lost where a queue was full."""
        for _ in range(STOPS_MAX):
            if computer.ends_within(STOP_AGAIN_S) or self.run.outcome == BUS_LOST:
                return
            self._send(self.run.request(STOP))

    def _fly_to_the_end(self) -> None:
        run = self.run
        if run.plan.pace > 0.0:
            lock_memory(MCL_CURRENT)  # what the loop uses is there; whoever drains it may grow
            allowed, before_s = leave_processor(self.processor), stolen_s()
            try:
                run.fly_beside(self.fly_paced)
            finally:
                os.sched_setaffinity(0, allowed)
                unlock_memory()
                t_s = float(run.harness["truth"]["t_s"][0])
                stolen = stolen_s() - before_s
                run.punctuality = punctuality(run.pacer[0], run.plan.pace, t_s, stolen)
        else:
            run.fly(lambda: self.chunk(run.chunk_cycles))

    def failure(self) -> str:
        """Why a flight without an answer ended, in a sentence; empty for any other."""
        run = self.run
        t_s = float(run.harness["truth"]["t_s"][0])
        if run.outcome == BUS_LOST:
            why = why_lost(run.plan.bus)
            return f"bus {run.plan.bus} was lost at {t_s:.2f} s of flight{why}"
        if run.outcome != COMPUTER_SILENT:
            return ""
        if self.computer is not None:
            try:
                self.computer.fail_if_ended()
            except FlightError as error:
                return f"{error}, at {t_s:.2f} s of flight"
        silence_s = run.plan.reply_timeout_s
        if run.plan.pace > 0.0:
            silence_s = float(run.pacer["silence_max_ns"][0]) / 1e9
        return f"flight computer did not answer for {silence_s:g} s, at {t_s:.2f} s of flight"

    def give_up(self) -> None:
        """End a computer of ours that does not answer: it will not heed a request to end either."""
        if self.computer is not None and self.run.outcome == COMPUTER_SILENT:
            self.computer.kill()


def fly_bus(run: FlightRun) -> str:
    """Fly over the bus of the plan; returns why it ended early, or an empty text."""
    with ExitStack() as resources:
        flight = BusFlight(run, resources)
        flight.fly()
        sentence = flight.failure()
        flight.give_up()
        return sentence
