"""A recording replayed gives the recorded commands bit for bit, or says where it does not."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from flight_sw import icd
from flight_sw.errors import LoadError, RecordingError
from flight_sw.load_image import image_bytes, parse_image
from sim_harness.replay.open_loop import compare, spreads
from sim_harness.replay.replayer import Replayer
from sim_harness.replay.script import heard_by_computer
from sim_harness.telemetry.reader import open_recording
from tests.sim_harness.recordings import drain
from tests.system.flights import MISSION, Computer, built, cantools_values, commands
from tests.system.paced import piece
from tests.system.replays import DT_S, Bench, fly, record, replay, resealed
from tools.cli import application

pytestmark = pytest.mark.jit_only

SECONDS = 8.0
CYCLES = 400


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight seconds on the heat-flux limit, in memory."""
    return fly(piece(SECONDS), tmp_path_factory.mktemp("memory"))


def run(*arguments: str | Path) -> Result:
    """One command."""
    return CliRunner().invoke(application(), [str(argument) for argument in arguments])


def test_a_flight_in_memory_replays_to_the_bit(flown: Path) -> None:
    found = replay(flown)
    assert found.is_identical
    assert (found.cycles, found.until_s) == (CYCLES, SECONDS)


def test_a_flight_of_two_processes_replays_to_the_bit(tmp_path: Path, flown: Path) -> None:
    path = fly(piece(SECONDS), tmp_path, "unix")
    found, in_memory = replay(path), replay(flown)
    assert found.is_identical
    assert (found.cycles, found.frames) == (in_memory.cycles, in_memory.frames)


def test_a_flight_against_the_clock_replays_to_the_bit(tmp_path: Path) -> None:
    path = fly(piece(3.0), tmp_path, "unix", pace=1.0)
    found = replay(path)
    told = json.loads(open_recording(path).outcome["timing"])
    assert found.is_identical
    assert len(found.ticks) == told["ticks"]


@pytest.mark.parametrize("before", range(7))
@pytest.mark.parametrize("ticks", [1, 2, 5])
def test_ticks_are_found_wherever_they_fell(tmp_path: Path, ticks: int, before: int) -> None:
    bench = Bench("lqy", 40)
    for cycle in range(40):
        if cycle in (9, 10, 25):
            bench.late_cycle(ticks, before)
        else:
            bench.cycle()
    found = replay(record(bench.made, bench.rows, tmp_path / "a.mcap"))
    assert found.is_identical
    assert len(found.ticks) == 3 * ticks
    assert found.cycles == 40 + 3 * ticks


@pytest.mark.parametrize("late", range(47, 54))
def test_a_tick_is_found_in_a_cycle_whose_report_is_due_anyway(tmp_path: Path, late: int) -> None:
    for before in range(7):
        bench = Bench("lqy", 70, "minute")
        for cycle in range(70):
            if cycle == late:
                bench.late_cycle(1, before)
            else:
                bench.cycle()
        found = replay(record(bench.made, bench.rows, tmp_path / f"{before}.mcap"))
        assert found.is_identical, (before, found.difference)
        assert (len(found.ticks), found.reports, found.cycles) == (1, 0, 71)


def test_lockstep_has_no_ticks_to_explain_an_answer_with(tmp_path: Path) -> None:
    bench = Bench("lqy", 12)
    for _ in range(10):
        bench.cycle()
    bench.log(bench.tick())
    found = replay(record(bench.made, bench.rows, tmp_path / "a.mcap", pace="lockstep"))
    assert found.difference is not None
    assert found.difference.replayed == "not sent"


def test_false_frames_on_the_bus_are_replayed_with_the_rest(tmp_path: Path) -> None:
    bench = Bench("lqy", 60)
    rng = np.random.default_rng(5)
    codec = [m for m in icd.LAYOUT if m.sender == "HARNESS"]
    for _ in range(60):
        false = bench.navigation()[rng.integers(0, 7, 3)].copy()
        false["can_id"] = [codec[i].can_id for i in rng.integers(0, len(codec), 3)]
        for frame in false:
            frame["data"] = resealed(bench.made, frame, int(rng.integers(0, 1 << 51)) << 12)
        bench.see(false)
        bench.cycle()
    found = replay(record(bench.made, bench.rows, tmp_path / "a.mcap", pace="lockstep"))
    assert found.is_identical and found.cycles == 60
    assert bench.computer.counted.get("OK", 0) < 7 * 60 + 1 + 3 * 60


