"""Frames through real sockets: whole, in order, none lost, and the end of a bus noticed."""

import ctypes
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flight_sw.can import sockets
from flight_sw.can.address import open_bus
from flight_sw.can.codec import build_codec
from flight_sw.can.libc import MMSGHDR, monotonic_ns, sleep_until_ns
from flight_sw.can.sockets import BUS_LOST, new_io, recv_frames, send_frames
from flight_sw.errors import BusError
from flight_sw.icd import N_VALUES
from flight_sw.reception.receiver import RX_STATE, judge
from flight_sw.records.dictionary import FRAME

ALLOCATIONS = ("NRT_Allocate", "NRT_MemInfo_alloc")
Pair = tuple[socket.socket, socket.socket]


@pytest.fixture
def pair() -> Iterator[Pair]:
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    yield ends
    for end in ends:
        end.close()


def numbered(n: int) -> np.ndarray:
    frames = np.zeros(n, FRAME)
    frames["can_id"] = np.arange(n) % 0x800
    frames["dlc"] = 8
    frames["data"] = np.arange(n, dtype=np.uint64) * np.uint64(0x0101_0101_0101)
    return frames


def send(end: socket.socket, frames: np.ndarray, io: np.ndarray | None = None) -> int:
    scratch = new_io() if io is None else io
    return int(send_frames(end.fileno(), scratch[0], frames, len(frames)))


def receive(
    end: socket.socket, capacity: int, timeout_ms: int = 0, io: np.ndarray | None = None
) -> tuple[int, np.ndarray]:
    scratch = new_io() if io is None else io
    frames = np.zeros(capacity, FRAME)
    n = int(recv_frames(end.fileno(), scratch[0], frames, capacity, timeout_ms))
    return n, frames[: max(n, 0)]


def receive_all(end: socket.socket, count: int) -> np.ndarray:
    got: list[np.ndarray] = []
    while sum(map(len, got)) < count:
        n, frames = receive(end, 64, 2000)
        assert n > 0
        got.append(frames)
    return np.concatenate(got)


def test_mmsghdr_is_laid_out_as_in_c() -> None:
    assert MMSGHDR.itemsize == 64
    assert MMSGHDR.fields is not None
    assert MMSGHDR.fields["size"][1] == 56
    assert FRAME.itemsize == 16


def test_a_packet_is_one_can_frame_byte_for_byte(pair: Pair) -> None:
    frames = numbered(1)
    frames["can_id"] = 0x123
    frames["data"] = 0x0807060504030201
    assert send(pair[0], frames) == 1
    assert pair[1].recv(100) == bytes.fromhex("23010000 08000000 0102030405060708")


def test_frames_arrive_in_order_whatever_the_batch(pair: Pair) -> None:
    frames = numbered(150)
    assert send(pair[0], frames) == 150
    assert receive(pair[1], 10)[1].tobytes() == frames[:10].tobytes()
    assert receive(pair[1], 200)[1].tobytes() == frames[10:74].tobytes()
    assert receive(pair[1], 200)[1].tobytes() == frames[74:138].tobytes()
    assert receive(pair[1], 200)[1].tobytes() == frames[138:].tobytes()
    assert receive(pair[1], 200)[0] == 0


def test_a_full_socket_delays_frames_but_loses_none(pair: Pair) -> None:
    frames = numbered(20_000)
    sent: list[int] = []
    sender = threading.Thread(target=lambda: sent.append(send(pair[0], frames)))
    sender.start()
    time.sleep(0.05)
    assert not sent
    got = receive_all(pair[1], len(frames))
    sender.join()
    assert sent == [len(frames)]
    assert got.tobytes() == frames.tobytes()


def test_a_bus_that_takes_nothing_ends_the_wait_and_says_how_many_went(pair: Pair) -> None:
    frames = numbered(20_000)
    start_s = time.monotonic()
    sent = send(pair[0], frames)
    waited_s = time.monotonic() - start_s
    assert 0 < sent < len(frames)
    assert 0.9 <= waited_s < 5.0  # a second each time that nothing goes, and that is once
    assert receive_all(pair[1], sent).tobytes() == frames[:sent].tobytes()


def waits_s(end: socket.socket, timeout_ms: int) -> list[float]:
    """How long some receptions of nothing took: a busy machine may hold up any of them."""
    took_s = []
    for _ in range(5):
        start_s = time.monotonic()
        assert receive(end, 8, timeout_ms)[0] == 0
        took_s.append(time.monotonic() - start_s)
    return took_s


