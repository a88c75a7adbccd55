"""A campaign gives the same results however it is flown, and goes on where it was left."""

import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from flight_sw.errors import FlightError
from tests.tools.conftest import SHORT
from tools.campaign import engine
from tools.campaign.engine import run_campaign
from tools.campaign.folder import JOURNAL, PROFILES, RESULTS, SPOOL

pytestmark = pytest.mark.jit_only


@pytest.fixture(scope="module")
def flown(short_campaign):
    return short_campaign


def content(folder: Path) -> bytes:
    return (folder / RESULTS).read_bytes() + (folder / PROFILES).read_bytes()


def test_rows_are_sorted_by_run_and_every_run_differs(flown):
    assert flown.column("run").tolist() == [1, 2, 3, 4, 5, 6]
    assert len(set(flown.column("heat_load_mjpm2").tolist())) == 6
    assert set(flown.column("minor_frames").tolist()) == {500}


def test_threads_do_not_change_the_results(flown, tmp_path):
    run_campaign(SHORT, tmp_path, jobs=3)
    assert content(tmp_path) == content(flown.folder)


class Killed(BaseException):
    pass


def test_a_killed_campaign_goes_on_without_losing_or_repeating_a_flight(
    flown, tmp_path, monkeypatch
):
    def killed(done, n):
        if done == 3:
            raise Killed

    with pytest.raises(Killed):
        run_campaign(SHORT, tmp_path, 1, killed)
    kept = [json.loads(line)["run"] for line in (tmp_path / JOURNAL).read_bytes().splitlines()]
    assert len(kept) == 3
    with (tmp_path / JOURNAL).open("ab") as torn:
        torn.write(b'{"run": 5, "mission"')
    flown_now = []
    fly = engine.fly_in_threads
    monkeypatch.setattr(
        engine, "fly_in_threads",
        lambda plan, runs, jobs: (flown_now.extend(runs), fly(plan, runs, jobs))[1],
    )  # fmt: skip
    run_campaign(SHORT, tmp_path, jobs=2)
    assert sorted(kept + flown_now) == [1, 2, 3, 4, 5, 6]
    assert not (tmp_path / SPOOL).exists()
    assert content(tmp_path) == content(flown.folder)


def test_a_finished_campaign_is_not_flown_again(flown):
    before = (flown.folder / RESULTS).stat().st_mtime_ns
    again = run_campaign(SHORT, flown.folder)
    assert again.manifest == flown.manifest
    assert (flown.folder / RESULTS).stat().st_mtime_ns == before


@pytest.mark.parametrize(
    "other, difference",
    [
        (SHORT._replace(law="nominal"), "law lqy (asked for: nominal)"),
        (SHORT._replace(n=7), "n 6 (asked for: 7)"),
        (SHORT._replace(seed=2), "seed 1 (asked for: 2)"),
        (SHORT._replace(dispersions="severe"), "dispersions sensitivity (asked for: severe)"),
        (SHORT._replace(settings=("end.time_max_s=11",)), "mission_hash"),
    ],
)
def test_the_folder_of_another_campaign_is_refused_with_what_differs(flown, other, difference):
    with pytest.raises(FlightError, match="holds a campaign with") as caught:
        run_campaign(other, flown.folder)
    assert difference in str(caught.value)


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(FlightError, match=r"holds thesis\.tex and no campaign\.json"):
        run_campaign(SHORT, tmp_path)
    assert [p.name for p in tmp_path.iterdir() if p.suffix] == ["thesis.tex"]


def test_samples_are_the_same_for_every_law(flown, tmp_path):
    other = run_campaign(SHORT._replace(law="nominal"), tmp_path)
    assert other.samples.equals(flown.samples)
    assert pq.read_table(tmp_path / "samples.parquet").equals(flown.samples)
    assert not other.results.equals(flown.results)
