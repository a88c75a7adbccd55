"""One run of a campaign: the records it flies, flown again, and what goes wrong with it."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from flight_sw.errors import FlightError, MissionError
from sim_harness.flight.outcomes import limits_exceeded, outcome_class
from sim_harness.mission.mission import find
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.missions import load_mission
from tools.campaign.engine import run_campaign
from tools.campaign.folder import decoded
from tools.campaign.job import Flyer, Run, job_of
from tools.campaign.plan import Wanted, encoded, plan_of
from tools.cli import application

pytestmark = pytest.mark.jit_only

SHORT = Wanted("hyperion-1", "operational", 2, 1, "lqy", ("end.time_max_s=10",))
TEXT = find("hyperion-1").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return run_campaign(SHORT, tmp_path_factory.mktemp("campaign"), jobs=2)


@pytest.fixture
def own(tmp_path):
    """A mission of one's own, with a text put before its dispersion sets."""

    def write(text: str, old: str = "", new: str = "") -> str:
        path = tmp_path / "own.toml"
        changed = TEXT.replace('law = "lqy"', f'law = "lqy"\ngains = "{gains()}"').replace(old, new)
        path.write_text(changed.replace("[judgement]", f"{text}\n[judgement]", 1), encoding="utf-8")
        return str(path)

    def gains() -> Path:
        return load_mission("hyperion-1").gains_folder

    return write


def aeroshell(*arguments: str):
    return CliRunner().invoke(application(), list(arguments))


def test_a_run_flies_the_records_of_a_mission_loaded_with_its_overrides():
    overrides = {"vehicle.mass_kg": 431.0, "entry.speed_mps": 7790.5, "wind.east_mps": 12.0}
    job, _ = job_of("hyperion-1", "lqy", [], None)
    fast = Flyer(job).prepared(Run(1, overrides, 7, {})).mission
    slow = load_mission("hyperion-1", overrides)
    assert world_of(fast, 7).tobytes() == world_of(slow, 7).tobytes()
    assert truth_of(fast, 7).tobytes() == truth_of(slow, 7).tobytes()


def test_what_the_computer_is_told_of_changes_its_load(flown):
    assert len(set(flown.results["load_crc32"].to_pylist())) == 2


@pytest.mark.parametrize("bus", ["memory", "unix"])
def test_a_run_flown_again_has_the_same_commands(flown, tmp_path, bus):
    told = aeroshell(
        "fly", "--from", str(flown.folder), "--run", "2", "--bus", bus, "--no-record",
        "--out", str(tmp_path / bus), "--json",
    )  # fmt: skip
    assert told.exit_code == 0, told.output
    summary = json.loads((tmp_path / bus / "summary.json").read_text())
    row = flown.results.slice(1, 1).to_pylist()[0]
    own = ("run", "frames_sent", "frames_received")  # on a bus both ends announce themselves
    assert {k: row[k] for k in row if k not in own} == {k: summary[k] for k in row if k not in own}
    assert "the same commands, bit by bit" in told.output


def test_commands_that_differ_from_the_campaigns_are_told(flown, tmp_path):
    folder = tmp_path / "campaign"
    shutil.copytree(flown.folder, folder)
    place = flown.results.column_names.index("command_sha256")
    other = pa.array(["0" * 64] * 2)
    pq.write_table(
        flown.results.set_column(place, "command_sha256", other), folder / "results.parquet"
    )
    told = aeroshell("fly", "--from", str(folder), "--run", "1", "--bus", "memory", "--no-record",
                     "--out", str(tmp_path / "a"))  # fmt: skip
    assert isinstance(told.exception, FlightError)
    assert "had commands 0000000000000000, flown now:" in str(told.exception)


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        (("--run", "3"), "--run is 3, allowed 1 to 2"),
        (("--run", "0"), "--run is 0, allowed 1 to 2"),
        (("--run", "1", "--law", "lqy"), "takes no --law, the campaign says what flew"),
    ],
)
def test_a_run_that_is_not_there_is_refused(flown, arguments, sentence):
    told = aeroshell("fly", "--from", str(flown.folder), *arguments)
    assert sentence in str(told.exception)


