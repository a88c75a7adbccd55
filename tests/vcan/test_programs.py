"""can-utils and python-can on the interface of a flight, and our own monitor beside them."""

import json
import re
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import pytest

from flight_sw import icd
from flight_sw.can.address import identifiers_from, open_bus
from flight_sw.load_image import messages_of
from sim_harness.flight.flight import FlightRun
from tests.vcan.flying import BUS, END_S, INTERFACE, Trigger, end, fly, program, running, start

pytestmark = [pytest.mark.vcan, pytest.mark.jit_only]

BITRATE_BPS = 1_000_000
POINTS = 2.0
FLOWN_LAW = "lqy"
MEASURED_MAX_S = 120.0
MONITORED_S = 30.0
RECEIVERS = Path("/proc/net/can/rcvlist_all")
FOREIGN_ID = 0x5A5
LINE = re.compile(r"\((?P<t>[\d.]+)\) vcan0 (?P<id>[0-9A-F]{3})#(?P<data>[0-9A-F]*)")


def cansend(frame: str) -> None:
    subprocess.run([program("cansend"), INTERFACE, frame], check=True)


def test_candump_and_cansend_work_beside_a_flight(tmp_path: Path) -> None:
    log = tmp_path / "candump.log"
    dump = start("candump", "-L", INTERFACE, output=log)
    time.sleep(1.0)
    one = Trigger(lambda: cansend("5A5#0102030405060708"))
    summary = fly(time_max_s=5.0, pace=1.0, trigger=one)  # lockstep outruns candump's buffer
    time.sleep(0.5)
    end(dump)
    lines = [LINE.fullmatch(line) for line in log.read_text("ascii").splitlines()]
    counts = dict.fromkeys((0x010, 0x02F, 0x030, FOREIGN_ID), 0)
    for line in lines:
        assert line is not None
        if int(line["id"], 16) in counts:
            counts[int(line["id"], 16)] += 1
    flown = summary["minor_frames"]
    assert counts == {0x010: flown, 0x02F: flown, 0x030: flown, FOREIGN_ID: 1}
    assert summary["rejected_by_harness"]["UNKNOWN_ID"] == 1
    if summary["slips"] + summary["late_commands"] == 0:
        assert summary["command_sha256"] == fly("memory", 5.0)["command_sha256"]


def test_canplayer_replays_what_candump_wrote(tmp_path: Path) -> None:
    log = tmp_path / "foreign.log"
    log.write_text("".join(f"({n * 0.01:.6f}) vcan0 5A5#{n:02X}\n" for n in range(100)), "ascii")
    played = []
    player = Trigger(lambda: played.append(start("canplayer", "-I", str(log))))
    summary = fly(time_max_s=4.0, pace=1.0, trigger=player)
    assert played[0].wait(END_S) == 0
    assert summary["failure"] == ""
    assert summary["rejected_by_harness"]["UNKNOWN_ID"] == 100


def test_python_can_hears_a_flight_on_the_same_interface() -> None:
    heard: list[can.Message] = []
    with can.Bus(interface="socketcan", channel=INTERFACE) as bus:
        notifier = can.Notifier(bus, [heard.append])
        summary = fly(time_max_s=3.0, pace=1.0)
        time.sleep(0.5)
        notifier.stop()
    commands = [m for m in heard if m.arbitration_id == 0x010]
    assert len(commands) == summary["minor_frames"]


class UntilMeasured(Trigger):
    """Starts the measurements when the computer is ready, and ends the flight when ours is over."""

    def __init__(self, seconds: float, log: Path) -> None:
        super().__init__(self._start)
        self.seconds, self.log, self.ours = seconds, log, log.with_suffix(".json")
        self.processes: list[subprocess.Popen[bytes]] = []

    def _start(self) -> None:
        self.processes.append(start("canbusload", f"{INTERFACE}@{BITRATE_BPS}", output=self.log))
        with self.ours.open("wb") as file:
            self.processes.append(
                subprocess.Popen(
                    [sys.executable, "-m", "tools.cli", "bus", "load", "--measure", BUS,
                     f"--seconds={self.seconds:g}", "--json"], stdout=file,
                )
            )  # fmt: skip

    def progress(self, run: FlightRun) -> None:
        """Ask the flight to end once there is nothing to be heard for."""
        if self.processes and self.processes[1].poll() is not None:
            run.harness["asked_to_end"] = 1


