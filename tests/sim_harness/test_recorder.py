"""A recorded flight reads back as it was flown, by our reader and by the mcap library."""

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory

from flight_sw import icd
from flight_sw.errors import RecordingError
from sim_harness.telemetry.reader import open_recording
from sim_harness.telemetry.recorder import Recorder
from sim_harness.telemetry.records import BUS_LOG, LogLevel, LogLine
from sim_harness.telemetry.writer import RecordingWriter
from tests.sim_harness.recordings import (
    DATABASE,
    DBC,
    DT_S,
    MANIFEST,
    bus_rows,
    drain,
    record,
    truth_rows,
    values_of,
)

CYCLES = range(100)
EVERY = 5  # minor frames between two samples at 10 Hz


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flight") / "flight.mcap"
    record(path, CYCLES)
    return path


def decoded(path: Path, topic: str) -> list[tuple[int, Any]]:
    """Log times and messages of one topic, by the library's reader with the file's schemas."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = list(reader.iter_decoded_messages(topics=[topic]))
    return [(message.log_time, proto) for _, _, message, proto in found]


def test_every_frame_comes_back_in_bus_order(flight: Path) -> None:
    assert open_recording(flight).bus.tobytes() == bus_rows(CYCLES).tobytes()


def test_truth_comes_back_to_the_bit_ten_times_a_second(flight: Path) -> None:
    truth, flown = open_recording(flight).truth, truth_rows(CYCLES)[::EVERY]
    for name in ("minor_frames", "t_s", "lon_rad", "lat_rad", "alt_m"):
        assert truth[name].tobytes() == flown[name].tobytes()
    assert truth["held_sin_bank"].tobytes() == flown["held"]["sin_bank"].tobytes()


def test_manifest_outcome_and_attachments_come_back(flight: Path) -> None:
    recording = open_recording(flight)
    assert recording.is_complete
    assert MANIFEST.items() <= recording.manifest.items()
    assert recording.outcome["outcome"] == "end condition"
    assert recording.outcome["heat_load_mjpm2"] == "1.5"
    assert recording.attachments == {name: content for name, (_, content) in DBC.items()}
    assert recording.until_s == pytest.approx(99 * DT_S, abs=1e-9)
    assert recording.missing_minor_frames == 0


def test_library_reads_all_of_it_with_checksums_in_order_of_time(flight: Path) -> None:
    with flight.open("rb") as file:
        found = list(NonSeekingReader(file, validate_crcs=True).iter_messages(log_time_order=False))
    with flight.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        times = [m.log_time for _, _, m in reader.iter_messages()]
        summary = reader.get_summary()
    assert all(m.publish_time == m.log_time for _, _, m in found)
    lines = len(open_recording(flight).log)
    assert len(found) == len(times) == 100 + 20 * (len(icd.MESSAGES) + 2) + lines
    assert times == sorted(times)
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == len(found)


@pytest.mark.parametrize("name", icd.MESSAGES)
def test_decoded_message_equals_what_cantools_decodes(flight: Path, name: str) -> None:
    messages = decoded(flight, f"/can/{name}")
    dbc = DATABASE.get_message_by_name(name)
    assert [t_ns for t_ns, _ in messages] == [k * 100_000_000 for k in range(20)]
    for k, (_, proto) in enumerate(messages):
        data = dbc.encode(values_of(dbc, k * EVERY), strict=True)
        wanted = dbc.decode(data, decode_choices=False)
        for signal in icd.signal_names(name):
            assert getattr(proto, signal) == wanted[signal], signal


def test_values_with_names_are_sent_as_enumerations(flight: Path) -> None:
    _, proto = decoded(flight, "/can/FSW_STATUS")[1]
    field = proto.DESCRIPTOR.fields_by_name["mode"]
    names = {value.number: value.name for value in field.enum_type.values}
    assert names == {0: "STANDBY", 1: "COAST", 2: "ENTRY", 3: "TERMINAL", 4: "SAFE"}


def test_raw_frames_parse_as_protobuf(flight: Path) -> None:
    messages = decoded(flight, "/bus/frames")
    frames = b"".join(proto.frames for _, proto in messages)
    assert frames == bus_rows(CYCLES)["frame"].tobytes()
    assert [proto.t_s for _, proto in messages] == [k * DT_S for k in CYCLES]
    assert [t_ns for t_ns, _ in messages] == [k * 20_000_000 for k in CYCLES]


def test_location_is_the_truths_in_degrees(flight: Path) -> None:
    messages, flown = decoded(flight, "/location"), truth_rows(CYCLES)[::EVERY]
    found = np.array([(m.latitude, m.longitude, m.altitude) for _, m in messages])
    wanted = np.column_stack(
        [flown["lat_rad"] * 180.0 / np.pi, flown["lon_rad"] * 180.0 / np.pi, flown["alt_m"]]
    )
    np.testing.assert_allclose(found, wanted, rtol=1e-15)
    assert [m.timestamp.ToNanoseconds() for _, m in messages] == [t_ns for t_ns, _ in messages]


@pytest.mark.parametrize("count", [1, 7, 8, 16, 1000, 1001, 1024, 2500])
def test_minor_frames_of_any_size_come_back(tmp_path: Path, count: int) -> None:
    rows = np.zeros(count + 1, BUS_LOG)
    rows["t_s"][-1] = DT_S
    rows["frame"]["data"] = np.arange(1, count + 2) * 0x0102030405060708
    with Recorder(tmp_path / "a.mcap", {}, DBC) as recorder:
        recorder.write_bus(rows)
    assert open_recording(tmp_path / "a.mcap").bus.tobytes() == rows.tobytes()
    parsed = [proto.frames for _, proto in decoded(tmp_path / "a.mcap", "/bus/frames")]
    assert b"".join(parsed) == rows["frame"].tobytes()


@pytest.mark.parametrize(
    ("field", "change"), [("data", 1 << 40), ("can_id", 0x800), ("can_id", 1 << 31), ("dlc", 15)]
)
def test_a_frame_that_the_bus_spoilt_is_recorded_but_not_decoded(
    tmp_path: Path, field: str, change: int
) -> None:
    rows = bus_rows(range(2), ("NAV_VERTICAL",))
    rows["frame"][field][0] ^= np.uint64(change).astype(rows["frame"][field].dtype)
    with Recorder(tmp_path / "a.mcap", {}, DBC) as recorder:
        recorder.write_bus(rows)
    (found,) = decoded(tmp_path / "a.mcap", "/can/NAV_VERTICAL")
    assert found[0] == 20_000_000
    recording = open_recording(tmp_path / "a.mcap")
    assert recording.bus.tobytes() == rows.tobytes()
    assert list(recording.message("NAV_VERTICAL")[0]) == [DT_S]


def test_sample_rate_is_the_one_asked_for(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap", CYCLES, telemetry_rate_hz=2.0)
    recording = open_recording(tmp_path / "a.mcap")
    assert list(recording.truth["minor_frames"]) == [0, 25, 50, 75]
    assert len(decoded(tmp_path / "a.mcap", "/can/NAV_TIME")) == 4
    assert len(recording.bus) == len(CYCLES) * len(icd.MESSAGES)


def test_each_message_is_sampled_by_itself(tmp_path: Path) -> None:
    rows = np.concatenate([bus_rows(range(c, c + 1), (n,)) for c, n in SLOW_AND_FAST])
    with Recorder(tmp_path / "a.mcap", {}, DBC) as recorder:
        recorder.write_bus(rows)
    for name, cycles in (("TM_LQY", [3, 8, 13]), ("NAV_AERO", [2, 5, 10])):
        times = [t_ns for t_ns, _ in decoded(tmp_path / "a.mcap", f"/can/{name}")]
        assert times == [cycle * 20_000_000 for cycle in cycles]


SLOW_AND_FAST = sorted(
    [(c, "TM_LQY") for c in (3, 8, 13)] + [(c, "NAV_AERO") for c in (2, 3, 4, 5, 6, 9, 10, 14)]
)


def test_how_the_flight_is_cut_into_batches_changes_no_message(
    flight: Path, tmp_path: Path
) -> None:
    record(tmp_path / "a.mcap", CYCLES, step=1)
    found = []
    for path in (flight, tmp_path / "a.mcap"):
        with path.open("rb") as file:
            messages = make_reader(file).iter_messages()
            found.append(sorted((m.log_time, m.channel_id, m.data) for _, _, m in messages))
    assert found[0] == found[1]


def test_log_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with Recorder(path, {}, DBC) as recorder:
        recorder.log(0.25, LogLevel.WARNING, "navigation set incomplete")
    assert open_recording(path).log == [
        LogLine(0.25, LogLevel.WARNING, "navigation set incomplete")
    ]
    ((t_ns, proto),) = decoded(path, "/log")
    assert (t_ns, proto.level, proto.message) == (250_000_000, 3, "navigation set incomplete")
    assert proto.timestamp.ToNanoseconds() == 250_000_000


def test_an_exception_in_the_flight_still_completes_the_file(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), Recorder(tmp_path / "a.mcap", {}, DBC) as recorder:
        recorder.write_bus(bus_rows(range(3)))
        raise ZeroDivisionError
    recording = open_recording(tmp_path / "a.mcap")
    assert recording.is_complete
    assert recording.outcome["outcome"] == "ended by ZeroDivisionError"


def test_closing_twice_changes_nothing(tmp_path: Path) -> None:
    recorder = record(tmp_path / "a.mcap", range(5))
    before = (tmp_path / "a.mcap").read_bytes()
    recorder.close("again")
    recorder.write_bus(bus_rows(range(1)))
    assert (tmp_path / "a.mcap").read_bytes() == before


class Gate:
    """Holds the recorder's thread where it would write."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.opened = threading.Event()
        write = RecordingWriter.write

        def held(writer: RecordingWriter, *rows: Any) -> None:
            self.opened.wait(30.0)
            write(writer, *rows)

        monkeypatch.setattr(RecordingWriter, "write", held)


