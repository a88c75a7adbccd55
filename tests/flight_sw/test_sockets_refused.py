"""What a bus that refuses frames makes of a burst: nothing lost, nothing in another order.

The C library's calls are replaced by ones that fail as told; that takes the interpreter, so a
compiled run of the suite asks a process of its own.
"""

import ctypes
import errno
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core import config

from flight_sw.can import sockets
from flight_sw.can.sockets import BUS_DOWN, BUS_LOST, new_io, recv_frames, send_frames
from flight_sw.records.dictionary import FRAME

N = 100
Send = Callable[..., int]
uncompiled_only = pytest.mark.skipif(not config.DISABLE_JIT, reason="runs uncompiled")


@pytest.mark.jit_only
def test_the_refusals_below_are_met_uncompiled() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(Path(__file__))],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stdout


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    yield ends
    for end in ends:
        end.close()


def failing(real: Send, codes: list[int], batch_max: int) -> Send:
    """A sendmmsg that moves at most a few frames and fails every second time while codes last."""
    calls = [0]

    def send(fd: int, messages: int, count: int, flags: int) -> int:
        calls[0] += 1
        if calls[0] % 2 == 0 and codes:
            ctypes.set_errno(codes.pop(0))
            return -1
        return real(fd, messages, min(count, batch_max), flags)

    return send


def numbered() -> Any:
    frames = np.zeros(N, FRAME)
    frames["can_id"], frames["dlc"] = np.arange(N), 8
    return frames


def received(end: socket.socket) -> list[int]:
    found: list[int] = []
    frames, io = np.zeros(64, FRAME), new_io()
    while (n := int(recv_frames(end.fileno(), io[0], frames, 64, 0))) > 0:
        found += [int(can_id) for can_id in frames["can_id"][:n]]
    return found


@uncompiled_only
@pytest.mark.parametrize("code", [errno.ENOBUFS, errno.EAGAIN, errno.EINTR])
@pytest.mark.parametrize("batch_max", [1, 7, 64])
def test_refusals_and_short_writes_lose_and_reorder_nothing(
    pair: tuple[socket.socket, socket.socket],
    monkeypatch: pytest.MonkeyPatch,
    code: int,
    batch_max: int,
) -> None:
    monkeypatch.setattr(sockets, "sendmmsg", failing(sockets.sendmmsg, [code] * 20, batch_max))
    assert send_frames(pair[0].fileno(), new_io()[0], numbered(), N) == N
    assert received(pair[1]) == list(range(N))


@uncompiled_only
def test_a_queue_that_stays_full_is_given_up_after_a_second(
    pair: tuple[socket.socket, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: int) -> int:
        ctypes.set_errno(errno.ENOBUFS)
        return -1

    monkeypatch.setattr(sockets, "sendmmsg", full)
    start_s = time.monotonic()
    assert send_frames(pair[0].fileno(), new_io()[0], numbered(), N) == 0
    assert time.monotonic() - start_s >= sockets.SEND_TIMEOUT_MS / 1e3


@uncompiled_only
@pytest.mark.parametrize(("code", "outcome"), [(errno.ENETDOWN, BUS_DOWN), (errno.ENXIO, BUS_LOST)])
def test_down_and_gone_are_told_apart(
    pair: tuple[socket.socket, socket.socket],
    monkeypatch: pytest.MonkeyPatch,
    code: int,
    outcome: int,
) -> None:
    def refuse(*_: int) -> int:
        ctypes.set_errno(code)
        return -1

    monkeypatch.setattr(sockets, "sendmmsg", refuse)
    monkeypatch.setattr(sockets, "recvmmsg", refuse)
    frames = numbered()
    assert send_frames(pair[0].fileno(), new_io()[0], frames, N) == outcome
    assert recv_frames(pair[0].fileno(), new_io()[0], frames, N, 100) == outcome