def test_a_flight_that_cannot_be_flown_is_kept_and_the_others_go_on(own, tmp_path):
    # A sail whose drag the bus cannot carry where the air is dense, and can where it is not.
    low = "entry.altitude_km = { model = 'uniform', low = -110.0, high = 0.0 }"
    mission = own(f"[dispersions.wide]\n{low}")
    sail = ("end.time_max_s=2", "vehicle.mass_kg=1.0", "vehicle.reference_area_m2=1e3")
    flown = run_campaign(Wanted(mission, "wide", 16, 2, "lqy", sail), tmp_path / "out", 2)
    classes = flown.results["outcome_class"].to_pylist()
    assert 0 < classes.count("numerical") < 16
    assert flown.column("run").tolist() == list(range(1, 17))
    assert flown.manifest["verdict"]["outcome_classes"]["numerical"] == classes.count("numerical")
    # Whatever such a flight tells of itself, it has not kept a requirement.
    for requirement in flown.manifest["verdict"]["requirements"]:
        assert requirement["failures"] >= classes.count("numerical")


@pytest.mark.parametrize(
    ("ratios", "exceeded"),
    [
        ((1.0, 1.0, 1.0), ""),
        ((None, None, None), ""),
        ((1.5, 1.0, None), "heat flux"),
        ((1.0, 1.5, 1.5), "load factor, dynamic pressure"),
        ((math.nan, 0.1, 0.1), "heat flux"),
    ],
)
def test_a_flight_names_the_limits_it_exceeded(ratios, exceeded):
    keys = ("heat_flux_max_ratio", "load_factor_max_ratio", "dynamic_pressure_max_ratio")
    facts = dict(zip(keys, ratios, strict=True))
    assert limits_exceeded(facts, load_mission("hyperion-1").judgement) == exceeded


def test_a_state_that_is_not_a_number_is_numerical():
    facts = {"outcome": "time out", "flight_time_s": 3.0, "final_altitude_km": math.nan}
    assert outcome_class(facts, load_mission("hyperion-1").judgement) == "numerical"


@pytest.mark.parametrize(
    "text, sentence",
    [
        (
            "[dispersions.a]\nvehicle.mas_kg = { model = 'uniform', low = -1.0, high = 1.0 }",
            "dispersions.a.vehicle.mas_kg is not a known key, nearest is vehicle.mass_kg",
        ),
        (
            "[dispersions.a]\nvehicle.mass_kg = { model = 'uniform', low = -500.0, high = 1.0 }",
            "dispersions.a.vehicle.mass_kg reaches -50, which is refused: "
            "own.toml: vehicle.mass_kg is -50, allowed 0.001 to 10000000 kg",
        ),
        (
            "[dispersions.a]\nmass_kg = { model = 'fixed', value = 1.0 }\n"
            "vehicle.mass_kg = { model = 'fixed', value = 1.0 }",
            "dispersions.a names a key twice, allowed one entry a key",
        ),
    ],
)
def test_a_set_that_no_flight_can_take_is_refused(own, text, sentence):
    with pytest.raises(MissionError) as caught:
        plan_of(Wanted(own(text), "a", 4))
    assert sentence in str(caught.value)


@pytest.mark.parametrize("n", [0, -3, 10_000_001])
def test_a_number_of_flights_that_is_none_is_refused(n):
    with pytest.raises(FlightError, match=f"-n is {n}, allowed 1 to 10000000"):
        plan_of(SHORT._replace(n=n))


def test_a_requirement_on_what_no_flight_tells_is_refused_at_the_first(own, tmp_path):
    mission = own("", 'metric = "frames_rejected"', 'metric = "frames_rejectd"')
    wanted = Wanted(mission, "sensitivity", 2, 1, "lqy", ("end.time_max_s=2",))
    with pytest.raises(MissionError, match="frames_rejectd, nearest is frames_rejected"):
        run_campaign(wanted, tmp_path / "out", 1)


def test_infinite_values_pass_through_strict_json():
    tree = {"a": [math.inf, -math.inf], "b": {"c": 1.5, "name": "x"}}
    text = json.dumps(encoded(tree), allow_nan=False)
    assert decoded(json.loads(text)) == tree


def test_a_verdict_can_decide_the_exit_status(flown):
    arguments = ("campaign", "hyperion-1", "--law", "lqy", "-n", "2", "--seed", "1",
                 "--dispersions", "operational", "--set", "end.time_max_s=10",
                 "--out", str(flown.folder))  # fmt: skip
    assert aeroshell(*arguments).exit_code == 0
    failed = aeroshell(*arguments, "--fail-on-verdict")
    assert failed.exit_code == 1
    assert "undecided" in failed.output and "0 of 2" in failed.output


def test_wrong_number_of_jobs_is_refused(tmp_path):
    with pytest.raises(FlightError, match="--jobs is 0, allowed 1 to 1024"):
        run_campaign(SHORT, tmp_path, jobs=0)
    assert not np.any([p.suffix == ".parquet" for p in tmp_path.iterdir()])