def test_a_full_queue_drops_counts_and_says_so_in_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate, path = Gate(monkeypatch), tmp_path / "a.mcap"
    names = ("NAV_TIME", "NAV_AERO")
    recorder = Recorder(path, {}, DBC, queue_bytes=2 * 100 * BUS_LOG.itemsize)
    recorder.write_bus(bus_rows(range(0, 50), names))
    recorder.write_bus(bus_rows(range(50, 100), names))
    recorder.write_bus(bus_rows(range(100, 130), names))
    recorder.log(2.6, LogLevel.INFO, "one line too many")
    gate.opened.set()
    drain(recorder)
    recorder.write_bus(bus_rows(range(130, 140), names))
    recorder.close("end condition")
    recording = open_recording(path)
    assert recording.outcome["dropped_frames"] == "60"
    assert recording.outcome["dropped_minor_frames"] == "30"
    assert recording.outcome["dropped_log_lines"] == "1"
    assert recording.missing_minor_frames == 30
    assert recorder.dropped.frames == 60
    assert [line.level for line in recording.log] == [LogLevel.WARNING]
    assert recording.log[0].text == (
        "recorder overloaded from 2.000 s to 2.600 s: 60 frames of 30 minor frames, "
        "0 rows of truth and 1 lines of the log are missing"
    )
    kept = np.concatenate([bus_rows(range(0, 100), names), bus_rows(range(130, 140), names)])
    assert recording.bus.tobytes() == kept.tobytes()


