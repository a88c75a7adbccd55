"""The hub: everybody hears everybody else, nobody waits for the slow, and it leaves no trace."""

import os
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flight_sw.can.address import open_bus
from flight_sw.can.sockets import BUS_LOST, new_io, recv_frames, send_frames
from flight_sw.errors import BusError
from flight_sw.records.dictionary import FRAME
from sim_harness.bus.hub import Hub
from sim_harness.bus.pump import (
    CLIENTS_MAX,
    OPEN,
    QUEUE_FRAMES,
    _deliver,
    _flush,
    new_buffers,
    new_hub,
    pump,
)

ROOT = Path(__file__).parents[2]
WAIT_S = 10.0
ALLOCATIONS = ("NRT_Allocate", "NRT_MemInfo_alloc")


class Client:
    """One connection with its own scratch."""

    def __init__(self, path: Path) -> None:
        self.socket = open_bus(f"unix:{path}")
        self.io = new_io()

    def send(self, frames: np.ndarray) -> int:
        return int(send_frames(self.socket.fileno(), self.io[0], frames, len(frames)))

    def receive(self, count: int, timeout_ms: int = 3000) -> np.ndarray:
        """`count` frames, or what came before the time-out or the end."""
        frames = np.zeros(count, FRAME)
        got = 0
        while got < count:
            room = frames[got:]
            n = recv_frames(self.socket.fileno(), self.io[0], room, len(room), timeout_ms)
            if n <= 0:
                break
            got += n
        return frames[:got]

    def is_lost(self, timeout_ms: int = 3000) -> bool:
        frames = np.zeros(1, FRAME)
        return recv_frames(self.socket.fileno(), self.io[0], frames, 1, timeout_ms) == BUS_LOST


def numbered(n: int, can_id: int = 0x100) -> np.ndarray:
    frames = np.zeros(n, FRAME)
    frames["can_id"] = can_id
    frames["dlc"] = 8
    frames["data"] = np.arange(n)
    return frames


def wait_until(claim: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + WAIT_S
    while not claim():
        assert time.monotonic() < deadline_s
        time.sleep(0.005)


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Hub]:
    with Hub(tmp_path / "bus") as running:
        yield running


def clients_of(hub: Hub, count: int) -> list[Client]:
    before = hub.stats.clients
    clients = [Client(hub.path) for _ in range(count)]
    wait_until(lambda: hub.stats.clients == before + count)
    return clients


def test_a_frame_reaches_every_client_but_its_sender_unchanged(hub: Hub) -> None:
    clients = clients_of(hub, 4)
    frames = numbered(1)
    frames["can_id"] = 0xE0000123
    frames["pad"], frames["res0"], frames["len8_dlc"] = 1, 2, 3
    frames["data"] = 0xFEDCBA9876543210
    clients[1].send(frames)
    for i in (0, 2, 3):
        assert clients[i].receive(1).tobytes() == frames.tobytes()
    assert len(clients[1].receive(1, 50)) == 0
    assert hub.stats.frames_received == 1
    wait_until(lambda: hub.stats.frames_sent == 3)  # counted once they are sent


def test_all_clients_hear_the_same_order(hub: Hub) -> None:
    clients = clients_of(hub, 4)
    senders = [
        threading.Thread(target=clients[i].send, args=(numbered(2000, can_id=i),)) for i in (0, 1)
    ]  # together fewer than fit into a queue
    for sender in senders:
        sender.start()
    heard = [clients[i].receive(4000) for i in (2, 3)]
    for sender in senders:
        sender.join()
    assert heard[0].tobytes() == heard[1].tobytes()
    for can_id in (0, 1):
        own = heard[0][heard[0]["can_id"] == can_id]
        assert own.tobytes() == numbered(2000, can_id).tobytes()


def test_a_client_that_does_not_read_delays_nobody_and_loses_only_its_own(hub: Hub) -> None:
    sender, sleeper, reader = clients_of(hub, 3)
    burst = QUEUE_FRAMES // 4
    count = 16 * burst
    frames = numbered(count)
    for start in range(0, count, burst):
        sent = frames[start : start + burst]
        assert sender.send(sent) == burst
        assert reader.receive(burst).tobytes() == sent.tobytes()
    wait_until(lambda: hub.stats.frames_received == count)
    dropped = hub.stats.frames_dropped
    assert 0 < dropped < count - QUEUE_FRAMES
    late = sleeper.receive(count - dropped)
    assert late.tobytes() == frames[: count - dropped].tobytes()
    assert len(sleeper.receive(1, 50)) == 0


