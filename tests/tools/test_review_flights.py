"""What the review takes of a flight: its label, target, places and shades, and a drawing that is
whole."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from tests.tools.test_review import Review, run
from tools.review.chart import Chart, Look, Scale
from tools.review.columns import target_of
from tools.review.palette import FLIGHTS, STATES
from tools.review.panels import telemetry_panels
from tools.review.source import labels_of, open_flights
from tools.review.stage import Stage, part

pytestmark = pytest.mark.jit_only

SHIPPED = Path(__file__).parents[2] / "sim_harness" / "missions" / "mars-lander.toml"
LOAD = Path(__file__).parents[2] / "gains" / "mars-lander" / "drag-observer.load"
SHORT_S = 3.0
PLACES = """
[[waypoints]]
longitude_deg = 5.0
latitude_deg = 0.5

[[no_fly_zones]]
name = "crater"
longitude_deg = 8.0
latitude_deg = 1.0
radius_km = 50.0

[[no_fly_zones]]
name = "crater"
longitude_deg = -3.0
latitude_deg = 4.0
radius_km = 80.0
"""


@pytest.fixture(scope="module")
def lander(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds over Mars with places and another target than the file's, and its review."""
    folder = tmp_path_factory.mktemp("lander")
    (folder / "mars.toml").write_text(SHIPPED.read_text() + PLACES)
    status, _, told = run(
        "fly", str(folder / "mars.toml"), "--bus", "memory", "--load", str(LOAD),
        "--set", f"time_max_s={SHORT_S}", "--set", "target.longitude_deg=13",
        "--set", "target.latitude_deg=1", "--out", str(folder / "a"),
    )  # fmt: skip
    assert status == 0, told
    assert run("review", str(folder / "a"), "--save", str(folder / "a.rrd"))[0] == 0
    return folder


def test_the_target_is_the_one_that_was_flown_to(lander: Path) -> None:
    (flight,) = open_flights([lander / "a"])
    assert np.degrees(target_of(flight)).tolist() == pytest.approx([13.0, 1.0])  # type: ignore[arg-type]
    _, range_km = Review(lander / "a.rrd").line("/plots/range_to_go/a/flown")
    away_rad = math.acos(math.cos(math.radians(13.0)) * math.cos(math.radians(1.0)))
    assert range_km[0] == pytest.approx(3397.0 * away_rad)


def test_waypoints_and_zones_are_drawn_each_where_it_is(lander: Path) -> None:
    content = Review(lander / "a.rrd").content
    ((place,),) = content["/globe/way-points/way-point_1"]["Points3D:positions"]
    x, y, z = np.array(place) / np.linalg.norm(place)
    assert math.degrees(math.atan2(y, x)) == pytest.approx(5.0, abs=1e-4)
    assert math.degrees(math.asin(z)) == pytest.approx(0.5, abs=1e-4)
    for name, reach_km in (("crater", 50.0), ("crater_2", 80.0)):
        ((middle,),) = content[f"/globe/zones/{name}"]["Points3D:positions"]
        ((edge,),) = content[f"/globe/zones/{name}/outline"]["LineStrips3D:strips"]
        unit = np.array(middle) / np.linalg.norm(middle)
        away = np.array(edge) @ unit / np.linalg.norm(edge, axis=1)
        np.testing.assert_allclose(np.arccos(away) * 3397.0, reach_km, rtol=1e-3)


def test_a_short_flight_has_a_shade_too_and_its_limit_to_its_end(lander: Path) -> None:
    review = Review(lander / "a.rrd")
    t_s, shade = review.line("/plots/load_factor/a/margin")
    assert (np.diff(t_s) > 0.0).all()
    assert np.diff(t_s[::2]).max() < SHORT_S / 500.0  # strokes stand side by side on a screen
    assert (shade[1::2] == 20.0).all() and (shade[::2] < 20.0).all()
    end_s = review.line("/plots/load_factor/a/flown")[0][-1]
    assert review.line("/plots/load_factor/a/limit")[0].tolist() == [0.0, pytest.approx(end_s)]


def test_a_flight_through_a_table_of_air_has_its_corridor(tmp_path: Path) -> None:
    air = ("atmosphere.model=table", "csv=mars-gram-average.csv", "gas_constant_jpkgk=188.92")
    settings = [word for key in (*air, "time_max_s=50") for word in ("--set", key)]
    out = str(tmp_path / "a")
    assert run("fly", "mars-lander", "--bus", "memory", *settings, "--out", out)[0] == 0
    assert run("review", out, "--save", str(tmp_path / "a.rrd")) == (
        0,
        f"{tmp_path / 'a.rrd'}\n",
        "",
    )
    assert "/charts/drag/limits/load_factor" in Review(tmp_path / "a.rrd").content