def test_no_waiting_with_a_timeout_of_zero(pair: Pair) -> None:
    receive(pair[1], 8)
    assert min(waits_s(pair[1], 0)) < 0.05


def test_a_timeout_is_kept(pair: Pair) -> None:
    assert 0.06 <= min(waits_s(pair[1], 60)) < 0.5


def test_a_frame_ends_the_wait(pair: Pair) -> None:
    frames = numbered(1)
    threading.Timer(0.05, lambda: send(pair[0], frames)).start()
    start_s = time.monotonic()
    assert receive(pair[1], 8, 5000)[0] == 1
    assert time.monotonic() - start_s < 2.0


def test_signals_shorten_no_wait_and_cost_no_frame(pair: Pair) -> None:
    before = signal.signal(signal.SIGUSR1, lambda *_: None)
    found: list[tuple[int, float]] = []

    def wait() -> None:
        start_s = time.monotonic()
        n, _ = receive(pair[1], 8, 300)
        found.append((n, time.monotonic() - start_s))

    try:
        for frames in (0, 1):
            waiter = threading.Thread(target=wait)
            waiter.start()
            for _ in range(10):
                time.sleep(0.01)
                signal.pthread_kill(waiter.ident or 0, signal.SIGUSR1)
            if frames:
                send(pair[0], numbered(1))
            waiter.join()
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert [n for n, _ in found] == [0, 1]
    assert found[0][1] >= 0.3


@pytest.mark.parametrize("wrong", [b"", b"x", b"x" * 15, b"x" * 17, b"x" * 72])
def test_a_packet_that_is_no_frame_is_counted_and_dropped(pair: Pair, wrong: bytes) -> None:
    frames = numbered(2)
    io = new_io()
    pair[0].send(wrong)
    assert receive(pair[1], 8, 20, io)[0] == 0
    pair[0].send(frames[:1].tobytes())
    pair[0].send(wrong)
    pair[0].send(frames[1:].tobytes())
    n, got = receive(pair[1], 8, 1000, io)
    assert (n, got.tobytes()) == (2, frames.tobytes())
    assert receive(pair[1], 8, 0, io)[0] == 0
    assert io["wrong_size"][0] == (2 if wrong else 1)  # an empty one among frames is passed over


def test_the_end_of_a_bus_comes_after_its_last_frames(pair: Pair) -> None:
    frames = numbered(70)
    assert send(pair[0], frames) == 70
    pair[0].close()
    io = new_io()
    assert receive(pair[1], 64, 100, io)[0] == 64
    assert receive(pair[1], 64, 100, io)[0] == 6
    start_s = time.monotonic()
    assert receive(pair[1], 64, 5000, io)[0] == BUS_LOST
    assert receive(pair[1], 64, 0, io)[0] == BUS_LOST
    assert time.monotonic() - start_s < 1.0
    assert io["wrong_size"][0] == 0


def test_an_end_that_left_frames_unread_still_delivers_its_own(pair: Pair) -> None:
    frames = numbered(3)
    send(pair[1], frames)
    send(pair[0], frames)
    pair[0].close()  # frames lie unread there: a reset
    assert receive(pair[1], 8, 100)[1].tobytes() == frames.tobytes()
    assert receive(pair[1], 8, 100)[0] == BUS_LOST


def test_an_end_while_waiting_is_noticed_at_once(pair: Pair) -> None:
    threading.Timer(0.05, lambda: pair[0].shutdown(socket.SHUT_RDWR)).start()
    start_s = time.monotonic()
    assert receive(pair[1], 8, 5000)[0] == BUS_LOST
    assert time.monotonic() - start_s < 2.0


def test_sending_to_a_bus_that_ended_says_so_without_a_signal(pair: Pair) -> None:
    signals: list[int] = []
    before = signal.signal(signal.SIGPIPE, lambda number, _: signals.append(number))
    try:
        pair[1].close()
        assert send(pair[0], numbered(3)) == BUS_LOST
        time.sleep(0.01)
    finally:
        signal.signal(signal.SIGPIPE, before)
    assert not signals


def test_a_closed_descriptor_is_a_lost_bus(pair: Pair) -> None:
    io, frames = new_io(), numbered(1)
    number = os.dup(pair[0].fileno())
    os.close(number)
    assert recv_frames(number, io[0], frames, 1, 10) == BUS_LOST
    assert recv_frames(number, io[0], frames, 1, 0) == BUS_LOST
    assert send_frames(number, io[0], frames, 1) == BUS_LOST


