"""What can happen to a recording: killed writers, full disks, torn, damaged and foreign files."""

import os
import random
import re
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from flight_sw.errors import RecordingError
from sim_harness.telemetry.reader import open_recording
from sim_harness.telemetry.recorder import Recorder
from sim_harness.telemetry.records import BUS_LOG, LogLevel
from sim_harness.telemetry.writer import RecordingWriter
from tests.sim_harness.recordings import DBC, DT_S, MANIFEST, bus_rows, record

LOSS_MAX_S = 1.0
HANDED = struct.Struct("<dd")  # mission time handed to the recorder, and when

WRITER = """
import os, struct, sys, time
from pathlib import Path
from sim_harness.telemetry.recorder import Recorder
from sim_harness.telemetry.writer import RecordingWriter
from tests.sim_harness.recordings import DBC, MANIFEST, bus_rows, truth_rows
bus, truth = bus_rows(range(25)), truth_rows(range(25))
recorder = Recorder(Path(sys.argv[1]), MANIFEST, DBC)
for batch in range(100_000):
    bus["t_s"] += 0.5 * (batch > 0)
    truth["t_s"] += 0.5 * (batch > 0)
    recorder.write_bus(bus)
    recorder.write_truth(truth)
    os.write(1, struct.pack("<dd", bus["t_s"][-1], time.monotonic()))
    time.sleep(0.5 / float(sys.argv[2]))
"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flight") / "flight.mcap"
    record(path, range(100))
    return path


def kill_a_writer(path: Path, speed: float, after_s: float) -> tuple[np.ndarray, float]:
    """Record at so many times real time, kill; returns what was handed over when, and the kill."""
    command = [sys.executable, "-c", WRITER, str(path), str(speed)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=Path(__file__).parents[2]) as child:
        assert child.stdout is not None
        first = child.stdout.read(HANDED.size)
        assert len(first) == HANDED.size
        time.sleep(after_s)
        killed_s = time.monotonic()
        child.send_signal(signal.SIGKILL)
        rest = child.stdout.read()
    rest = rest[: len(rest) // HANDED.size * HANDED.size]
    return np.frombuffer(first + rest, "<f8").reshape(-1, 2), killed_s


def check_a_kill(path: Path, speed: float, after_s: float) -> None:
    handed, killed_s = kill_a_writer(path, speed, after_s)
    recording = open_recording(path)
    assert not recording.is_complete
    assert recording.outcome == {}
    assert MANIFEST.items() <= recording.manifest.items()
    lost = handed[handed[:, 0] > recording.until_s + 1e-6]
    wall_s = killed_s - lost[0, 1] if len(lost) else 0.0
    assert wall_s <= LOSS_MAX_S, f"lost is what was handed over {wall_s} s before the kill"
    cycles = round(recording.until_s / DT_S) + 1
    assert len(recording.bus) == cycles * len(bus_rows(range(1)))
    words = recording.bus["frame"]["data"].reshape(cycles, -1)
    assert (
        words == bus_rows(range(25))["frame"]["data"].reshape(25, -1)[np.arange(cycles) % 25]
    ).all()


@pytest.mark.jit_only
@pytest.mark.parametrize("speed", [1.0, 200.0, 2000.0])
def test_a_killed_writer_leaves_all_but_the_last_second(tmp_path: Path, speed: float) -> None:
    check_a_kill(tmp_path / "a.mcap", speed, random.Random(int(speed)).uniform(0.3, 1.5))


@pytest.mark.slow
@pytest.mark.jit_only
@pytest.mark.parametrize("seed", range(50))
def test_fifty_killed_writers_leave_all_but_the_last_second(tmp_path: Path, seed: int) -> None:
    chosen = random.Random(seed)
    speed = 10.0 ** chosen.uniform(0.0, 3.5)
    check_a_kill(tmp_path / "a.mcap", speed, chosen.uniform(0.0, 1.5))


def test_a_file_cut_anywhere_reads_up_to_its_last_whole_chunk(whole: Path, tmp_path: Path) -> None:
    content, cut = whole.read_bytes(), tmp_path / "cut.mcap"
    flown = open_recording(whole).bus
    seen = set()
    for length in random.Random(1).sample(range(len(content)), 150):
        cut.write_bytes(content[:length])
        try:
            recording = open_recording(cut)
        except RecordingError as error:
            assert length < 16000, error  # before the end of manifest and attachments
            continue
        assert not recording.is_complete
        assert recording.bus.tobytes() == flown[: len(recording.bus)].tobytes()
        seen.add(len(recording.bus))
    assert len(seen) > 2 and len(flown) in seen


def told_and_kept(path: Path) -> tuple[str, np.ndarray]:
    """What is said of a damaged recording, and the frames that are read of it."""
    try:
        recording = open_recording(path)
    except RecordingError as error:
        return str(error), np.zeros(0, BUS_LOG)
    return recording.damage, recording.bus


def test_every_flipped_bit_of_a_complete_file_is_found(whole: Path, tmp_path: Path) -> None:
    content, bad = bytearray(whole.read_bytes()), tmp_path / "bad.mcap"
    chosen, flown = random.Random(2), open_recording(whole).bus
    for place in [
        *range(len(content) - 40, len(content) - 8),
        *chosen.sample(range(8, len(content) - 8), 150),
    ]:
        bit = 1 << chosen.randrange(8)
        content[place] ^= bit
        bad.write_bytes(content)
        told, kept = told_and_kept(bad)
        assert re.search(r"bad\.mcap: ", told)
        assert np.isin(kept, flown).all()
        content[place] ^= bit


def in_four_chunks(path: Path) -> np.ndarray:
    """A recording of 100 minor frames, 25 to a chunk; returns its frames."""
    writer = RecordingWriter(path, MANIFEST, DBC, 10.0)
    pieces = [bus_rows(range(start, start + 25)) for start in range(0, 100, 25)]
    for rows in pieces:
        writer.write([rows], [], [])
    writer.finish({"outcome": "end condition"})
    return np.concatenate(pieces)


def test_a_flipped_bit_before_the_torn_end_is_damage_not_the_end(tmp_path: Path) -> None:
    bad = tmp_path / "bad.mcap"
    flown = in_four_chunks(bad)
    content = bytearray(bad.read_bytes())
    first_chunk = content.index(b"zstd") + 20
    content[first_chunk + 100] ^= 1
    bad.write_bytes(content[: len(content) * 3 // 4])
    told, kept = told_and_kept(bad)
    assert re.search(r"bad\.mcap: damaged at byte \d+, chunk has CRC-32 ", told)
    begin = len(flown) // 4
    assert len(kept) and kept.tobytes() == flown[begin : begin + len(kept)].tobytes()


def test_of_a_damaged_recording_all_but_the_damaged_chunk_is_kept(tmp_path: Path) -> None:
    bad = tmp_path / "bad.mcap"
    flown = in_four_chunks(bad)
    content = bytearray(bad.read_bytes())
    marks = [found.start() for found in re.finditer(b"zstd", bytes(content))]
    content[marks[1] + 100] ^= 1
    bad.write_bytes(content)
    told, kept = told_and_kept(bad)
    step = len(flown) // 4
    assert told.endswith("; read is what is whole")
    assert kept.tobytes() == np.delete(flown, slice(step, 2 * step)).tobytes()
    assert open_recording(bad).missing_minor_frames == 25


def test_a_wrong_checksum_is_told_with_both_values(whole: Path, tmp_path: Path) -> None:
    content, bad = bytearray(whole.read_bytes()), tmp_path / "bad.mcap"
    content[content.index(b"BO_ 16") + 3] ^= 1
    bad.write_bytes(content)
    wanted = (
        r"bad\.mcap: damaged at byte \d+, attachment aeroshell\.dbc has CRC-32 0x[0-9a-f]{8}, "
        r"its record says 0x[0-9a-f]{8}"
    )
    assert re.search(wanted, told_and_kept(bad)[0])


def foreign(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        writer.finish()


def newer(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="aeroshell")
        writer.add_metadata("aeroshell.manifest", {"format": "9"})
        writer.finish()


@pytest.mark.parametrize(
    ("make", "wanted"),
    [
        (lambda path: None, "cannot be read, No such file or directory"),
        (lambda path: path.mkdir(), "cannot be read, No such file or directory"),
        (lambda path: path.touch(), "not an MCAP file"),
        (lambda path: path.write_text("t_s,alt_m\n"), "not an MCAP file"),
        (lambda path: path.write_bytes(b"\x89MCAP0\r\n"), "it has no profile"),
        (foreign, "of another project, it has profile 'ros2', ours is 'aeroshell'"),
        (newer, "format is 9, this reader knows 2"),
    ],
)
def test_what_is_not_a_recording_of_ours_is_refused_in_a_sentence(
    tmp_path: Path, make: Callable[[Path], None], wanted: str
) -> None:
    path = tmp_path / "a.mcap"
    make(path)
    with pytest.raises(RecordingError, match=wanted) as caught:
        open_recording(path)
    assert re.search(r"a\.mcap(/flight\.mcap)?: ", str(caught.value)) and "\n" not in str(
        caught.value
    )


def test_a_missing_attachment_is_named_with_those_there(whole: Path) -> None:
    with pytest.raises(RecordingError, match=r"no attachment \.load, attached is aeroshell\.dbc"):
        open_recording(whole).attachment(".load")


FILLER = """
import resource, sys, time
from pathlib import Path
from sim_harness.telemetry.recorder import Recorder
from sim_harness.telemetry.writer import RecordingWriter
from tests.sim_harness.recordings import DBC, MANIFEST, bus_rows
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
recorder = Recorder(Path(sys.argv[1]), MANIFEST, DBC, on_failure=print)
rows = bus_rows(range(25))
for batch in range(400):
    recorder.write_bus(rows)
    rows["t_s"] += 0.5
    time.sleep(0.002)
