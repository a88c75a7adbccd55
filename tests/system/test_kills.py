"""kill -9 at any moment takes at most a second of flight, and what is left is read and replayed.

The flight keeps its own records in a mapped file, so that after the kill the test reads there to
the minor frame how far it had flown.
"""

import json
import mmap
import os
import signal
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim_harness.flight.flight import fly_memory
from sim_harness.flight.loop import HARNESS
from sim_harness.replay.replayer import Replayer
from sim_harness.telemetry.journal import journal_path
from sim_harness.telemetry.reader import Recording, open_recording
from tests.system.flights import ROOT, run_of
from tests.system.paced import piece
from tools.commands.fly import _attachments
from tools.flight_facts import facts
from tools.recording import FlightRecorder

pytestmark = pytest.mark.jit_only

LOST_MAX_S = 1.0
START_TIMEOUT_S = 200.0  # of a first flight that has to compile
KINDS: dict[str, dict[str, Any]] = {
    "memory": {"bus": "memory"},
    "lockstep": {"bus": "unix"},
    "realtime": {"bus": "unix", "pace": 1.0},
    "20x": {"bus": "unix", "pace": 20.0},
}
SECONDS = {"memory": 800.0, "lockstep": 60.0, "realtime": 4.0, "20x": 30.0}
"""Of flight, within which the kill comes."""

FLIER = """
import json, mmap, resource, sys
from pathlib import Path
import numpy as np
from sim_harness.flight.flight import FlightPlan, FlightRun
from sim_harness.flight.loop import HARNESS
from sim_harness.world.missions import load_mission
from tools.commands.fly import fly_and_record
folder, plan, bytes_max = Path(sys.argv[1]), json.loads(sys.argv[2]), int(sys.argv[3])
load = Path("gains/hyperion-1/lqy.load")
mission = load_mission("hyperion-1")
run = FlightRun(FlightPlan(mission, "lqy", load.read_bytes(), load.resolve(), **plan), [])
file = (folder / "harness").open("w+b")
file.truncate(HARNESS.itemsize)
shared = np.frombuffer(mmap.mmap(file.fileno(), HARNESS.itemsize), HARNESS)
shared[:] = run.harness
run.harness = shared
if bytes_max:
    resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_max, bytes_max))
print(fly_and_record(run, folder), run.outcome_text)
"""


