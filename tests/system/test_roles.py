"""Real processes that meet on a bus: one flies, the other says whom it found there."""

import re
import socket
import time
from pathlib import Path
from typing import Any

import pytest

from flight_sw.announcer import READY
from flight_sw.can.address import open_bus
from flight_sw.can.plain import plain_frame, read_plain
from flight_sw.errors import FlightError
from flight_sw.runtime.identity import SOURCES, name_of
from sim_harness.bus.hub import Hub
from sim_harness.flight import roles
from sim_harness.flight.bus_flight import fly_bus
from sim_harness.flight.computer_process import ComputerProcess
from sim_harness.flight.flight import FlightRun
from sim_harness.flight.summary import summary_of
from tests.system.flights import built, run_of
from tests.system.paced import piece
from tests.system.test_processes import Saboteur, own_hub_run, wait_gone

pytestmark = pytest.mark.jit_only

TIMEOUT_S = 120.0  # of a computer that may have to compile first
STRANGER = 0x12345


class Warned(Saboteur):
    """Keeps what was warned of, and does something once the flight has begun."""

    def __init__(self, action: Any) -> None:
        super().__init__(action)
        self.words: list[str] = []

    def warn(self, t_s: float, text: str) -> None:
        """Keep it."""
        self.words.append(text)


def ready_computer(bus: socket.socket) -> int:
    """The number of the computer that announces itself as ready."""
    bus.settimeout(TIMEOUT_S)
    while True:
        read = read_plain(bus.recv(64))
        if read and read.message.name == "FSW_BOOT" and read.raw["state"] == READY:
            return read.raw["computer"]


def test_a_second_computer_and_a_harness_with_one_of_its_own_name_the_first(tmp_path: Path) -> None:
    address = f"unix:{tmp_path / 'bus'}"
    with Hub(tmp_path / "bus"), open_bus(address) as bus_listener:
        run = own_hub_run(tmp_path)
        load = run.plan.load_path
        with ComputerProcess(load, address, [], print) as first:
            name = name_of(ready_computer(bus_listener))
            with ComputerProcess(load, address, [], print) as second:
                assert wait_gone(second.pid, TIMEOUT_S)
                assert second.status == 1
                words = (
                    f"flight computer: {address}: flight computer {name} serves this bus already"
                )
                assert second.last_words == words
            with pytest.raises(
                FlightError, match=f"^{address}: flight computer {name} is there al"
            ):
                fly_bus(run_of(built("lqy", "minute"), load, address, recorded=False))
            assert fly_bus(run) == ""  # the first was not disturbed
            assert wait_gone(first.pid)
            assert summary_of(run)["computer"] == name


def test_an_armed_computer_whose_harness_is_gone_is_named_and_ends(tmp_path: Path) -> None:
    address = f"unix:{tmp_path / 'bus'}"
    with Hub(tmp_path / "bus"), open_bus(address) as gone:
        run = own_hub_run(tmp_path)
        options = ["--silence-timeout-s", "4"]
        with ComputerProcess(run.plan.load_path, address, options, print) as computer:
            number = ready_computer(gone)
            arm = {"computer": number, "harness": STRANGER, "request": 1}
            gone.send(plain_frame("GROUND_REQUEST", arm, 0))
            time.sleep(1.5)  # a harness would fly here, and be killed
            words = f"^{address}: flight computer {name_of(number)} is armed there by a harness"
            with pytest.raises(FlightError, match=words):
                fly_bus(run)
            assert wait_gone(computer.pid, TIMEOUT_S)
            assert computer.status == 1
            assert computer.last_words == (
                f"flight computer: {address}: no frame from a harness for 4 s, after 0 cycles"
            )


def test_a_computer_that_waits_ends_when_it_was_asked_to(tmp_path: Path) -> None:
    address = f"unix:{tmp_path / 'bus'}"
    with Hub(tmp_path / "bus"):
        load = own_hub_run(tmp_path).plan.load_path
        options = ["--waiting-timeout-s", "1"]
        with ComputerProcess(load, address, options, print) as computer:
            assert wait_gone(computer.pid, TIMEOUT_S)
            assert "no frame from a harness for 1 s, after 0 cycles" in computer.last_words


def refused_beside(run: FlightRun, second: FlightRun) -> str:
    """What a second harness is told that comes while a flight goes on."""
    words: list[str] = []

    def come() -> None:
        try:
            words.append(fly_bus(second))
        except FlightError as error:
            words.append(str(error))

    run.listeners.append(Warned(come))
    assert fly_bus(run) == ""
    return words[0]


@pytest.mark.alone
def test_a_second_harness_is_refused_and_the_first_flies_its_flight(tmp_path: Path) -> None:
    address = f"unix:{tmp_path / 'bus'}"
    with Hub(tmp_path / "bus"):
        run = run_of(piece(6.0), tmp_path / "a.load", address, recorded=False, pace=1.0)
        second = run_of(piece(1.0), tmp_path / "b.load", address, recorded=False)
        words = refused_beside(run, second)
    computer = name_of(int(run.harness["port"]["computer"][0]))
    named = f"{address}: harness {name_of(run.number)} flies there with flight computer {computer}"
    assert words in (named, f"{address}: another harness flies there")
    told = summary_of(run)
    assert (told["other_computer"], told["rejected_by_flight_computer"]["FOREIGN"]) == (None, 0)
    assert run.outcome_text == "time out"


def test_who_appears_in_flight_is_warned_of_and_told(tmp_path: Path) -> None:
    address = f"unix:{tmp_path / 'bus'}"
    with Hub(tmp_path / "bus"), open_bus(address) as stranger:

        def appear() -> None:
            boot = {"computer": STRANGER, "state": 0, "law": 0, "sources": 0}
            stranger.send(plain_frame("FSW_BOOT", boot, 0))
            here = {"harness": 0x54321, "computer": STRANGER, "state": 0}
            stranger.send(plain_frame("HARNESS_PRESENT", here, 0))
            arm = {"computer": STRANGER, "harness": 0x54321, "request": 2}
            stranger.send(plain_frame("GROUND_REQUEST", arm, 0))

        run = run_of(built("lqy", "minute"), tmp_path / "a.load", address, recorded=False)
        warned = Warned(appear)
        run.listeners.append(warned)
        assert fly_bus(run) == ""
    ours = name_of(int(run.harness["port"]["computer"][0]))
    assert warned.words[0] == (
        f"flight computer 0x12345 announces itself on {address} beside {ours}"
    )
    wanted = "another sender on .*: [12] frames under the harness's identifiers, of harness 0x54321"
    assert re.match(wanted, warned.words[1])
    told = summary_of(run)
    assert (told["other_harness"], told["other_computer"]) == ("0x54321", "0x12345")
    assert told["rejected_by_harness"]["FOREIGN"] == 2
    assert told["rejected_by_flight_computer"]["MISDIRECTED"] == 2  # both words


@pytest.mark.parametrize("allowed", [False, True])
def test_a_computer_of_other_sources_is_refused_or_warned_of(
    allowed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(roles, "SOURCES", SOURCES ^ 1)
    run = run_of(piece(0.5), tmp_path / "a.load", "unix", recorded=False, other_sources=allowed)
    warned = Warned(lambda: None)
    run.listeners.append(warned)
    if allowed:
        assert fly_bus(run) == ""
        assert " was built from other sources, " in warned.words[0]
    else:
        with pytest.raises(FlightError, match=r"^unix: flight computer 0x.* was built from other"):
            fly_bus(run)
        assert run.harness["truth"]["minor_frames"][0] == 0
