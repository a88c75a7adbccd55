"""`aeroshell bus monitor`, `bus load --measure` and `bus up`, on a hub where they need a bus."""

import errno
import json
import re
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from flight_sw import icd
from flight_sw.can import address
from flight_sw.errors import BusError
from sim_harness.bus.hub import Hub
from sim_harness.bus.traffic import CAN_FRAME, Traffic
from tests.sim_harness.recordings import one_message
from tools import can_interface
from tools.commands.bus import app
from tools.monitor import values_text

RUN = CliRunner()
POSITION = {"lon_rad": 1.5, "lat_rad": -0.25}


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Hub]:
    with Hub(tmp_path / "bus") as running:
        yield running


def packets(message: str, count: int, values: dict[str, float]) -> list[bytes]:
    rows = one_message(message, [values] * count)
    return [row["frame"].tobytes() for row in rows]


@contextmanager
def sending(hub: Hub, frames: list[bytes], rate_hz: float) -> Iterator[None]:
    """Frames over and over at a rate, from when a second client is there."""
    over = threading.Event()

    def send() -> None:
        with address.open_bus(f"unix:{hub.path}") as bus:
            while hub.stats.clients < 2 and not over.is_set():
                time.sleep(0.01)
            start_s = time.monotonic()
            for number in range(1 << 30):
                if over.wait(max(0.0, start_s + number / rate_hz - time.monotonic())):
                    return
                bus.send(frames[number % len(frames)])

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def test_traffic_counts_what_a_receiver_would_refuse() -> None:
    traffic = Traffic()
    good = packets("NAV_POSITION", 3, POSITION)
    harmed = good[1][:15] + bytes([good[1][15] ^ 1])
    short = good[2][:4] + b"\x07" + good[2][5:]
    for packet in (good[0], harmed, short, good[2], CAN_FRAME.pack(0x123, 2, bytes(8))):
        traffic.take(packet)
    traffic.take(CAN_FRAME.pack(0x20000004, 8, bytes((0, 0, 0, 0, 0, 0, 96, 7))))
    ours, foreign = traffic.heard[0x020], traffic.heard[0x123]
    assert (ours.frames, ours.wrong_crc, ours.wrong_length, ours.sequence_breaks) == (4, 1, 1, 1)
    assert ours.values() == pytest.approx(POSITION, abs=1e-7)
    assert (foreign.name, foreign.data, foreign.errors) == ("", b"\0\0", 0)
    assert (traffic.frames, traffic.errors.frames, traffic.errors.counters) == (5, 1, (96, 7))
    assert traffic.bits == 3 * 135 + 125 + 75  # 55 + 10n [DAVIS07]


def test_an_extended_frame_takes_80_and_ten_bits_a_byte() -> None:
    traffic = Traffic()
    traffic.take(CAN_FRAME.pack(0x80000020, 8, bytes(8)))
    traffic.take(CAN_FRAME.pack(0x40000020, 8, bytes(8)))  # a remote frame carries no data
    assert traffic.heard[0x80000020].can_id == "0x00000020"
    assert (traffic.heard[0x80000020].bits, traffic.heard[0x020].bits) == (160, 55)


def test_the_monitor_tells_rate_values_and_foreign_frames_as_json(hub: Hub) -> None:
    frames = packets("NAV_POSITION", 16, POSITION)
    with sending(hub, frames, rate_hz=100.0):
        result = RUN.invoke(app, ["monitor", f"unix:{hub.path}", "--seconds", "1.5", "--json"])
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    (row,) = found["messages"]
    assert (row["message"], row["sender"], row["can_id"]) == ("NAV_POSITION", "HARNESS", "0x020")
    assert row["values"] == pytest.approx(POSITION, abs=1e-7)
    assert row["rate_hz"] == pytest.approx(100.0, rel=0.2)
    assert found["load_ratio"] == pytest.approx(100 * 135 / 1e6, rel=0.2)
    assert (row["wrong_crc"], row["sequence_breaks"], found["frames_dropped"]) == (0, 0, 0)


