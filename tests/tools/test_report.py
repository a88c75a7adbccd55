"""A report says what its campaign's Parquet holds, and needs no other file."""

import json
import math
import re
import shlex
from xml.etree import ElementTree

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.stats import beta

from tests.tools.made_campaigns import BOTH, BOUND, GAMMA, MASS, make
from tests.tools.pages import Page, number
from tools.cli import main

N = 1705
SIZE_MAX = 3_000_000


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make(tmp_path_factory.mktemp("made") / "lqy", N)


@pytest.fixture(scope="module")
def page(folder):
    assert main(["report", str(folder)]) == 0
    return Page((folder / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def results(folder):
    table = pq.read_table(folder / "results.parquet")
    return {name: table[name].to_numpy() for name in table.column_names}


def test_the_file_is_whole_by_itself_and_small(page):
    assert len(page.text.encode()) < SIZE_MAX
    assert not re.search(r"https?:|<script|<link|@import|url\(", page.text)
    assert len(page.ids) == len(set(page.ids))
    assert len(page.pictures) == 4  # corridor, distributions, scatter, sensitivities
    for picture in page.pictures:
        assert ElementTree.fromstring(picture).tag.endswith("svg")
        assert not re.search(rb'href="(?!#|data:)', picture)


def test_the_keys_set_for_every_flight_are_told(page):
    rows = page.tables["What was flown"]
    assert ["end.speed_mps", "2400", "m/s"] in rows
    assert ["design.lqy.lead_s", "12.5", "s"] in rows


def test_flights_that_exceeded_limits_are_told_by_limit(page, results):
    flux = results["heat_flux_max_ratio"]
    classes = {row[0]: row[1] for row in page.tables["Outcome classes"]}
    beyond, both = f"{(flux > BOUND).sum():,}", f"{(flux > BOTH).sum():,}"
    assert classes["limit exceeded"] == classes["by its heat flux"] == beyond
    assert classes["by its load factor"] == both
    assert "by its dynamic pressure" not in classes
    (worst,) = [row for row in page.tables["Worst cases"] if row[0].startswith("flux within")]
    assert worst[5] == "limit exceeded: heat flux, load factor"


def test_no_cell_holds_a_negative_zero(page):
    cells = [cell for rows in page.tables.values() for row in rows for cell in row]
    assert not [cell for cell in cells if re.fullmatch(r"-0(\.0*)?( %)?", cell)]


def test_texts_of_a_mission_are_no_markup(page):
    assert "A campaign &lt;made&gt; &amp; judged" in page.text


@pytest.mark.parametrize(
    ("title", "key"),
    [("heat load", "heat_load_mjpm2"), ("ground range", "ground_range_km"),
     ("peak load factor", "load_factor_max_g")],
)  # fmt: skip
def test_order_statistics_are_those_of_the_parquet(page, results, title, key):
    values = np.sort(results[key])
    row = page.row("All metrics", title)
    assert number(row[1]) == N
    wanted = [values[max(math.ceil(q * N) - 1, 0)] for q in (0.0, 0.05, 0.5, 0.95, 1.0)]
    wanted += [sum(values) / N, np.std(values, ddof=1)]
    half_digit = 0.5 * 10.0 ** -len(row[2].partition(".")[2]) * 1.001
    assert [number(cell) for cell in row[2:9]] == pytest.approx(wanted, abs=half_digit)


def test_a_requirement_is_judged_by_its_failures(page, results):
    failures = int((results["heat_flux_max_ratio"] > BOUND).sum())
    row = page.row("Requirements", "flux within 5 %")
    assert 0 < failures < N
    assert row[4] == f"{failures} of 1,705"
    assert number(row[5]) == pytest.approx(
        100.0 * beta.ppf(0.1, N - failures, failures + 1), abs=0.05
    )
    assert row[9] == ("✓ met" if beta.ppf(0.1, N - failures, failures + 1) >= 0.9 else "✗ not met")
    assert int(row[7]) == int(results["run"][np.argmax(results["heat_flux_max_ratio"])])


def test_an_order_statistic_bounds_what_was_shown(page, results):
    lowest = np.sort(results["ground_range_km"])[0]  # 1,705 flights show 99.865 % with no failure
    row = page.row("Requirements", "range of 5,000 km")
    assert row[3] == "99.865 % at 90 %"
    assert row[6].startswith("≥ ")
    assert number(row[6][2:]) == pytest.approx(lowest, abs=0.5)
    assert row[9] == "✓ met"


def test_outcome_classes_are_counted(page, results):
    exceeded = int((results["outcome_class"] == "limit exceeded").sum())
    assert number(page.row("Outcome classes", "limit exceeded")[1]) == exceeded
    none = page.row("Outcome classes", "skip-out")
    assert none[1] == "0"
    assert number(none[3]) == pytest.approx(100.0 * (1.0 - 0.1 ** (1.0 / N)), abs=0.005)


def test_worst_runs_come_with_the_command_that_flies_them(page, results, folder):
    order = np.argsort(-results["heat_flux_max_ratio"])[:3]
    rows = page.tables["Worst cases"]
    at = next(i for i, row in enumerate(rows) if row[0].startswith("flux within 5 %"))
    assert [int(row[2]) for row in rows[at : at + 3]] == (order + 1).tolist()
    command = f"aeroshell fly --from {shlex.quote(str(folder))} --run {order[0] + 1}"
    assert rows[at][6] == command


def test_what_is_the_same_in_every_flight_is_told_once(page):
    assert "frames rejected 0" in page.text
    assert not [row for row in page.tables["All metrics"] if row[0] == "frames rejected"]


def test_sensitivities_name_the_keys_that_drive_a_metric(page):
    row = page.row("Sensitivities", "ground range")
    assert row[1].startswith("entry.flight_path_angle +1.00")
    assert number(row[2]) == 1.0
    square = page.row("Sensitivities", "peak load factor")  # of the mass squared
    assert number(square[2]) < 0.05
    assert "not monotone" in square[4]


def test_dispersed_keys_are_told_as_drawn(page, folder):
    drawn = pq.read_table(folder / "samples.parquet")
    for key in (MASS, GAMMA):
        row = page.row("What was flown", key)
        values = drawn[key].to_numpy()
        assert number(row[1]) == pytest.approx(values.min(), rel=1e-4)
        assert number(row[3]) == pytest.approx(values.max(), rel=1e-4)


def test_laws_are_compared_flight_by_flight(folder, tmp_path, monkeypatch):
    other = make(tmp_path / "other", N, "nominal", shift=1.0)
    monkeypatch.chdir(tmp_path)
    assert main(["report", str(folder), str(other)]) == 0
    compared = Page((tmp_path / "comparison.html").read_text(encoding="utf-8"))
    load = next(
        row for row in compared.tables["Paired differences, flight by flight on the same sample"]
        if row[0] == "heat load"
    )  # fmt: skip
    assert load[1:3] == ["nominal less lqy", "1,705"]
    assert [number(cell) for cell in load[3:6]] == [-20.0] * 3
    assert load[6:9] == ["-20 to -20", "100.0 %", "0.0 %"]
    assert len(compared.pictures) == 5
    flux = next(r for r in compared.tables["Comparison"] if r[0].startswith("peak heat flux"))
    assert flux[1] == "lqy"


def test_a_campaign_in_progress_is_reported_as_far_as_it_is(tmp_path):
    made = make(tmp_path / "made", 12)
    rows = pq.read_table(made / "results.parquet").to_pylist()
    (made / "results.parquet").unlink()
    (made / "profiles.parquet").unlink()
    rows[4] = {"run": 5, "seed": 1, "outcome": "not flown: x", "outcome_class": "numerical"}
    lines = [json.dumps(rows[i]) for i in (7, 4, 2, 9, 0)]
    (made / "flights.jsonl").write_text("\n".join(lines) + '\n{"run": 11, "heat')
    assert main(["report", str(made)]) == 0
    page = Page((made / "report.html").read_text(encoding="utf-8"))
    assert "incomplete: 5 of 12 flights have been flown" in page.text
    assert "the corridor is not drawn" in page.text
    flux = page.row("Requirements", "flux within 5 %")
    told = [rows[i]["heat_flux_max_ratio"] for i in (7, 2, 9, 0)]
    assert flux[4] == f"{sum(v > BOUND for v in told) + 1} of 5"  # the one not flown counts
    assert flux[7] == "5"
    lost = page.row("Worst cases", "not flown to an end")
    assert lost[1:3] == ["not flown: x", "5"]
    assert number(page.row("All metrics", "heat load")[1]) == 4
