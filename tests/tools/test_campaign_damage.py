"""Campaign folders that are damaged: told in one sentence, what is whole is kept."""

import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from flight_sw.errors import AeroshellError, FlightError
from sim_harness.mission.documents import JSON_BYTES_MAX
from sim_harness.mission.mission import GAINS
from tests.tools.made_campaigns import make
from tools.campaign.columns import read_columns
from tools.campaign.engine import run_campaign
from tools.campaign.folder import (
    LINE_BYTES_MAX,
    is_whole,
    journal_lines,
    read_journal,
    read_manifest,
    read_results,
    read_samples,
)
from tools.campaign.plan import Wanted, plan_of
from tools.campaign.profiles import FIELDS, Spool, read_profiles
from tools.campaign.store import Store
from tools.cli import main

CASES = Path(__file__).parent / "cases"
N = 6
ROW = {"run": 2, "outcome": "ground", "outcome_class": "short", "command_sha256": "0" * 64}
WANTED = Wanted("hyperion-1", "sensitivity", 4, 1, "nominal")


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """A finished campaign of six flights."""
    folder = make(tmp_path / "made", N)
    shutil.copy(GAINS / "hyperion-1" / "lqy.load", folder)
    return folder


@pytest.fixture
def unfinished(made: Path) -> Path:
    """The same, four of its flights in the journal."""
    rows = pq.read_table(made / "results.parquet").to_pylist()[:4]
    (made / "flights.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    (made / "results.parquet").unlink()
    (made / "profiles.parquet").unlink()
    return made


def refusals(folder: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """What those who read a campaign say of it, each in one sentence."""
    found = []
    for command in (
        ["report", str(folder), "--force"],
        ["fly", "--from", str(folder), "--run", "2", "--bus", "memory", "--no-record"],
    ):
        assert main(command) == 1
        told = capsys.readouterr()
        assert told.err.count("\n") == 1
        assert told.err[:-1].isprintable()
        assert len(told.err) < 500
        found.append(told.err)
    return found


def change_manifest(folder: Path, path: str, value: Any) -> None:
    """Put a value at a dotted place of campaign.json."""
    tree = json.loads((folder / "campaign.json").read_text())
    *parents, leaf = path.split(".")
    table = tree
    for parent in parents:
        table = table[parent]
    table[leaf] = value
    (folder / "campaign.json").write_text(json.dumps(tree))


@pytest.mark.parametrize(
    "raw",
    [
        b"null", b"", b"{", b"[1, 2]", b'"x"', b"1e999", b"\xff\xfe", b"[" * 100_000,
        b'{"identity": ' * 60 + b"1" + b"}" * 60, b'{"identity": {"n": ' + b"9" * 5000 + b"}}",
        b" " * (JSON_BYTES_MAX + 1), b'{"identity": null}', b'{"identity": {}, "job": []}',
        b'{"title": "\\ud800"}',
    ],
    ids=range(14),
)  # fmt: skip
def test_a_manifest_that_is_none_is_told(
    raw: bytes, made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (made / "campaign.json").write_bytes(raw)
    for told in refusals(made, capsys):
        assert "campaign.json" in told


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("identity.law", "../../lqy"), ("identity.law", None), ("job.law", "../../lqy"),
        ("identity.n", 0), ("identity.n", 10**9), ("identity.n", 6.0), ("identity.n", True),
        ("identity.n", "6"), ("identity.seed", -1), ("identity.seed", 1e300), ("job", None),
        ("job.mission_tree", []), ("job.mission_tree", None), ("job.law", "nominal"),
        ("requirements", None), ("requirements", [None]), ("requirements", [{"metric": 5}]),
        ("requirements", [{"metric": "x", "max": 1.0, "probability": 2.0}]),
        ("told_to_both", "abc"), ("told_to_both", [1]), ("title", {"a": 1}), ("state", "x" * 9000),
        ("job.mission_tree.atmosphere", {"model": "table", "csv": "../../../etc/hosts"}),
        ("identity.mission", ["\u001b[2J"]), ("verdict", 5),
    ],
)  # fmt: skip
def test_a_manifest_with_a_wrong_value_is_told(
    place: str, value: Any, made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change_manifest(made, place, value)
    for told in refusals(made, capsys):
        assert "campaign.json: " in told


@pytest.mark.parametrize("name", ["campaign-manifest-null", "campaign-results-truncated"])
def test_the_kept_campaigns_are_told(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(CASES / name, tmp_path / name)
    shutil.copy(GAINS / "hyperion-1" / "lqy.load", tmp_path / name)  # of today's layout
    damaged = "campaign.json" if "manifest" in name else "results.parquet"
    for told in refusals(tmp_path / name, capsys):
        assert f"{damaged}: " in told
    kept = [path for path in (CASES / name).iterdir() if path.suffix != ".load"]
    assert all((tmp_path / name / p.name).read_bytes() == p.read_bytes() for p in kept)
    assert sorted(p.name for p in (tmp_path / name).iterdir() if p.suffix != ".load") == sorted(
        p.name for p in (CASES / name).iterdir()
    )


def with_column(path: Path, name: str, values: pa.Array | None) -> None:
    table = pq.read_table(path)
    place = table.column_names.index(name)
    table = table.remove_column(place)
    if values is not None:
        table = table.add_column(place, name, values)
    pq.write_table(table, path)


@pytest.mark.parametrize(
    ("name", "column", "values"),
    [
        ("results.parquet", "run", None),
        ("results.parquet", "run", pa.array([2, 1, 3, 4, 5, 6])),
        ("results.parquet", "run", pa.array([1.0, 2.0, 3.0, None, 5.0, 6.0])),
        ("results.parquet", "run", pa.array(list("abcdef"))),
        ("results.parquet", "outcome_class", pa.array(["nominal"] * 5 + ["lost"])),
        ("results.parquet", "outcome_class", pa.array(["nominal"] * 5 + [None])),
        ("results.parquet", "outcome_class", pa.array([1] * 6)),
        ("results.parquet", "heat_load_mjpm2", pa.array(["much"] * 6)),
        ("results.parquet", "heat_load_mjpm2", pa.array([[1.0]] * 6)),
        ("results.parquet", "heat_load_mjpm2", pa.array([{"a": 1}] * 6)),
        ("results.parquet", "heat_load_mjpm2", pa.array([0] * 6, pa.timestamp("s"))),
        ("samples.parquet", "run", pa.array([1, 2, 3, 4, 5, 5])),
        ("samples.parquet", "seed", pa.array([-1] * 6)),
        ("samples.parquet", "seed", pa.array([0.5] * 6)),
        ("samples.parquet", "vehicle.mass_kg", pa.array(["heavy"] * 6)),
    ],
)  # fmt: skip
def test_a_column_that_is_not_what_it_should_be_is_told(
    name: str, column: str, values: Any, made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_column(made / name, column, values)
    assert main(["report", str(made)]) == 1
    told = capsys.readouterr().err
    assert f"{name}: " in told
    assert told.count("\n") == 1


@pytest.mark.parametrize("name", ["results.parquet", "samples.parquet", "profiles.parquet"])
def test_no_flipped_byte_is_taken_for_a_number(name: str, made: Path) -> None:
    """Every page bears a checksum; the footer, which names the columns, has none."""
    table = pq.read_table(made / name)
    pq.write_table(table, made / name, write_page_checksum=True)
    whole = (made / name).read_bytes()
    manifest = read_manifest(made)
    read = {
        "results.parquet": lambda: read_results(made, manifest),
        "samples.parquet": lambda: read_samples(made, manifest),
        "profiles.parquet": lambda: altitudes(made),
    }[name]
    before = read()
    told = 0
    end = len(whole) - 8 - int.from_bytes(whole[-8:-4], "little")
    for place in range(0, end, max(end // 100, 1)):
        damaged = bytearray(whole)
        damaged[place] ^= 0x10
        (made / name).write_bytes(damaged)
        try:
            assert same(read(), before), place
        except AeroshellError:
            told += 1
    assert told > 50


def altitudes(folder: Path) -> np.ndarray:
    """Of a campaign's profiles."""
    return read_profiles(folder, N).fields["alt_m"].copy()


def same(a: Any, b: Any) -> bool:
    """Whether what was read is equal, column by column where it is a table."""
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b, equal_nan=True)
    return a.column_names == b.column_names and all(
        a[name].combine_chunks().equals(b[name].combine_chunks()) for name in a.column_names
    )


def test_a_small_file_that_claims_much_is_refused_before_it_is_read(tmp_path: Path) -> None:
    n = 3_000_000
    columns = {f"c{i}": pa.array(np.zeros(n)) for i in range(20)}
    pq.write_table(pa.table({"run": pa.array(np.zeros(n, int)), **columns}), tmp_path / "a.parquet")
    assert (tmp_path / "a.parquet").stat().st_size < 400_000
    taken = pa.total_allocated_bytes()
    with pytest.raises(FlightError, match="that claim to hold"):
        read_columns(tmp_path / "a.parquet", n, ("run",), "it")
    assert pa.total_allocated_bytes() <= taken + 1_000_000
    texts = pa.array(["x" * 1_000_000] * 1000)
    pq.write_table(pa.table({"run": range(1000), "outcome": texts}), tmp_path / "b.parquet")
    assert (tmp_path / "b.parquet").stat().st_size < 3_000_000
    with pytest.raises(FlightError, match="cannot be read"):
        read_columns(tmp_path / "b.parquet", 1000, ("run",), "it")


def test_a_text_that_no_flight_told_is_read_whatever_kind_it_was_kept_as(made: Path) -> None:
    for kind in (pa.float64(), pa.string(), pa.null()):
        table = pq.read_table(made / "results.parquet")
        if "end_trigger" in table.column_names:
            table = table.drop_columns(["end_trigger"])
        table = table.append_column("end_trigger", pa.nulls(N, kind))
        pq.write_table(table, made / "results.parquet")
        found = read_results(made, read_manifest(made))
        assert found["end_trigger"].to_pylist() == [None] * N


# --- the journal -------------------------------------------------------------------------------

NOT_WHOLE = [
    b"", b"null", b"5", b"[]", b"{}", b'{"run": 2}', b"\xff\xff", b"[" * 5000,
    json.dumps({**ROW, "run": 0}).encode(), json.dumps({**ROW, "run": 7}).encode(),
    json.dumps({**ROW, "run": True}).encode(), json.dumps({**ROW, "run": 2.0}).encode(),
    json.dumps({**ROW, "run": None}).encode(), json.dumps({**ROW, "outcome_class": "x"}).encode(),
    json.dumps({**ROW, "outcome": 1}).encode(), json.dumps({**ROW, "a": "x"}).encode(),
    json.dumps({**ROW, "heat_load_mjpm2": [1]}).encode(), json.dumps({**ROW, "a": 2**64}).encode(),
    json.dumps({**ROW, "command_sha256": None}).encode(), json.dumps(ROW)[:-1].encode(),
    json.dumps({**ROW, "outcome": "x" * LINE_BYTES_MAX}).encode(),
]  # fmt: skip


@pytest.mark.parametrize("line", NOT_WHOLE, ids=range(len(NOT_WHOLE)))
def test_a_line_that_is_no_whole_result_is_a_flight_not_flown(line: bytes, tmp_path: Path) -> None:
    journal = tmp_path / "flights.jsonl"
    whole = [json.dumps({**ROW, "run": run}).encode() for run in (1, 3)]
    journal.write_bytes(b"\n".join([whole[0], line, whole[1], line]))
    found = list(journal_lines(journal, N))
    assert [line.row["run"] for line in found] == [1, 3]
    content = journal.read_bytes()
    assert [json.loads(content[x.offset :].split(b"\n")[0]) for x in found] == [
        x.row for x in found
    ]
    assert read_journal(tmp_path, N)["run"].to_pylist() == [1, 3]


def test_a_flight_that_was_not_flown_is_a_whole_result() -> None:
    told = {"run": 1, "seed": 5, "outcome": "not flown: x", "outcome_class": "numerical"}
    assert is_whole(told, N)
    assert is_whole({**ROW, "heat_load_mjpm2": float("nan"), "bank_reversals": None}, N)


def test_of_a_run_told_twice_the_last_counts(tmp_path: Path) -> None:
    rows = [{**ROW, "run": run, "a": float(i)} for i, run in enumerate([2, 1, 2])]
    (tmp_path / "flights.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert read_journal(tmp_path, N).select(["run", "a"]).to_pylist() == [
        {"run": 1, "a": 1.0}, {"run": 2, "a": 2.0}
    ]  # fmt: skip


def test_a_damaged_journal_is_reported_as_far_as_it_is_whole(
    unfinished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (unfinished / "flights.jsonl").read_bytes().split(b"\n")
    lines[1] = lines[1][: len(lines[1]) // 2]
    (unfinished / "flights.jsonl").write_bytes(b"\n".join(lines))
    assert main(["report", str(unfinished)]) == 0
    assert "3 of 6 flights have been flown" in (unfinished / "report.html").read_text()


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of four flights as it was flown."""
    return run_campaign(WANTED, tmp_path_factory.mktemp("flown") / "campaign", 1).folder


def interrupted(flown: Path, folder: Path) -> Path:
    """The campaign's folder as it is before its results are made."""
    shutil.copytree(flown, folder)
    rows = pq.read_table(folder / "results.parquet").to_pylist()
    (folder / "flights.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    profiles = read_profiles(folder, len(rows))
    spool = Spool(folder, profiles.speed_mps)
    for i, run in enumerate(profiles.runs):
        spool.add(int(run), b"".join(profiles.fields[name][i].tobytes() for name in FIELDS))
    spool.close()
    for name in ("results.parquet", "profiles.parquet", "verdict.json"):
        (folder / name).unlink()
    return folder


@pytest.mark.parametrize(
    "damage", ["a line", "all lines", "no newline", "profiles", "samples and load"]
)
def test_a_damaged_campaign_goes_on_to_the_same_results(
    damage: str, flown: Path, tmp_path: Path
) -> None:
    folder = interrupted(flown, tmp_path / "campaign")
    journal = folder / "flights.jsonl"
    lines = journal.read_bytes().split(b"\n")[:-1]
    expected = 4
    if damage == "a line":
        lines[1] = b'{"run": 2, ' + b"\x00" * 100
        expected = 3
    elif damage == "all lines":
        lines, expected = [b"\xff" * 50] * 4, 0
    journal.write_bytes(b"\n".join(lines) + (b"" if damage == "no newline" else b"\n"))
    if damage == "no newline":
        expected = 3
    elif damage == "profiles":
        (folder / "profiles.bin").write_bytes((folder / "profiles.bin").read_bytes()[:5000])
    elif damage == "samples and load":
        (folder / "samples.parquet").write_bytes(b"PAR1")
        (folder / "nominal.load").unlink()
    plan = plan_of(WANTED)
    store = Store(folder, plan)
    store.close()
    assert store.flown == expected
    again = run_campaign(WANTED, folder, 1)
    assert again.results.equals(pq.read_table(flown / "results.parquet"))
    assert (folder / "nominal.load").read_bytes() == (flown / "nominal.load").read_bytes()
    assert again.samples.equals(read_samples(flown, read_manifest(flown)))
    profiles, whole = (read_profiles(f, 4).fields["alt_m"] for f in (folder, flown))
    if damage == "profiles":
        lost = np.isnan(profiles).all(axis=1)
        assert lost.tolist() == [False, True, True, True]
        assert np.array_equal(profiles[0], whole[0], equal_nan=True)
    else:
        assert np.array_equal(profiles, whole, equal_nan=True)


def test_a_campaign_does_not_write_through_links(flown: Path, tmp_path: Path) -> None:
    for name in ("flights.jsonl", "profiles.bin", "campaign.json.new", "results.parquet.new"):
        folder = interrupted(flown, tmp_path / f"campaign-{name}")
        outside = tmp_path / f"outside-{name}"
        outside.write_text("mine")
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(outside)
        with pytest.raises(FlightError, match="is no plain file"):
            run_campaign(WANTED, folder, 1)
        assert outside.read_text() == "mine"


def test_what_is_no_plain_file_is_not_waited_for(
    made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("campaign.json", "samples.parquet", "results.parquet", "lqy.load"):
        kept = (made / name).read_bytes()
        (made / name).unlink()
        os.mkfifo(made / name)
        for told in refusals(made, capsys):
            assert name in told
        (made / name).unlink()
        (made / name).write_bytes(kept)