class Flier:
    """A recorded flight in a process of its own that can be killed."""

    def __init__(self, folder: Path, kind: str, bytes_max: int = 0) -> None:
        self.folder = folder
        plan = json.dumps(KINDS[kind])
        self.process = subprocess.Popen(
            [sys.executable, "-c", FLIER, str(folder), plan, str(bytes_max)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def flown_s(self) -> float:
        """How far the flight is, from its own records."""
        path = self.folder / "harness"
        if not path.exists() or path.stat().st_size < HARNESS.itemsize:
            return 0.0
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as map_:
            return float(np.frombuffer(map_[: HARNESS.itemsize], HARNESS)["truth"]["t_s"][0])

    def wait_for(self, t_s: float) -> None:
        """Wait until so much is flown, or the flight is over."""
        end_s = time.monotonic() + START_TIMEOUT_S
        while self.flown_s() < t_s and self.process.poll() is None:
            assert time.monotonic() < end_s
            time.sleep(0.0005)

    def computer(self) -> int:
        """The flight computer's process."""
        pid = self.process.pid
        (child,) = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        return int(child)


def killed(folder: Path, kind: str, at_s: float, whom: str = "harness") -> tuple[float, Recording]:
    """A flight killed at some time: how far it had flown, and what it left."""
    flier = Flier(folder, kind)
    flier.wait_for(at_s)
    if whom == "computer":
        os.kill(flier.computer(), signal.SIGKILL)
    else:
        flier.process.kill()
    flier.process.communicate(timeout=30.0)
    return flier.flown_s(), open_recording(folder / "flight.mcap")


def check(flown_s: float, recording: Recording) -> None:
    """At most a second is lost, all that is left replays, and it says until when it goes."""
    assert recording.until_s >= flown_s - LOST_MAX_S
    if flown_s > LOST_MAX_S:
        assert len(recording.truth) > 0
        assert recording.truth["t_s"][-1] >= flown_s - LOST_MAX_S
    replayed = Replayer(recording).run()
    assert replayed.is_identical, replayed.difference
    assert replayed.gap_s is None
    assert replayed.until_s >= flown_s - LOST_MAX_S
    told = facts(recording)
    assert told["until_s"] == recording.until_s
    assert told["is_complete"] == recording.is_complete


@pytest.mark.parametrize(
    ("kind", "whom", "share"),
    [
        ("memory", "harness", 0.4),
        ("lockstep", "harness", 0.7),
        ("lockstep", "computer", 0.3),
        ("realtime", "harness", 0.5),
        ("20x", "harness", 0.8),
    ],
)
def test_a_kill_takes_at_most_a_second_of_flight(
    tmp_path: Path, kind: str, whom: str, share: float
) -> None:
    flown_s, recording = killed(tmp_path, kind, share * SECONDS[kind], whom)
    check(flown_s, recording)
    if whom == "computer":  # the harness lives, completes the file and removes the journal
        assert recording.is_complete and not journal_path(recording.path).exists()
        assert recording.outcome["outcome"] == "flight computer silent"
    elif flown_s < 890.0:  # a flight in memory may be over before the kill comes
        assert not recording.is_complete


SHARE = (44, 29, 34, 19)  # a kind of flight each, the flight computer killed in two


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed",
    [pytest.param(seed, marks=[pytest.mark.share] * (seed in SHARE)) for seed in range(50)],
)
def test_fifty_kills_at_random_moments(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    kind = list(KINDS)[seed % len(KINDS)]
    whom = "computer" if kind != "memory" and rng.random() < 0.3 else "harness"
    check(*killed(tmp_path, kind, float(rng.uniform(0.0, SECONDS[kind])), whom))


def test_a_full_disk_ends_the_recording_and_not_the_flight(tmp_path: Path) -> None:
    flier = Flier(tmp_path, "memory", bytes_max=400_000)
    out, err = flier.process.communicate(timeout=START_TIMEOUT_S)
    assert out.strip() == "end condition"
    told = [line for line in err.splitlines() if "recording ended" in line]
    assert len(told) == 1 and told[0].startswith("aeroshell: flight.mcap: recording ended at ")
    assert told[0].endswith(", File too large")
    recording = open_recording(tmp_path / "flight.mcap")
    assert not recording.is_complete and recording.until_s > 10.0
    assert Replayer(recording).run().is_identical


@pytest.fixture
def left(tmp_path: Path) -> Path:
    """A recording cut off after some seconds, with a journal that goes on for longer."""
    made = piece(8.0)
    run = run_of(made, tmp_path / "a.load")
    recorder = FlightRecorder(tmp_path / "flight.mcap", {"recording": "one", "bus": "memory"},
                              _attachments(run))  # fmt: skip
    run.listeners.append(recorder)
    journal = run.keep_journal(tmp_path / "flight.mcap", "one")
    fly_memory(run)
    recorder.close(run)
    journal.close()
    path = tmp_path / "flight.mcap"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return path


def test_a_journal_lengthens_a_recording_that_was_cut_off(left: Path) -> None:
    recording = open_recording(left)
    assert recording.until_s > 7.7 and recording.from_journal_s > 0.0
    found = Replayer(recording).run()
    assert found.is_identical and found.until_s == recording.until_s
    assert any("tracking" in line.text or "mode" in line.text for line in recording.log)


def test_a_journal_with_a_flipped_byte_is_read_up_to_it(left: Path) -> None:
    path = journal_path(left)
    content = bytearray(path.read_bytes())
    content[len(content) * 3 // 4] ^= 0x10
    path.write_bytes(content)
    harmed = open_recording(left)
    assert 0.0 < harmed.until_s < 7.7
    assert Replayer(harmed).run().is_identical


HEAD = b'{"recording": "one", "truth": []}'


@pytest.mark.parametrize(
    "damage",
    [
        b"", b"AEROJRN2", b"AEROJRN2\xff\xff\xff\xff{", b"no journal",
        b"AEROJRNL" + struct.pack("<I", len(HEAD)) + HEAD,
        b"AEROJRN2" + struct.pack("<II", len(HEAD), zlib.crc32(HEAD) ^ 1) + HEAD,
    ],
)  # fmt: skip
def test_a_journal_that_is_none_is_left_alone(left: Path, damage: bytes) -> None:
    journal_path(left).write_bytes(damage)
    assert open_recording(left).from_journal_s == 0.0


@pytest.mark.parametrize("part", [b"recording", b"lat_rad", b"<f8", b", 24]"])
def test_a_journal_with_a_flipped_byte_in_its_head_is_left_alone(left: Path, part: bytes) -> None:
    path = journal_path(left)
    content = bytearray(path.read_bytes())
    content[content.index(part) + len(part) // 2] ^= 0x02  # an offset, a type or a name is another
    path.write_bytes(content)
    assert open_recording(left).from_journal_s == 0.0


def test_the_journal_of_another_flight_is_not_taken(left: Path) -> None:
    path = journal_path(left)
    content = path.read_bytes()
    (size,) = struct.unpack_from("<I", content, 8)
    rest = content[16:]
    head = rest[:size].replace(b'"one"', b'"two"', 1)
    path.write_bytes(b"AEROJRN2" + struct.pack("<II", size, zlib.crc32(head)) + head + rest[size:])
    assert open_recording(left).from_journal_s == 0.0