recorder.close("end condition")
print("the flight went on to its end")
"""


def test_a_full_disk_ends_the_recording_with_one_message(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    command = [sys.executable, "-c", FILLER, str(path)]
    folder = Path(__file__).parents[2]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=folder, check=True)
    told, last = ended.stdout.splitlines()
    assert told.startswith("a.mcap: recording ended at ") and told.endswith(", File too large")
    assert last == "the flight went on to its end"
    assert ended.stderr == ""
    assert path.stat().st_size < 100_000  # cut back to its last whole chunk
    recording = open_recording(path)
    assert not recording.is_complete and len(recording.bus) > 0
    assert f"ended at {recording.until_s:.3f} s" in told


def test_a_disk_that_is_full_at_the_start_refuses_the_recording() -> None:
    with pytest.raises(
        RecordingError, match="/dev/full: cannot be written, No space left on device"
    ):
        Recorder(Path("/dev/full"), MANIFEST, DBC)


def test_a_folder_that_is_not_there_refuses_the_recording(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be written, No such file or directory"):
        Recorder(tmp_path / "none" / "a.mcap", MANIFEST, DBC)


def test_after_a_failure_nothing_more_is_queued(tmp_path: Path) -> None:
    told: list[str] = []
    recorder = Recorder(tmp_path / "a.mcap", MANIFEST, DBC, on_failure=told.append)
    os.close(recorder._writer._file._fd)
    recorder._writer._file._fd = os.open(os.devnull, os.O_RDONLY)
    for _ in range(3):
        recorder.write_bus(bus_rows(range(25)))
        recorder.log(0.5, LogLevel.INFO, "still flying")
        time.sleep(0.2)
    recorder.close("end condition")
    assert len(told) == 1 and "Bad file descriptor" in told[0]
    assert not recorder._queue
