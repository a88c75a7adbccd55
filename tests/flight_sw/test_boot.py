"""Boot: the announcement, refusals in one sentence, and an end with a report."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import cantools
import numpy as np
import pytest

from flight_sw import icd
from flight_sw.boot import COMPILING, READY, Announcer, boot_frame
from flight_sw.can.codec import build_codec
from flight_sw.can.receiver import OK, RX_STATE, judge
from flight_sw.dictionary import FRAME
from flight_sw.guidance import LAWS
from sim_harness.bus.hub import Hub
from tests.system.flights import ROOT, built

TIMEOUT_S = 60.0


@pytest.mark.parametrize("law", list(LAWS))
@pytest.mark.parametrize("state", [COMPILING, READY])
@pytest.mark.parametrize("counter", [0, 7, 15, 16, 33])
def test_the_announcement_is_what_receiver_and_cantools_read(
    law: str, state: int, counter: int
) -> None:
    raw = boot_frame(0xDEADBEEF, law, state, counter)
    frame = np.frombuffer(raw, FRAME)
    rx = np.zeros(1, RX_STATE)
    rx["sender"] = icd.NODES.index("FSW")
    values = np.zeros(icd.N_VALUES)
    slot, verdict = judge(build_codec()[0], rx[0], frame[0], values)
    assert (icd.MESSAGES[slot], verdict) == ("FSW_BOOT", OK)
    database = cantools.database.load_file(icd.DBC_PATH)
    told = database.decode_message("FSW_BOOT", raw[8:], decode_choices=False)
    assert told["load_crc32"] == 0xDEADBEEF
    assert told["law"] == list(LAWS).index(law)
    assert told["state"] == state
    assert told["e2e_counter"] == counter % 16


def test_the_announcer_repeats_itself_until_it_is_left() -> None:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    far.settimeout(5.0)
    with near, far:
        with Announcer(near, built("lqy").image) as announcer:
            frames = [np.frombuffer(far.recv(64), FRAME)[0] for _ in range(3)]
            announcer.state = READY
        assert [int(f["data"]) >> 8 & 0xF for f in frames] == [0, 1, 2]
        assert {int(f["can_id"]) for f in frames} == {icd.layout("FSW_BOOT").can_id}
        assert threading.active_count() == threading.active_count()


def test_an_announcement_that_nobody_hears_is_no_error() -> None:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    far.close()
    with near:
        Announcer(near, built("lqy").image).announce()


def computer(load: Path, bus: str) -> subprocess.Popen[str]:
    """`python -m flight_sw`."""
    return subprocess.Popen(
        [sys.executable, "-m", "flight_sw", "--load", str(load), "--bus", bus],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )


def refusal(load: Path, bus: str) -> str:
    """What a flight computer says that does not start."""
    process = computer(load, bus)
    out, err = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 1
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("flight computer: ")
    return line


def spoilt(kind: str, raw: bytes) -> bytes:
    """A load image with one thing wrong."""
    if kind == "truncated":
        return raw[:1000]
    if kind == "bit flipped":
        return raw[:5000] + bytes([raw[5000] ^ 8]) + raw[5001:]
    if kind == "empty":
        return b""
    return b"not a load image at all, but long enough to hold one's header" * 4


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("truncated", "1000 bytes, its header says"),
        ("bit flipped", "crc32 is 0x"),
        ("empty", "0 bytes that do not begin with AEROLOAD: not a load image"),
        ("text", "do not begin with AEROLOAD"),
    ],
)
def test_a_bad_load_is_refused_in_one_sentence(kind: str, words: str, tmp_path: Path) -> None:
    load = tmp_path / "bad.load"
    load.write_bytes(spoilt(kind, built("lqy").raw))
    line = refusal(load, "unix:nowhere")
    assert f"{load}: " in line
    assert words in line


def test_a_load_that_is_not_there_is_named(tmp_path: Path) -> None:
    line = refusal(tmp_path / "none.load", "unix:nowhere")
    assert "none.load: cannot be read (No such file or directory)" in line


@pytest.mark.parametrize(
    ("bus", "words"),
    [
        ("unix:{}/none", "does not exist, start a hub there first"),
        ("carrier-pigeon", "allowed are unix:PATH and socketcan:INTERFACE"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_named(bus: str, words: str, tmp_path: Path) -> None:
    load = tmp_path / "good.load"
    load.write_bytes(built("lqy").raw)
    assert words in refusal(load, bus.format(tmp_path))


@pytest.mark.parametrize("arguments", [[], ["--load", "x"], ["--bus", "unix:x"], ["--nonsense"]])
def test_wrong_usage_ends_with_two(arguments: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "flight_sw", *arguments], capture_output=True, cwd=ROOT, check=False
    )
    assert done.returncode == 2
    assert b"usage: python -m flight_sw" in done.stderr


@pytest.mark.jit_only
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_its_report(number: signal.Signals, tmp_path: Path) -> None:
    load = tmp_path / "good.load"
    load.write_bytes(built("lqy").raw)
    with Hub(tmp_path / "bus"):
        process = computer(load, f"unix:{tmp_path / 'bus'}")
        wait_until_ready(tmp_path / "bus")
        process.send_signal(number)
        out, err = process.communicate(timeout=TIMEOUT_S)
    assert (process.returncode, [x for x in err.splitlines() if "compiling" not in x]) == (0, [])
    report = json.loads(out)
    assert (report["law"], report["cycles"], report["mode"]) == ("lqy", 0, 0)


@pytest.mark.jit_only
def test_a_lost_bus_ends_it_with_its_report_and_a_sentence(tmp_path: Path) -> None:
    load = tmp_path / "good.load"
    load.write_bytes(built("lqy").raw)
    with Hub(tmp_path / "bus"):
        process = computer(load, f"unix:{tmp_path / 'bus'}")
        wait_until_ready(tmp_path / "bus")
    out, err = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 1
    assert json.loads(out)["cycles"] == 0
    assert err.splitlines()[-1].endswith("/bus: the bus was lost after 0 cycles")


def wait_until_ready(path: Path) -> None:
    """Listen until a computer announces that it is ready."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as ear:
        ear.settimeout(TIMEOUT_S)
        ear.connect(str(path))
        state = COMPILING
        while state != READY:
            state = int.from_bytes(ear.recv(64)[8:], "little") >> 44 & 0xF
