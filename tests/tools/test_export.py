"""`aeroshell export` writes tables that hold what was recorded, to the last bit."""

import errno
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
import typer
from typer.testing import CliRunner, Result

from flight_sw import icd
from flight_sw.errors import RecordingError
from sim_harness.telemetry.reader import open_recording
from sim_harness.telemetry.recorder import Recorder
from tests.sim_harness.recordings import (
    DATABASE,
    DBC,
    DT_S,
    MANIFEST,
    bus_rows,
    record,
    truth_rows,
    values_of,
)
from tools.commands.export import export
from tools.flight_tables import WRITERS

CYCLES = range(50)


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    record(tmp_path / "flight.mcap", CYCLES)
    return tmp_path / "flight.mcap"


def run(*arguments: str) -> Result:
    app = typer.Typer()
    app.command()(export)
    return CliRunner().invoke(app, arguments)


def read(folder: Path, name: str, form: str) -> dict[str, list]:
    path = folder / f"{name}.{form}"
    table = pyarrow.csv.read_csv(path) if form == "csv" else pyarrow.parquet.read_table(path)
    return table.to_pydict()


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_every_message_is_exported_at_its_full_rate_to_the_bit(flight: Path, form: str) -> None:
    done = run(str(flight), "--format", form)
    folder = flight.with_name(f"flight-{form}")
    assert done.stdout.splitlines() == [
        str(folder / f"{name}.{form}") for name in (*icd.MESSAGES, "truth", "log", "frames")
    ]
    for name in icd.MESSAGES:
        columns = read(folder, name, form)
        assert columns["t_s"] == [cycle * DT_S for cycle in CYCLES]
        message = DATABASE.get_message_by_name(name)
        for cycle in CYCLES:
            data = message.encode(values_of(message, cycle), strict=True)
            wanted = message.decode(data, decode_choices=False)
            for signal in icd.signal_names(name):
                column = columns.get(f"sent_{signal}", columns[signal])
                assert column[cycle] == wanted[signal], (name, signal)


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_truth_is_exported_to_the_bit(flight: Path, form: str) -> None:
    run(str(flight), "--format", form, "--out", str(flight.parent / "tables"))
    columns, flown = read(flight.parent / "tables", "truth", form), truth_rows(CYCLES)[::5]
    for name in ("minor_frames", "t_s", "lon_rad", "lat_rad", "alt_m"):
        assert columns[name] == flown[name].tolist()
    assert columns["held_sin_bank"] == flown["held"]["sin_bank"].tolist()


def test_values_with_names_have_a_column_of_them(flight: Path) -> None:
    run(str(flight))
    columns = read(flight.with_name("flight-parquet"), "FSW_STATUS", "parquet")
    names = dict(icd.layout("FSW_STATUS").signals[1].names)
    assert columns["mode_name"] == [names[value] for value in columns["mode"]]


def test_raw_frames_are_exported_in_the_order_of_their_bytes(flight: Path) -> None:
    run(str(flight))
    columns = read(flight.with_name("flight-parquet"), "frames", "parquet")
    data = b"".join(bytes.fromhex(digits) for digits in columns["data_hex"])
    flown = bus_rows(CYCLES)["frame"]
    assert data == flown["data"].tobytes()
    assert columns["can_id"] == flown["can_id"].tolist()


def test_the_same_recording_gives_the_same_bytes(flight: Path) -> None:
    for folder in ("a", "b"):
        run(str(flight), "--out", str(flight.parent / folder))
    names = [{path.name for path in (flight.parent / folder).iterdir()} for folder in ("a", "b")]
    assert len(names[0]) > 1
    assert names[0] == names[1]
    for path in sorted((flight.parent / "a").iterdir()):
        assert path.read_bytes() == (flight.parent / "b" / path.name).read_bytes()


def test_tables_that_exist_are_kept_unless_forced(flight: Path) -> None:
    out = flight.parent / "tables"
    out.mkdir()
    (out / "truth.csv").write_text("mine")
    arguments = str(flight), "--format", "csv", "--out", str(out)
    refused = run(*arguments)
    assert isinstance(refused.exception, RecordingError)
    assert str(refused.exception).endswith("tables: holds truth.csv already, --force replaces it")
    assert [path.name for path in out.iterdir()] == ["truth.csv"]
    assert run(*arguments, "--force").exit_code == 0
    assert (out / "truth.csv").read_text() != "mine"


def test_an_unknown_format_is_refused_with_those_there_are(flight: Path) -> None:
    refused = run(str(flight), "--format", "xlsx").exception
    assert str(refused) == "--format xlsx: allowed are parquet, csv"


def test_a_folder_that_cannot_be_made_is_refused(flight: Path) -> None:
    refused = run(str(flight), "--out", str(flight / "below")).exception
    assert isinstance(refused, RecordingError)
    assert str(refused).endswith("below: cannot be written, Not a directory")


def test_the_folder_of_a_recording_stands_for_it(
    flight: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(flight.parent)
    for name in (".", str(flight.parent)):
        assert run(name, "--format", "csv", "--force").exit_code == 0
    assert sorted(path.name for path in flight.parent.iterdir()) == ["flight-csv", "flight.mcap"]


def test_a_recording_without_a_row_is_refused(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", MANIFEST, DBC):
        pass
    content = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "a.mcap").write_bytes(content[: content.index(b"aeroshell.outcome")])
    refused = run(str(tmp_path / "a.mcap"))
    assert str(refused.exception).endswith(
        "a.mcap: holds no frame and no sample, nothing to export"
    )
    assert refused.stderr == "" and not (tmp_path / "a-parquet").exists()


def test_a_full_disk_is_told_and_leaves_no_piece_of_a_file(
    flight: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write(table: object, path: Path) -> None:
        path.write_text("t_s")
        if path.name.startswith("NAV_VERTICAL"):
            raise OSError(errno.ENOSPC, "Error writing bytes to file")

    monkeypatch.setitem(WRITERS, "csv", write)
    refused = run(str(flight), "--format", "csv").exception
    assert isinstance(refused, RecordingError)
    assert str(refused).endswith("NAV_VERTICAL.csv: cannot be written, No space left on device")
    left = [path.name for path in flight.with_name("flight-csv").iterdir()]
    assert sorted(left) == ["FSW_COMMAND.csv", "NAV_POSITION.csv"]


def test_a_cut_recording_is_exported_as_far_as_it_goes_and_says_so(flight: Path) -> None:
    content = flight.read_bytes()
    flight.write_bytes(content[: content.index(b"aeroshell.outcome")])
    done = run(str(flight))
    assert "incomplete, exported is the flight until 0.98 s" in done.stderr
    frames = read(flight.with_name("flight-parquet"), "frames", "parquet")
    assert len(frames["t_s"]) == len(open_recording(flight).bus)
    assert np.isclose(frames["t_s"][-1], 0.98)
