"""Boot: the announcement, refusals in one sentence, and an end with a report."""

import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import cantools
import numpy as np
import pytest

from flight_sw import icd
from flight_sw.announcer import ARMED, COMPILING, READY, Announcer, boot_frames
from flight_sw.can.address import open_bus
from flight_sw.can.codec import build_codec
from flight_sw.can.plain import CAN_FRAME, checksum, plain_frame, read_plain
from flight_sw.guidance import LAWS, NUMBERS
from flight_sw.reception.receiver import OK, RX_STATE, judge
from flight_sw.records.dictionary import FRAME
from flight_sw.runtime.identity import SOURCES, sources_sha256
from sim_harness.bus.hub import Hub
from tests.system.flights import ROOT, built

TIMEOUT_S = 60.0
REQUEST = {"computer": 1, "harness": 1, "request": 1}


def kernel_reads(raw: bytes) -> tuple[str, int, dict[str, int]]:
    """Message, verdict and values of a frame, as the compiled receiver has them."""
    rx, values = np.zeros(1, RX_STATE), np.zeros(icd.N_VALUES)
    rx["sender"] = icd.NODES.index("FSW")
    slot, verdict = judge(build_codec()[0], rx[0], np.frombuffer(raw, FRAME)[0], values)
    name = icd.MESSAGES[slot]
    found = {s: int(values[icd.value_index(name, s)]) for s in icd.signal_names(name)}
    return name, verdict, found


@pytest.mark.parametrize("law", list(LAWS))
@pytest.mark.parametrize("state", [COMPILING, READY, ARMED])
@pytest.mark.parametrize("counter", [0, 7, 15, 16, 33])
def test_the_announcement_is_what_receiver_and_cantools_read(
    law: str, state: int, counter: int
) -> None:
    image = built("lqy").image._replace(law=law, crc32=0xDEADBEEF)
    wanted = {
        "FSW_BOOT": {
            "computer": 0x5A5A5, "state": state, "law": NUMBERS[law], "sources": SOURCES,
        },
        "FSW_LOAD": {"computer": 0x5A5A5, "load_crc32": 0xDEADBEEF},
    }  # fmt: skip
    database = cantools.database.load_file(icd.DBC_PATH)
    for raw, (name, values) in zip(
        boot_frames(0x5A5A5, image, state, counter), wanted.items(), strict=True
    ):
        assert kernel_reads(raw) == (name, OK, values)
        told = database.decode_message(name, raw[8:], decode_choices=False)
        assert {key: told[key] for key in values} == values
        assert told["e2e_counter"] == counter % 16
        read = read_plain(raw)
        assert read is not None
        assert (read.message.name, read.raw) == (name, values)


@pytest.mark.parametrize("bit", range(64))
def test_an_announcement_with_one_wrong_bit_is_not_read(bit: int) -> None:
    for raw in boot_frames(0x5A5A5, built("lqy").image, READY, 9):
        spoilt = int.from_bytes(raw[8:], "little") ^ 1 << bit
        assert read_plain(raw[:8] + spoilt.to_bytes(8, "little")) is None


def test_what_is_out_of_range_or_set_where_nothing_stands_is_not_read() -> None:
    nobody = plain_frame("FSW_BOOT", {"computer": 0, "state": 1, "law": 1, "sources": 1}, 0)
    assert read_plain(nobody) is None
    word = int.from_bytes(plain_frame("GROUND_REQUEST", REQUEST, 0)[8:], "little") | 1 << 63
    message = icd.layout("GROUND_REQUEST")
    word = word & ~0xFF | checksum(message, word)
    assert read_plain(CAN_FRAME.pack(message.can_id, 8, word)) is None


def test_the_hash_of_the_sources_follows_each_of_them(tmp_path: Path) -> None:
    files = {"a.py": b"1", "icd/b.dbc": b"2", "c.txt": b"3"}
    hashes = []
    for spoilt in (None, *files):
        root = tmp_path / f"{spoilt}" / "flight_sw"
        for name, content in files.items():
            path = root / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content + (b"x" if name == spoilt else b""))
        hashes.append(sources_sha256(root))
    assert hashes[3] == hashes[0]  # no source
    assert len({*hashes}) == 3
    (tmp_path / "None" / "flight_sw" / "a.py").rename(tmp_path / "None" / "flight_sw" / "z.py")
    assert sources_sha256(tmp_path / "None" / "flight_sw") not in hashes


def test_the_announcer_repeats_itself_until_it_is_left() -> None:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    far.settimeout(5.0)
    with near, far:
        with Announcer(near, built("lqy").image, 5) as announcer:
            frames = [np.frombuffer(far.recv(64), FRAME)[0] for _ in range(6)]
            announcer.state = READY
        assert [int(f["data"]) >> 8 & 0xF for f in frames] == [0, 0, 1, 1, 2, 2]
        ids = [icd.layout(name).can_id for name in ("FSW_BOOT", "FSW_LOAD")]
        assert [int(f["can_id"]) for f in frames] == ids * 3


def test_an_announcement_that_nobody_hears_is_no_error() -> None:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    far.close()
    with near:
        Announcer(near, built("lqy").image, 5).announce()


@pytest.mark.parametrize(
    ("state", "words", "found"), [(READY, 2, 6), (ARMED, 2, 6), (COMPILING, 9, 0), (READY, 1, 0)]
)
def test_the_announcer_hears_who_serves_the_bus_already(state: int, words: int, found: int) -> None:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with near, far:
        announcer = Announcer(near, built("lqy").image, 5)
        for counter in range(words):
            announcer.hear(boot_frames(6, announcer.image, state, counter)[0])
        assert announcer.who_serves() == found


def test_the_announcer_takes_a_false_word_said_again_for_nobody() -> None:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with near, far:
        announcer = Announcer(near, built("lqy").image, 5)
        for _ in range(5):
            announcer.hear(boot_frames(6, announcer.image, READY, 3)[0])
        assert announcer.who_serves() == 0


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
    with open_bus(f"unix:{path}") as bus_listener:
        bus_listener.settimeout(TIMEOUT_S)
        state = COMPILING
        while state != READY:
            read = read_plain(bus_listener.recv(64))
            assert read is not None
            state = read.raw.get("state", state)