def test_a_full_queue_of_the_interface_is_tried_again() -> None:
    io = new_io()
    start_ns = time.monotonic_ns()
    assert sockets._wait_for_room(-1, io[0], sockets.ENOBUFS, 1_000_000)
    assert time.monotonic_ns() - start_ns >= sockets.FULL_QUEUE_PAUSE_NS
    assert sockets._wait_for_room(-1, io[0], sockets.EINTR, 1_000_000)


def test_the_clock_is_the_systems_monotonic_clock() -> None:
    before_ns = time.monotonic_ns()
    now_ns = monotonic_ns()
    assert before_ns <= now_ns <= time.monotonic_ns()


def test_sleep_ends_at_its_deadline() -> None:
    deadline_ns = time.monotonic_ns() + 20_000_000
    assert sleep_until_ns(deadline_ns) == 0
    assert deadline_ns <= time.monotonic_ns() < deadline_ns + 500_000_000
    assert sleep_until_ns(time.monotonic_ns() - 5_000_000_000) == 0


def stream_socket(path: Path) -> socket.socket:
    one = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    one.bind(str(path))
    one.listen()
    return one


def test_a_bus_that_cannot_be_opened_is_told_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    dead = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    dead.bind(str(tmp_path / "dead"))
    dead.close()
    sentences = {
        f"unix:{tmp_path}/none": "does not exist, start a hub there first",
        f"unix:{tmp_path}/file": "is not a socket",
        f"unix:{tmp_path}/dead": "nobody listens there, its hub has ended",
        f"unix:{tmp_path}/stream": "is a socket of another kind, allowed is a seqpacket hub",
        f"unix:/{'x' * 107}": "path of 108 bytes, a socket's has at most 107",
        "unix:": "allowed are unix:PATH and socketcan:INTERFACE",
        "unix": "allowed are unix:PATH and socketcan:INTERFACE",
        "tcp:localhost": "allowed are unix:PATH and socketcan:INTERFACE",
        "socketcan:none0": "no such interface|this kernel has no CAN sockets",
    }
    with stream_socket(tmp_path / "stream"):
        for address, sentence in sentences.items():
            with pytest.raises(BusError, match=sentence) as refusal:
                open_bus(address)
            assert address in str(refusal.value)
            assert "\n" not in str(refusal.value)


def test_a_socket_without_permission_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    with pytest.raises(BusError, match="unix:/x: no permission to connect"):
        open_bus("unix:/x")


@pytest.mark.jit_only
def test_nothing_allocates_between_socket_and_values(fresh_compile: Callable[..., Any]) -> None:
    codec, rx, io = build_codec(), np.zeros(1, RX_STATE), new_io()
    frames, values = np.zeros(8, FRAME), np.zeros(N_VALUES)
    compiled = {
        "recvmmsg": fresh_compile(recv_frames, 0, io[0], frames, 8, 0),
        "sendmmsg": fresh_compile(send_frames, 0, io[0], frames, 8),
        "": fresh_compile(judge, codec[0], rx[0], frames[0], values),
    }
    for call, kernel in compiled.items():
        text = kernel.inspect_asm(kernel.signatures[0])
        assert call in text
        assert not [name for name in ALLOCATIONS if name in text]


@pytest.mark.jit_only
def test_another_process_finds_the_kernels_compiled(tmp_path: Path) -> None:
    program = (
        "import socket, numpy as np\n"
        "from flight_sw.can import sockets\n"
        "from flight_sw.records.dictionary import FRAME\n"
        "a, b = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)\n"
        "io, frames = sockets.new_io(), np.zeros(4, FRAME)\n"
        "print(sockets.send_frames(a.fileno(), io[0], frames, 4), end=' ')\n"
        "print(sockets.recv_frames(b.fileno(), io[0], frames, 4, 10), end=' ')\n"
        "kernels = (sockets.send_frames, sockets.recv_frames)\n"
        "print(sum(sum(k.stats.cache_hits.values()) for k in kernels))\n"
    )
    environment = {**os.environ, "AEROSHELL_CACHE_DIR": str(tmp_path)}
    outputs = [
        subprocess.run(
            [sys.executable, "-c", program],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
            cwd=Path(__file__).parents[2],
        ).stdout.split()
        for _ in range(2)
    ]
    assert outputs == [["4", "4", "0"], ["4", "4", "2"]]


def test_the_scratch_points_into_itself() -> None:
    io = new_io(4)
    base, size = io.ctypes.data, io.dtype.itemsize
    for address in (*io["iov"][0]["base"], *io["messages"][0]["iov"], *io["pollfd_address"]):
        assert base <= int(address) < base + size
    assert ctypes.sizeof(ctypes.c_void_p) == 8