def measured(seconds: float, log: Path) -> tuple[dict[str, Any], list[int]]:
    """A flight in real time heard by `bus load --measure`, and by canbusload in its last seconds.

    Before, while our command is still starting on the one processor, there is less to be heard.
    """
    both = UntilMeasured(seconds, log)
    summary = fly(time_max_s=MEASURED_MAX_S, pace=1.0, trigger=both)
    status = both.processes[1].poll()
    end(*both.processes)
    assert (summary["failure"], status) == ("", 0)
    percents = [int(p) for p in re.findall(r"(\d+)%", log.read_text("ascii"))]
    return json.loads(both.ours.read_text("ascii")), sorted(percents[-int(seconds) :])


def test_canbusload_and_the_worst_case_agree_with_our_measurement(tmp_path: Path) -> None:
    found, percents = measured(seconds=4.0, log=tmp_path / "load")
    ours = 100.0 * found["measured"]["load_ratio"]
    sent = {message.name for message in messages_of(FLOWN_LAW)}  # no other family's telemetry
    worst = 100.0 * sum(m["load_ratio"] for m in found["messages"] if m["message"] in sent)
    middle = percents[len(percents) // 2]
    print(f"worst case {worst:.2f} %, measured {ours:.2f} %, canbusload {percents} %")
    assert ours == pytest.approx(middle, abs=POINTS)
    assert worst - POINTS <= ours <= worst + 0.2


def test_canbusload_counts_foreign_traffic_as_we_do(tmp_path: Path) -> None:
    with running(("cangen", INTERFACE, "-g", "2", "-I", "5A5", "-L", "8")):
        found, percents = measured(seconds=4.0, log=tmp_path / "load")
    ours = 100.0 * found["measured"]["load_ratio"]
    print(f"measured {ours:.2f} %, canbusload {percents} %")
    assert ours > 100.0 * found["total_ratio"]
    assert ours == pytest.approx(percents[len(percents) // 2], abs=POINTS)


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    with open_bus(BUS, hears=identifiers_from("HARNESS")) as computer, open_bus(BUS) as harness:
        computer.settimeout(0.3)
        harness.settimeout(0.3)
        yield computer, harness


def heard_by(bus: socket.socket) -> list[int]:
    found = []
    try:
        while True:
            found.append(struct.unpack("<I", bus.recv(16)[:4])[0])
    except TimeoutError:
        return found


def test_the_kernel_keeps_out_what_the_other_side_does_not_send(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    computer, harness = pair
    for frame in ("020#00", "010#00", "5A5#00", "00000020#00", "020#R", "02F#"):
        cansend(frame)
    assert heard_by(computer) == [0x020, 0x02F]
    assert heard_by(harness) == [0x020, 0x010, 0x5A5, 0x80000020, 0x40000020, 0x02F]


def test_the_monitor_counts_and_decodes_a_flight() -> None:
    command = [sys.executable, "-m", "tools.cli", "bus", "monitor", BUS]
    command += [f"--seconds={MONITORED_S:g}", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as monitor:
        while f" {INTERFACE} " not in RECEIVERS.read_text("ascii"):
            assert monitor.poll() is None
            time.sleep(0.05)
        summary = fly(time_max_s=3.0)
        text, _ = monitor.communicate(timeout=END_S)
    messages = {m["message"]: m for m in json.loads(text)["messages"]}
    assert set(messages) <= set(icd.MESSAGES)
    for name in ("FSW_COMMAND", "NAV_TIME", "FSW_STATUS"):
        assert messages[name]["frames"] == summary["minor_frames"]
    assert messages["NAV_TIME"]["values"]["t_s"] == pytest.approx(3.0 - 0.02)
    assert sum(m["wrong_crc"] + m["sequence_breaks"] for m in messages.values()) == 0