def test_the_monitor_shows_a_table(hub: Hub) -> None:
    frames = [*packets("FSW_STATUS", 1, {"mode": 2}), CAN_FRAME.pack(0x5A5, 2, b"\xab\xcd" * 4)]
    with sending(hub, frames, rate_hz=50.0):
        result = RUN.invoke(
            app, ["monitor", f"unix:{hub.path}", "--seconds", "1"], env={"COLUMNS": "160"}
        )
    assert result.exit_code == 0
    for word in ("FSW_STATUS", "mode ENTRY", "(foreign)", "ab cd", "error frames"):
        assert word in result.stdout


def test_the_measured_load_stands_beside_the_worst_case(hub: Hub) -> None:
    frames = packets("NAV_TIME", 16, {"t_s": 1.0})
    with sending(hub, frames, rate_hz=50.0):
        arguments = ["load", "--measure", f"unix:{hub.path}", "--seconds", "1.5"]
        told = json.loads(RUN.invoke(app, [*arguments, "--json"]).stdout)
        table = RUN.invoke(app, arguments, env={"COLUMNS": "160"})
    worst = next(m for m in told["messages"] if m["message"] == "NAV_TIME")["load_ratio"]
    assert told["measured"]["load_ratio"] == pytest.approx(worst, rel=0.2)
    assert table.exit_code == 0
    assert re.search(r"\d\.\d\d % measured on unix:", table.stdout)


def test_a_bus_that_ends_or_is_not_there_is_told(hub: Hub) -> None:
    stopping = threading.Timer(0.5, hub.stop)
    stopping.start()
    result = RUN.invoke(app, ["monitor", f"unix:{hub.path}", "--seconds", "20", "--json"])
    stopping.join()
    assert isinstance(result.exception, BusError)
    assert str(result.exception) == f"unix:{hub.path}: the bus has ended"
    missing = RUN.invoke(app, ["load", "--measure", f"unix:{hub.path}x"])
    assert isinstance(missing.exception, BusError)


@pytest.fixture
def interfaces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A tree like the system's, without interfaces."""
    monkeypatch.setattr(can_interface, "INTERFACES", tmp_path)
    monkeypatch.setattr(can_interface.shutil, "which", lambda _: "ip")
    return tmp_path


def put_interface(tree: Path, name: str, flags: int, arp_type: int = 280) -> None:
    (tree / name).mkdir(exist_ok=True)
    (tree / name / "flags").write_text(f"0x{flags:x}\n", "ascii")
    (tree / name / "type").write_text(f"{arp_type}\n", "ascii")