def test_new_frames_wait_behind_queued_ones_even_if_the_socket_has_room() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    hub, queue, io = new_hub(), np.zeros(QUEUE_FRAMES, FRAME), new_io()
    client = hub["client"][0]
    client[0] = (ours.fileno(), OPEN, 1, 0)
    queue[0] = numbered(1, can_id=1)[0]
    _deliver(hub[0], queue, io[0], client[0], numbered(2, can_id=2), 2)
    with pytest.raises(BlockingIOError):
        theirs.recv(16, socket.MSG_DONTWAIT)
    _flush(hub[0], queue, io[0], client[0])
    assert [theirs.recv(16)[0] for _ in range(3)] == [1, 2, 2]
    assert hub["frames_sent"][0] == 3
    ours.close()
    theirs.close()


def test_a_client_that_wakes_up_hears_what_comes_next(hub: Hub) -> None:
    sender, sleeper = clients_of(hub, 2)
    assert sender.send(numbered(3 * QUEUE_FRAMES)) == 3 * QUEUE_FRAMES
    wait_until(lambda: hub.stats.frames_received == 3 * QUEUE_FRAMES)
    sleeper.receive(3 * QUEUE_FRAMES - hub.stats.frames_dropped)
    assert sender.send(numbered(5, can_id=7)) == 5
    assert sleeper.receive(5).tobytes() == numbered(5, can_id=7).tobytes()


@pytest.mark.parametrize("wrong", [b"x", b"x" * 15, b"x" * 17, b"x" * 72, b""])
def test_a_packet_that_is_no_frame_is_counted_and_not_passed_on(hub: Hub, wrong: bytes) -> None:
    sender, reader = clients_of(hub, 2)
    sender.socket.send(wrong)
    wait_until(lambda: hub.stats.packets_refused == 1)
    assert sender.send(numbered(1)) == 1
    assert reader.receive(1).tobytes() == numbered(1).tobytes()
    assert reader.io["wrong_size"][0] == 0
    assert hub.stats.clients == 2


def test_the_last_frames_of_a_client_that_leaves_are_delivered(hub: Hub) -> None:
    leaver, reader = clients_of(hub, 2)
    assert reader.send(numbered(3)) == 3  # unread there: its end is a reset
    assert leaver.send(numbered(100)) == 100
    leaver.socket.close()
    assert reader.receive(100).tobytes() == numbered(100).tobytes()
    wait_until(lambda: hub.stats.clients == 1)


def test_clients_come_and_go(hub: Hub) -> None:
    reader = clients_of(hub, 1)[0]
    for i in range(3 * CLIENTS_MAX):
        visitor = clients_of(hub, 1)[0]
        assert visitor.send(numbered(1, can_id=i)) == 1
        assert reader.receive(1)["can_id"][0] == i
        visitor.socket.close()
        wait_until(lambda: hub.stats.clients == 1)
    assert hub.stats.connections == 3 * CLIENTS_MAX + 1


def test_one_client_too_many_is_turned_away(hub: Hub) -> None:
    clients = clients_of(hub, CLIENTS_MAX)
    words: list[str] = []
    hub._tell = words.append
    with pytest.raises(BusError, match=f"unix:{hub.path}: has as many clients as it takes, 32 of"):
        Client(hub.path)
    assert words == [f"unix:{hub.path}: client 33, process {os.getpid()} was turned away"]
    assert hub.stats.clients_refused == 1
    assert clients[0].send(numbered(1)) == 1
    assert len(clients[-1].receive(1)) == 1


