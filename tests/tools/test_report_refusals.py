"""What a report refuses, each in one sentence, and leaves as it was."""

import json

import pyarrow.parquet as pq
import pytest

from tests.tools.made_campaigns import make
from tools.cli import main


@pytest.fixture
def made(tmp_path):
    return make(tmp_path / "made", 6)


def refusal(capsys, *arguments) -> str:
    assert main(["report", *map(str, arguments)]) == 1
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.count("\n") == 1
    return told.err


def test_a_folder_that_is_not_there(tmp_path, capsys):
    assert "does not exist, allowed is the folder of a campaign" in refusal(capsys, tmp_path / "x")


def test_a_file(made, capsys):
    assert "is a file" in refusal(capsys, made / "results.parquet")


def test_a_folder_of_something_else(tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("x")
    assert "no campaign there" in refusal(capsys, tmp_path)


def test_a_manifest_of_something_else(made, capsys):
    (made / "campaign.json").write_text("[1, 2]")
    assert "campaign.json: is [1, 2]: not a campaign's manifest" in refusal(capsys, made)
    (made / "campaign.json").write_text("{}")
    assert "campaign.json: says no identity" in refusal(capsys, made)
    (made / "campaign.json").write_text("{")
    assert "not JSON" in refusal(capsys, made)


def test_a_campaign_without_results(made, capsys):
    (made / "results.parquet").unlink()
    assert "has no results" in refusal(capsys, made)
    (made / "flights.jsonl").write_text('{"run": 1, "mis')
    assert "no flight of it has ended" in refusal(capsys, made)


@pytest.mark.parametrize("name", ["results.parquet", "samples.parquet", "profiles.parquet"])
def test_a_damaged_parquet_file(made, capsys, name):
    raw = (made / name).read_bytes()
    for damaged in (raw[: len(raw) // 2], raw[:40] + b"\xff" * 40 + raw[80:-200], b""):
        (made / name).write_bytes(damaged)
        assert f"{name}: cannot be read" in refusal(capsys, made)


def test_results_that_are_not_all_there(made, capsys):
    path = made / "results.parquet"
    table = pq.read_table(path)
    pq.write_table(table.slice(0, 4), path)
    assert "has 4 flights, campaign.json says 6" in refusal(capsys, made)
    pq.write_table(table.drop_columns(["outcome_class"]), path)
    assert "has no column outcome_class" in refusal(capsys, made)


def test_other_samples(made, tmp_path, capsys):
    other = make(tmp_path / "other", 6, "nominal", seed=2)
    told = refusal(capsys, made, other)
    assert "flew other samples than" in told
    assert "seed 2 (not 1)" in told


def test_samples_that_only_claim_to_be_the_same(made, tmp_path, capsys):
    other = make(tmp_path / "other", 6, "nominal", seed=2)
    manifest = json.loads((other / "campaign.json").read_text())
    manifest["identity"] |= {"seed": 1, "samples_hash": f"{1:016x}"}
    (other / "campaign.json").write_text(json.dumps(manifest))
    assert "flew other samples than" in refusal(capsys, made, other)


def test_a_folder_named_twice(made, capsys):
    assert "is named twice" in refusal(capsys, made, made)


def test_an_output_that_exists_or_cannot_be(made, tmp_path, capsys):
    (made / "report.html").write_text("kept")
    assert "exists already, --force replaces it" in refusal(capsys, made)
    assert (made / "report.html").read_text() == "kept"
    assert "there is no folder" in refusal(capsys, made, "--out", tmp_path / "no" / "x.html")
    assert "ends in .html" in refusal(capsys, made, "--out", tmp_path / "x.pdf")