@pytest.mark.parametrize("at_s", ["nan", "inf", "-0.1", "3.1"])
def test_a_time_that_is_not_of_the_flight_is_refused(
    lander: Path, tmp_path: Path, at_s: str
) -> None:
    picture = str(tmp_path / "a.png")
    status, out, told = run("review", str(lander / "a"), "--at", at_s, "--screenshot", picture)
    assert (status, out) == (1, "")
    assert told == f"aeroshell: --at {at_s}: allowed is a time of flight, 0 to 3.00 s\n"


def test_flights_have_labels_that_stay_apart_in_entity_paths(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a b", "a_b", "run.1", "run.2"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "run.1")
    names = [".", "../run.2", "../a b", "../a_b", "../a b/flight.mcap", "/é/x.mcap", "/è/x.mcap"]
    labels = labels_of([Path(name) for name in names])
    assert labels == ["run.1", "run.2", "a b", "a_b (2)", "a b (3)", "x", "x (2)"]
    foreign = labels_of([Path("/ж/flight.mcap"), Path("/д/flight.mcap")])
    assert len({part(label) for label in foreign}) == 2


def test_every_mode_has_a_colour_of_its_own() -> None:
    assert {"STANDBY", "COAST", "ENTRY", "TERMINAL", "SAFE"} <= set(STATES)


def test_an_estimate_is_drawn_over_what_it_estimates(lander: Path) -> None:
    (flight,) = open_flights([lander / "a"])
    messages = flight.recording.decoder.messages
    panels = {p.path: p for p in telemetry_panels(messages, ["heat_flux_wpm2"])}
    names = [line.name for line in panels["guidance/heat_flux_wpm2"].lines]
    assert names == ["heat flux used", "flown"]


def test_a_name_stands_in_the_frame_however_few_points_the_line_has() -> None:
    chart = Chart("charts/a", Scale("speed, m/s", 0.0, 10.0), Scale("altitude, km", 0.0, 10.0))
    stage = Stage("a")
    drawn: dict[str, list[list[float]]] = {}
    stage.still = lambda path, *content: drawn.update(  # type: ignore[method-assign]
        {path: [batch.as_arrow_array().to_pylist() for batch in content[0].as_component_batches()]}
    )
    chart.draw_line(
        stage, "line", np.array([0.0, 10.0]), np.array([5.0, 5.0]), Look(FLIGHTS[0], label="a")
    )
    assert [[800.0, 500.0]] in drawn["charts/a/line/name"]  # half-way, of 1,600 by 1,000


def test_names_of_lines_that_lie_together_stand_apart() -> None:
    chart = Chart("charts/a", Scale("speed, m/s", 0.0, 10.0), Scale("altitude, km", 0.0, 10.0))
    stage = Stage("a")
    x, y = np.array([0.0, 10.0]), np.array([5.0, 5.0])
    for name in ("one", "two", "three"):
        chart.draw_line(stage, name, x, y, Look(FLIGHTS[0], label="load factor"))
    boxes = list(stage.names_at["charts/a"].values())
    assert boxes[0][0].tolist() == [800.0, 500.0]  # the first stands where it is wanted
    for number, (at, half) in enumerate(boxes):
        assert all(np.any(np.abs(at - other) > half + size) for other, size in boxes[:number])


def test_a_drawing_that_did_not_get_whole_is_refused(
    lander: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = Stage.close

    def on_a_full_disk(stage: Stage, timeout_s: float = 60.0) -> None:
        plain(stage, timeout_s)
        (drawn,) = (tmp_path / "room").glob("aeroshell-*/review.rrd")
        os.truncate(drawn, drawn.stat().st_size - 200)

    (tmp_path / "room").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "room"))
    monkeypatch.setattr(Stage, "close", on_a_full_disk)
    status, out, told = run("review", str(lander / "a"), "--save", str(tmp_path / "x.rrd"))
    assert (status, out) == (1, "")
    assert "review.rrd: was not written whole, " in told and told.count("\n") == 1
    assert not (tmp_path / "x.rrd").exists() and not [*(tmp_path / "room").iterdir()]