def test_a_frame_that_poses_as_the_computers_is_told_apart(tmp_path: Path) -> None:
    bench = Bench("lqy", 30)
    for _ in range(15):
        bench.cycle()
    status = bench.rows["frame"][bench.rows["frame"]["can_id"] == 48][-1:].copy()
    status["data"] = resealed(bench.made, status[0], 0xF00 << 20)
    bench.see(status)
    for _ in range(15):
        bench.cycle()
    found = replay(record(bench.made, bench.rows, tmp_path / "a.mcap", pace="lockstep"))
    assert found.is_identical and (found.cycles, found.false_frames) == (30, 1)


def altered(flown: Path, out: Path, message: str, place: int, flip: int) -> tuple[Path, int]:
    """The flight with some bits of one recorded answer flipped; and the frame's row."""
    recording = open_recording(flown)
    made, rows = piece(SECONDS), recording.bus.copy()
    row = np.flatnonzero(rows["frame"]["can_id"] == icd.layout(message).can_id)[place]
    rows["frame"]["data"][row] = resealed(made, rows["frame"][row], flip)
    return record(made, rows, out, "memory", pace="lockstep"), int(row)


def test_the_first_frame_and_signal_that_differ_are_told_with_both_values(
    tmp_path: Path, flown: Path
) -> None:
    path, row = altered(flown, tmp_path / "a.mcap", "FSW_COMMAND", 123, 1 << 12)
    found = replay(path).difference
    assert found is not None
    right, wrong = (open_recording(p).bus["frame"][row : row + 1] for p in (flown, path))
    name = "bank_cmd_rad"
    assert (found.message, found.signal, found.minor_frame) == ("FSW_COMMAND", name, 123)
    assert found.t_s == pytest.approx(123 * DT_S)
    assert found.recorded == pytest.approx(cantools_values(wrong, "FSW_COMMAND")[0][name])
    assert found.replayed == pytest.approx(cantools_values(right, "FSW_COMMAND")[0][name])
    told = run("replay", path)
    assert told.exit_code == 1
    assert "differs at 2.46 s, frame 123: FSW_COMMAND.bank_cmd_rad recorded" in told.stdout


def test_a_difference_in_telemetry_alone_is_one(tmp_path: Path, flown: Path) -> None:
    path, _ = altered(flown, tmp_path / "a.mcap", "TM_LQY", 7, 1 << 15)
    found = replay(path).difference
    assert found is not None and found.message == "TM_LQY"


def test_a_replay_ends_where_minor_frames_are_missing(tmp_path: Path, flown: Path) -> None:
    rows = open_recording(flown).bus
    first, second = rows[rows["t_s"] < 3.0], rows[rows["t_s"] >= 4.0]
    path = tmp_path / "a.mcap"
    made = piece(SECONDS)
    record(made, first, path, "memory")
    with pytest.MonkeyPatch.context() as patch:
        from sim_harness.telemetry.recorder import Recorder

        plain = Recorder.write_bus

        def with_gap(self: Recorder, rows: np.ndarray) -> None:
            plain(self, first)
            drain(self)
            self._writer.skip(50)
            plain(self, second)

        patch.setattr(Recorder, "write_bus", with_gap)
        record(made, rows, path, "memory")
    found = replay(path)
    assert found.is_identical and found.cycles == 150
    assert found.gap_s == pytest.approx(2.98)
    assert "minor frames are missing after it, 50 in all" in run("replay", path).stdout


def test_a_torn_recording_replays_to_its_end_and_says_so(tmp_path: Path, flown: Path) -> None:
    torn = tmp_path / "flight.mcap"
    torn.write_bytes(flown.read_bytes()[:-4000])
    told = run("replay", torn)
    assert told.exit_code == 0
    assert "identical" in told.stdout
    assert "the recording is incomplete, replayed until " in told.stdout


def test_a_recording_without_an_answer_is_no_identical_one(tmp_path: Path) -> None:
    bench = Bench("lqy", 5)
    path = record(bench.made, bench.rows[:0], tmp_path / "a.mcap")
    load = tmp_path / "a.load"
    load.write_bytes(bench.made.raw)
    for more in ((), ("--load", str(load))):
        told = run("replay", path, *more)
        assert (told.exit_code, told.stdout) == (1, "")
        assert str(told.exception).endswith(
            "a.mcap: holds no minor frame that its flight computer answered, "
            "nothing is to be compared"
        )