NOBODY = 65534
STRANGER = """
import os, sys
from flight_sw.can.address import open_bus
from flight_sw.errors import BusError
os.setgid(int(sys.argv[2]))
os.setuid(int(sys.argv[2]))
try:
    open_bus("unix:" + sys.argv[1])
except BusError as error:
    print(error)
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="only the superuser can be another user")
@pytest.mark.parametrize(
    ("mode", "words"),
    [(0o600, "no permission to connect"), (0o777, "belongs to another user")],
)
def test_another_user_is_turned_away_whatever_the_socket_permits(mode: int, words: str) -> None:
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        Path(folder).chmod(0o777)
        before = os.umask(0)
        try:
            hub = Hub(Path(folder) / "bus").start()
        finally:
            os.umask(before)
        try:
            assert stat.S_IMODE(hub.path.stat().st_mode) == 0o600
            hub.path.chmod(mode)
            done = subprocess.run(
                [sys.executable, "-c", STRANGER, str(hub.path), str(NOBODY)],
                cwd=ROOT, capture_output=True, text=True, check=False,
            )  # fmt: skip
            assert done.stdout == f"unix:{hub.path}: {words}\n", done.stderr
            assert hub.stats.clients_refused == (1 if mode == 0o777 else 0)
            clients_of(hub, 1)
        finally:
            hub.stop()


def test_stopping_ends_every_connection_and_removes_the_file(tmp_path: Path) -> None:
    hub = Hub(tmp_path / "bus").start()
    client = clients_of(hub, 1)[0]
    assert stat.S_ISSOCK(hub.path.stat().st_mode)
    hub.stop()
    hub.stop()
    assert client.is_lost()
    assert not hub.path.exists()
    assert client.send(numbered(1)) == BUS_LOST


def test_a_hub_can_be_started_again(tmp_path: Path) -> None:
    for _ in range(2):
        with Hub(tmp_path / "bus") as hub:
            a, b = clients_of(hub, 2)
            assert a.send(numbered(1)) == 1
            assert len(b.receive(1)) == 1


def test_no_descriptor_stays_open(tmp_path: Path) -> None:
    with Hub(tmp_path / "bus"):
        pass
    before = len(os.listdir("/proc/self/fd"))
    with Hub(tmp_path / "bus") as hub:
        for client in clients_of(hub, 3):
            client.socket.close()
    assert len(os.listdir("/proc/self/fd")) == before


def test_a_path_with_a_live_hub_is_refused_and_that_hub_lives_on(hub: Hub) -> None:
    with pytest.raises(BusError, match=f"{hub.path}: in use by another hub"):
        Hub(hub.path).start()
    wait_until(lambda: hub.stats.connections == 1 and hub.stats.clients == 0)  # its probe left
    a, b = clients_of(hub, 2)
    assert a.send(numbered(1)) == 1
    assert len(b.receive(1)) == 1


def test_the_socket_file_of_a_dead_hub_is_replaced(tmp_path: Path) -> None:
    dead = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    dead.bind(str(tmp_path / "bus"))
    dead.close()
    with Hub(tmp_path / "bus") as hub:
        clients_of(hub, 1)


def test_a_hub_removes_no_file_but_its_own(tmp_path: Path) -> None:
    hub = Hub(tmp_path / "bus").start()
    hub.path.unlink()
    hub.path.write_text("somebody else's")
    hub.stop()
    assert hub.path.read_text() == "somebody else's"


def test_a_hub_that_cannot_listen_says_why_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    sentences = {
        tmp_path / "file": "exists and is not a socket",
        tmp_path / "none" / "bus": f"folder {tmp_path / 'none'} does not exist",
        Path("/" + "x" * 107): "path of 108 bytes, a socket's has at most 107",
    }
    for path, sentence in sentences.items():
        with pytest.raises(BusError, match=f"{path}: {sentence}"):
            Hub(path).start()
    assert (tmp_path / "file").read_text() == "kept"


def test_a_folder_without_permission_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(socket.socket, "bind", refuse)
    with pytest.raises(BusError, match=f"no permission to create a socket in {tmp_path}"):
        Hub(tmp_path / "bus").start()


@pytest.mark.jit_only
def test_the_pump_allocates_nothing(fresh_compile: Callable[..., Any]) -> None:
    kernel = fresh_compile(pump, new_hub(), new_buffers(logged=True))
    text = kernel.inspect_asm(kernel.signatures[0])
    assert "sendmmsg" in text
    assert not [name for name in ALLOCATIONS if name in text]


@pytest.mark.jit_only
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_command_runs_a_hub_until_a_signal_and_tells_what_it_moved(
    tmp_path: Path, number: signal.Signals
) -> None:
    path = tmp_path / "bus"
    command = "import sys; from tools.commands.bus import app; app(['hub', sys.argv[1]])"
    with subprocess.Popen(
        [sys.executable, "-c", command, str(path)],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stderr is not None
        assert process.stderr.readline() == f"bus on {path}, Ctrl-C ends it\n"
        a, b = Client(path), Client(path)
        assert a.send(numbered(3)) == 3
        a.socket.send(b"x")
        assert a.send(numbered(4)) == 4
        if len(b.receive(7, 500)) < 7:  # sent before b was let in
            assert a.send(numbered(7)) == 7
            assert len(b.receive(7)) > 0
        process.send_signal(number)
        out, _ = process.communicate(timeout=WAIT_S)
        assert process.returncode == 0
    assert not path.exists()
    lines = [line.split("  ")[0] for line in out.splitlines()]
    assert lines == [
        "clients connected", "frames received", "frames delivered", "frames dropped",
        "packets refused", "clients refused",
    ]  # fmt: skip
    assert "clients connected  2\n" in out
    assert "packets refused    1  (not of 16 bytes)\n" in out