def answers(monkeypatch: pytest.MonkeyPatch, tree: Path, refusal: str) -> list[str]:
    """`ip` as it would answer; what it was asked."""
    asked: list[str] = []

    def run(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        asked.append(" ".join(command))
        if not refusal:
            put_interface(tree, "vcan7", flags=1 if command[-1] == "up" else 0)
        return subprocess.CompletedProcess(command, 2 if refusal else 0, "", refusal)

    monkeypatch.setattr(can_interface.subprocess, "run", run)
    return asked


def test_up_makes_and_raises_a_virtual_interface(
    interfaces: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = answers(monkeypatch, interfaces, refusal="")
    result = RUN.invoke(app, ["up", "vcan7"])
    assert (result.exit_code, result.stdout) == (0, "vcan7 is up: --bus socketcan:vcan7\n")
    assert asked == ["ip link add dev vcan7 type vcan", "ip link set vcan7 up"]
    again = RUN.invoke(app, ["up", "vcan7"])
    assert (again.exit_code, again.stdout) == (0, "vcan7 is up already\n")


def test_up_prints_the_commands_where_it_may_not(
    interfaces: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers(monkeypatch, interfaces, "RTNETLINK answers: Operation not permitted\n")
    result = RUN.invoke(app, ["up", "vcan7"])
    assert result.exit_code == 1
    assert result.stdout.splitlines() == [
        "sudo modprobe vcan",
        "sudo ip link add dev vcan7 type vcan",
        "sudo ip link set vcan7 up",
    ]
    assert "vcan7 could not be raised: Operation not permitted." in result.stderr


def test_up_tells_how_hardware_is_raised(interfaces: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put_interface(interfaces, "can0", flags=0)
    answers(monkeypatch, interfaces, "RTNETLINK answers: Operation not permitted\n")
    result = RUN.invoke(app, ["up", "can0"])
    assert (result.exit_code, result.stdout.splitlines()) == (1, [
        "sudo ip link set can0 type can bitrate 1000000",
        "sudo ip link set can0 up",
    ])  # fmt: skip


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("can3", "can3: no such interface"),
        ("eth0", "eth0: is an interface already, and not of CAN"),
        ("a/b", "interface 'a/b': allowed are"),
        ("vcan0123456789ab", "allowed are 1 to 15"),
    ],
)
def test_up_refuses_what_it_cannot_raise(interfaces: Path, name: str, sentence: str) -> None:
    put_interface(interfaces, "eth0", flags=1, arp_type=1)
    result = RUN.invoke(app, ["up", name])
    assert isinstance(result.exception, BusError)
    assert sentence in str(result.exception)


@pytest.mark.parametrize(
    ("code", "sentence"),
    [
        (errno.EAFNOSUPPORT, "this kernel has no CAN sockets, load them with `modprobe can-raw`"),
        (errno.EPERM, "no permission to open CAN sockets, run as root or with CAP_NET_RAW"),
    ],
)
def test_a_can_socket_that_is_not_granted_is_told(
    monkeypatch: pytest.MonkeyPatch, code: int, sentence: str
) -> None:
    def refuse(*_: Any) -> None:
        raise OSError(code, "refused")

    monkeypatch.setattr(address.socket, "socket", refuse)
    with pytest.raises(BusError) as refusal:
        address.open_bus("socketcan:can0")
    assert str(refusal.value) == f"socketcan:can0: {sentence}"


def test_filters_name_each_identifier_of_the_other_side_once_and_exactly() -> None:
    ours = address.identifiers_from("HARNESS")
    assert ours == tuple(m.can_id for m in icd.LAYOUT if m.sender == "HARNESS")
    raw = address.can_filters(ours)
    found = [address.CAN_FILTER.unpack_from(raw, at) for at in range(0, len(raw), 8)]
    assert found == [(can_id, 0xC00007FF) for can_id in ours]


def test_a_unix_socket_drops_nothing() -> None:
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    assert [address.frames_dropped(end) for end in ends] == [0, 0]
    for end in ends:
        end.close()


def test_a_checksum_is_shown_as_its_bytes_and_no_value_with_an_exponent() -> None:
    traffic = Traffic()
    traffic.take(packets("FSW_LOAD", 1, {"computer": 5, "load_crc32": 0x8F00C2AB})[0])
    shown = values_text(next(iter(traffic.heard.values())))
    assert "load_crc32 0x8f00c2ab" in shown and "computer" in shown
    traffic.take(packets("NAV_POSITION", 1, POSITION)[0])
    assert "e-" not in values_text(traffic.heard[0x020])


def test_the_monitor_tells_error_frames_in_words(hub: Hub) -> None:
    frames = [CAN_FRAME.pack(0x20000060, 8, bytes((0, 0, 0, 0, 0, 0, 255, 7)))]
    with sending(hub, frames, rate_hz=50.0):
        arguments = ["monitor", f"unix:{hub.path}", "--seconds", "1"]
        table = RUN.invoke(app, arguments, env={"COLUMNS": "160"})
        told = json.loads(RUN.invoke(app, [*arguments, "--json"]).stdout)
    words = " ".join(table.stdout.split())
    assert "bus off, no acknowledgement; counters 255 sending, 7 receiving" in words
    assert told["bus_errors"] == ["bus off", "no acknowledgement"]
    assert told["error_frames"] == told["bus_off"] > 0