def test_another_dbc_is_refused_with_both_hashes_and_still_exported(tmp_path: Path) -> None:
    bench = Bench("lqy", 20)
    for _ in range(20):
        bench.cycle()
    path = record(bench.made, bench.rows, tmp_path / "a.mcap")
    content, ours = path.read_bytes(), icd.DBC_SHA256[:16]
    assert ours not in content.decode(errors="replace")
    with pytest.MonkeyPatch.context() as patch:
        changed = icd.DBC_PATH.read_text().replace("(1,0) [0|4]", "(1,0) [0|3]")
        other = tmp_path / "aeroshell.dbc"
        other.write_text(changed)
        patch.setattr(icd, "DBC_PATH", other)
        record(bench.made, bench.rows, path)
    with pytest.raises(RecordingError, match=rf"recorded with DBC [0-9a-f]{{16}}, .* has {ours}"):
        Replayer(open_recording(path))
    assert run("export", path, "--format", "csv").exit_code == 0


def test_a_load_of_another_layout_is_refused_with_both_hashes(tmp_path: Path) -> None:
    bench = Bench("lqy", 5)
    bench.cycle()
    raw = bytearray(bench.made.raw)
    at = raw.find(b"lqy")
    layout = at + 16 + 32
    raw[layout : layout + 4] = b"0123"
    raw = bytearray(_with_right_crc(raw))
    path = record(bench.made._replace(raw=bytes(raw)), bench.rows, tmp_path / "a.mcap")
    with pytest.raises(LoadError, match=r"layout is 0123[0-9a-f]+, .* load has [0-9a-f]+"):
        Replayer(open_recording(path))


def _with_right_crc(raw: bytearray) -> bytes:
    import zlib

    from flight_sw.load_image import HEADER

    header = np.frombuffer(bytes(raw[: HEADER.itemsize]), HEADER).copy()
    header["crc32"] = 0
    header["crc32"] = zlib.crc32(header.tobytes() + bytes(raw[HEADER.itemsize :]))
    return header.tobytes() + bytes(raw[HEADER.itemsize :])


def test_a_missing_load_is_named(tmp_path: Path) -> None:
    from tests.sim_harness.recordings import record as without_load

    without_load(tmp_path / "a.mcap", range(50))
    told = run("replay", tmp_path / "a.mcap")
    assert isinstance(told.exception, RecordingError)
    assert "has no attachment .load, attached is aeroshell.dbc" in str(told.exception)


def test_the_load_that_flew_differs_nowhere_open_loop(flown: Path) -> None:
    recording = open_recording(flown)
    compared = compare(recording, piece(SECONDS).image, heard_by_computer(recording))
    assert len(compared.t_s) == CYCLES and compared.missing == 0
    assert all(s.largest == 0.0 and s.rms == 0.0 for s in spreads(compared))


def test_another_load_open_loop_answers_as_a_computer_that_hears_the_same(flown: Path) -> None:
    recording = open_recording(flown)
    made = built("lqy", "tracking", 1650.0)
    body = made.image.body.copy()
    raw = image_bytes("lqy", MISSION, body)
    compared = compare(recording, parse_image(raw, "other"), heard_by_computer(recording))
    computer = Computer(made)
    rows = recording.bus["frame"]
    heard = rows[np.isin(rows["can_id"], [m.can_id for m in icd.LAYOUT if "NAV" in m.name])]
    answers = cantools_values(commands(computer.feed(heard)), "FSW_COMMAND")
    wanted = np.array([answer["bank_cmd_rad"] for answer in answers])
    assert np.abs(compared.other["bank_cmd_rad"] - wanted).max() < 1e-9
    assert np.abs(wanted - compared.recorded["bank_cmd_rad"]).max() > 1e-3


def test_open_loop_says_so_and_writes_a_table(tmp_path: Path, flown: Path) -> None:
    import pyarrow.parquet as pq

    made = built("lqy", "tracking", 1650.0)
    load, out = tmp_path / "other.load", tmp_path / "a.parquet"
    load.write_bytes(made.raw)
    told = run("replay", flown, "--load", load, "--out", out)
    assert told.exit_code == 0
    assert "open loop, what" in told.stdout and "the vehicle flew on as recorded" in told.stdout
    table = pq.read_table(out).to_pydict()
    assert len(table["t_s"]) == CYCLES
    difference = np.array(table["other_bank_cmd_deg"]) - table["recorded_bank_cmd_deg"]
    assert f"{difference[np.abs(difference).argmax()]:+9.4f} deg" in told.stdout
    again = run("replay", flown, "--load", load, "--out", out)
    assert isinstance(again.exception, RecordingError)
    assert "exists already, --force replaces it" in str(again.exception)
