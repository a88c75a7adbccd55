"""`aeroshell timing` and `aeroshell bench latency`: what they print, draw and refuse."""

import json
import struct
from pathlib import Path

import pytest

from flight_sw.errors import AeroshellError
from tools.cli import main
from tools.commands.bench import BEGIN, END, as_object, replaced, rows_in, table
from tools.flight_timing import QUANTITIES, read_timing
from tools.foreign_traffic import foreign_frames, foreign_identifiers
from tools.latency import Latency

pytestmark = pytest.mark.jit_only

PNG_HEAD = b"\x89PNG\r\n\x1a\n"


def fly(folder: Path, *options: str) -> Path:
    """A short flight."""
    status = main(
        ["fly", "hyperion-1", "--set", "time_max_s=20", *options, "--json", "--out", str(folder)]
    )
    assert status == 0
    return folder


@pytest.fixture(scope="module")
def paced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight against the clock."""
    return fly(tmp_path_factory.mktemp("paced"), "--pace", "20x")


@pytest.fixture(scope="module")
def lockstep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight without a clock."""
    return fly(tmp_path_factory.mktemp("lockstep"), "--bus", "memory")


def test_recording_and_summary_tell_the_same(paced: Path) -> None:
    summary, recording = (read_timing(paced / name) for name in ("summary.json", "flight.mcap"))
    assert summary._replace(source="") == recording._replace(source="")
    assert [quantity.title for quantity in summary.measured] == [q[0] for q in QUANTITIES]


def test_every_frame_is_in_every_distribution_of_the_harness(paced: Path) -> None:
    told = read_timing(paced)
    by_title = {quantity.title: quantity for quantity in told.measured}
    for title in ("wake-up of the harness", "round trip"):
        assert sum(n for _, n in by_title[title].bins_us) == told.flown["minor_frames"]
    for quantity in told.measured:
        p50, p99, p999, longest = (quantity.percentiles_us[k] for k in quantity.percentiles_us)
        assert p50 <= p99 <= p999 <= longest


def test_numbers_are_printed(paced: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["timing", str(paced)]) == 0
    told = capfd.readouterr().out
    summary = json.loads((paced / "summary.json").read_text())
    assert "pace 20x, reached" in told
    assert "period            1,000.0 us" in told
    assert f"late commands  {summary['late_commands']:8,}" in told
    longest = summary["timing"]["harness"]["round_trip_us"]["max"]
    assert f"{longest:,.1f}" in told


def test_json_is_one_object(paced: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["timing", str(paced / "flight.mcap"), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["pace"] == "20x"
    assert len(found["measured"]) == len(QUANTITIES)


def test_a_lockstep_flight_has_a_step_and_says_so(
    lockstep: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["timing", str(lockstep), "--png", str(tmp_path / "x.png")]) == 0
    told = capfd.readouterr().out
    assert "no clock, so no deadlines: only the step was measured" in told
    assert "round trip" not in told
    assert "wake-up" not in told


def test_the_picture_is_a_png_of_readable_size(paced: Path, tmp_path: Path) -> None:
    assert main(["timing", str(paced), "--png", str(tmp_path / "x.png")]) == 0
    content = (tmp_path / "x.png").read_bytes()
    assert content.startswith(PNG_HEAD)
    width, height = struct.unpack(">II", content[16:24])
    assert width >= 600
    assert height >= 600


def test_info_leaves_the_timing_to_timing(paced: Path, capfd: pytest.CaptureFixture[str]) -> None:
    from tools.commands.info import info

    info(paced / "flight.mcap")
    told = capfd.readouterr().out
    assert "bins_us" not in told
    assert "time out" in told


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (None, "cannot be read"),
        ("not json", "is not JSON"),
        ("[1]", "is no summary of a flight"),
        ('{"pace": "realtime"}', "holds no timing, or one of another version"),
    ],
)
def test_what_is_no_flight_is_refused_in_a_sentence(
    content: str | None, why: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.json"
    if content is not None:
        path.write_text(content)
    assert main(["timing", str(path)]) == 1
    told = capfd.readouterr().err
    assert why in told
    assert told.count("\n") == 1


def test_an_empty_folder_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["timing", str(tmp_path)]) == 1
    assert "holds neither summary.json nor flight.mcap" in capfd.readouterr().err


def test_a_recording_that_was_cut_off_has_no_timing(
    paced: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = (paced / "flight.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    assert main(["timing", str(tmp_path / "cut.mcap")]) == 1
    assert "holds no timing, its recorder was cut off" in capfd.readouterr().err


def test_a_picture_that_cannot_be_written_is_refused(
    paced: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["timing", str(paced), "--png", str(tmp_path / "none" / "x.png")]) == 1
    assert "cannot be written" in capfd.readouterr().err


PERCENTILES_US = {"p50": 1.0, "p99": 2.5, "p999": 1234.56, "max": 9e3}
ROW = Latency("unix", "full rate", 2500, 3, 7400.0, PERCENTILES_US)


def test_the_table_is_markdown_with_a_row_a_measurement() -> None:
    lines = table([ROW, ROW._replace(bus="memory", foreign_rate_hz=0.0)]).splitlines()
    assert len(lines) == 4
    assert lines[2] == ("| unix | 7,400 frames/s | 1.0 | 2.5 | 1,234.6 | 9,000.0 | 2,500 | 3 |")
    assert lines[3].startswith("| memory | none |")
    assert len({line.count("|") for line in lines}) == 1


def test_the_table_goes_between_its_markers_and_nowhere_else(tmp_path: Path) -> None:
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    text = replaced(readme, "new")
    assert text == f"before\n{BEGIN}\n\nnew\n\n{END}\nafter\n"
    readme.write_text("no markers\n")
    with pytest.raises(AeroshellError, match="has no lines"):
        replaced(readme, "new")


def test_rows_measured_elsewhere_follow_ours(tmp_path: Path) -> None:
    percentiles_us = {"p50": 1.0, "p99": 2.0, "p999": 3.0, "max": 4.0}
    row = Latency("socketcan:vcan0 (a box)", "idle", 1000, 2, 0.0, percentiles_us)
    rows = tmp_path / "rows.json"
    rows.write_text(json.dumps(as_object([row], 20.0)))
    assert rows_in(rows) == [row]
    assert "| socketcan:vcan0 (a box) | none | 1.0 | 2.0 | 3.0 | 4.0 | 1,000 | 2 |" in table([row])


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"rows": [{"bus": "unix"}]}'])
def test_rows_that_are_none_are_refused(text: str, tmp_path: Path) -> None:
    rows = tmp_path / "rows.json"
    rows.write_text(text)
    with pytest.raises(AeroshellError, match="is not what --json prints"):
        rows_in(rows)


def test_foreign_identifiers_are_nobodys() -> None:
    from flight_sw import icd

    ours = {message.can_id for message in icd.LAYOUT}
    assert not ours & set(foreign_identifiers())
    assert not ours & set(foreign_frames(64)["can_id"].tolist())


@pytest.mark.alone
@pytest.mark.slow
def test_latency_is_measured_on_every_bus(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "latency", "--seconds", "2", "--json"]) == 0
    rows = json.loads(capfd.readouterr().out)["rows"]
    assert [(row["bus"], row["traffic"]) for row in rows][:3] == [
        ("memory", "idle"), ("unix", "idle"), ("unix", "full rate"),
    ]  # fmt: skip
    assert rows[2]["foreign_rate_hz"] == pytest.approx(7400.0, rel=0.02)
    assert all(row["sets"] == 500 for row in rows)