def test_the_caller_never_waits_for_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = Gate(monkeypatch)
    recorder = Recorder(tmp_path / "a.mcap", {}, DBC, queue_bytes=100_000)
    rows, truth = bus_rows(range(5)), truth_rows(range(5))
    begun = time.perf_counter()
    for _ in range(1000):
        recorder.write_bus(rows)
        recorder.write_truth(truth)
    assert time.perf_counter() - begun < 2.0  # with the disk stuck all the while
    assert recorder.dropped.frames > 0 and recorder.dropped.truth_rows > 0
    gate.opened.set()
    recorder.close("end condition")


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, float("nan"), 1001.0])
def test_an_impossible_sample_rate_is_refused(tmp_path: Path, rate_hz: float) -> None:
    with pytest.raises(RecordingError, match=r"telemetry rate is .* allowed above 0 to 1000\.0 Hz"):
        Recorder(tmp_path / "a.mcap", {}, DBC, telemetry_rate_hz=rate_hz)
    assert not (tmp_path / "a.mcap").exists()


def test_a_recording_without_a_dbc_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="0 DBC files to attach, wanted is one"):
        Recorder(tmp_path / "a.mcap", {}, {})


@pytest.mark.parametrize("t_s", [-0.02, float("nan"), 2e9])
def test_an_impossible_time_ends_the_recording_not_the_flight(tmp_path: Path, t_s: float) -> None:
    told: list[str] = []
    rows = bus_rows(range(2))
    recorder = Recorder(tmp_path / "a.mcap", {}, DBC, on_failure=told.append)
    recorder.write_bus(rows)
    rows["t_s"] = t_s
    recorder.write_bus(rows)
    recorder.close("end condition")
    assert len(told) == 1 and "allowed 0.0 to 1000000000.0" in told[0]
    assert not open_recording(tmp_path / "a.mcap").is_complete


def test_an_error_of_the_recorder_itself_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    monkeypatch.setattr(RecordingWriter, "write", lambda *_: 1 // 0)
    told: list[str] = []
    recorder = Recorder(tmp_path / "a.mcap", {}, DBC, on_failure=told.append)
    recorder.write_bus(bus_rows(range(2)))
    recorder.close("end condition")
    assert told == ["a.mcap: recording ended at 0.000 s, the recorder itself failed"]
    assert recorder.failure == told[0]
