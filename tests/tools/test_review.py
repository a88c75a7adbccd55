"""`aeroshell review`: what is in the file, read back through Rerun's own reader."""

import contextlib
import io
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from sim_harness.telemetry.reader import open_recording
from tools.cli import main

pytestmark = pytest.mark.jit_only

EARTH_KM = 6378.137
CUT_S = 260.0  # into the tracked part
Told = tuple[int, str, str]


def run(*arguments: str) -> Told:
    """One command in this process: status, stdout, stderr."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main([*arguments])
    return status, out.getvalue(), err.getvalue()


class Review:
    """The contents of a .rrd by entity and component."""

    def __init__(self, path: Path) -> None:
        reader = RrdReader(path)
        self.blueprints = reader.blueprints()
        self.content: dict[str, dict[str, list[object]]] = {}
        for chunk in reader.stream(store=reader.recordings()[0]):
            batch = chunk.to_record_batch()
            columns = self.content.setdefault(chunk.entity_path, {})
            for name in batch.schema.names:
                column = batch.column(name)
                if pa.types.is_duration(column.type):
                    column = column.cast(pa.int64())
                columns.setdefault(name, []).extend(column.to_pylist())

    def line(self, path: str) -> tuple[np.ndarray, np.ndarray]:
        """Times in s and values of a line."""
        columns = self.content[path]
        return np.array(columns["mission_time"], float) / 1e9, np.array(
            columns["Scalars:scalars"], float
        ).ravel()


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two flights, the second with another limit, and one review of both and one of the first."""
    folder = tmp_path_factory.mktemp("review")
    for name, extra in (("one", ()), ("two", ("--set", "heat_flux_max_kwpm2=1500"))):
        options = ("--bus", "memory", "--set", f"time_max_s={CUT_S}", *extra)
        run("fly", "hyperion-1", *options, "--out", str(folder / name))
    assert run("review", str(folder / "one"), "--save", str(folder / "one.rrd"))[0] == 0
    both = [str(folder / name) for name in ("one", "two")]
    assert run("review", *both, "--save", str(folder / "both.rrd"))[0] == 0
    return folder


@pytest.fixture(scope="module")
def one(flights: Path) -> Review:
    """The review of a flight alone."""
    return Review(flights / "one.rrd")


@pytest.fixture(scope="module")
def both(flights: Path) -> Review:
    """The review of two flights."""
    return Review(flights / "both.rrd")


def test_the_review_comes_with_a_blueprint(one: Review) -> None:
    assert len(one.blueprints) == 1


def test_lines_are_the_recorded_truth_in_the_units_of_the_titles(
    flights: Path, one: Review
) -> None:
    truth = open_recording(flights / "one" / "flight.mcap").truth
    for path, field, factor in (
        ("heat_flux", "heat_flux_wpm2", 1e-3),
        ("load_factor", "load_factor_g", 1.0),
        ("angle_of_attack", "alpha_rad", 180.0 / math.pi),
        ("altitude", "alt_m", 1e-3),
    ):
        t_s, values = one.line(f"/plots/{path}/one/flown")
        np.testing.assert_allclose(t_s, truth["t_s"], atol=1e-8)
        np.testing.assert_allclose(values, truth[field] * factor, rtol=1e-12)


def test_a_bank_of_180_deg_is_not_drawn_as_one_of_minus_180(flights: Path, both: Review) -> None:
    recorded = open_recording(flights / "two" / "flight.mcap").truth["bank_rad"]
    assert recorded.min() < -3.14  # commanded are 0 to 180 deg, and this is the same attitude
    _, values = both.line("/plots/bank/two/flown")
    assert 179.9 < values.max() < 180.1
    assert values.min() > -0.1


def test_the_track_lies_above_the_sphere_by_the_altitude(flights: Path, one: Review) -> None:
    truth = open_recording(flights / "one" / "flight.mcap").truth
    (strip,) = one.content["/globe/flights/one/track"]["LineStrips3D:strips"][0]  # type: ignore[misc]
    above_km = np.linalg.norm(np.array(strip), axis=1) - EARTH_KM
    assert above_km[0] == pytest.approx(119.81, abs=0.01)  # the entry altitude
    assert above_km.min() == pytest.approx(truth["alt_m"].min() / 1e3, abs=0.01)


def test_the_limit_is_the_missions_and_the_override_that_was_flown(both: Review) -> None:
    assert both.line("/plots/heat_flux/one/limit")[1].tolist() == [1700.0, 1700.0]
    assert both.line("/plots/heat_flux/two/limit")[1].tolist() == [1500.0, 1500.0]
    assert "/plots/load_factor/two/limit" not in both.content  # the same as the first's


def test_the_margin_lies_between_flown_and_limit(one: Review) -> None:
    _, shade = one.line("/plots/heat_flux/one/margin")
    assert (shade[1::2] == 1700.0).all()
    assert (shade[::2] <= 1700.0).all()


def test_states_are_named_and_change_when_the_computer_says_so(one: Review) -> None:
    phases = [state for (state,) in one.content["/states/guidance_phase"]["StateChange:state"]]  # type: ignore[misc]
    assert phases == ["pre-peak", "post-peak", "heat-flux"]
    modes = [state for (state,) in one.content["/states/mode"]["StateChange:state"]]  # type: ignore[misc]
    assert modes == ["COAST", "ENTRY"]


def test_events_are_in_the_log_with_the_phases_names(one: Review) -> None:
    texts = [text for (text,) in one.content["/log/one"]["TextLog:text"]]  # type: ignore[misc]
    assert "guidance phase heat-flux, was post-peak" in texts
    assert "mode ENTRY, was COAST" in texts


def test_every_telemetered_signal_has_its_line(one: Review) -> None:
    paths = [path for path in one.content if path.startswith("/guidance/")]
    drawn = {path.rsplit("/", 1)[-1] for path in paths}
    assert drawn == {
        "bank_nominal", "flight_path_angle_commanded", "flow_exponent", "tracking_constant_ratio",
        "bank_correction", "heat_flux_error", "flown",
    }  # fmt: skip


def test_telemetry_is_drawn_from_when_its_law_forms_it(one: Review) -> None:
    """In mode ENTRY, what belongs to tracking from its phase on: times as the log has them."""
    since = dict(zip(
        [text for (text,) in one.content["/log/one"]["TextLog:text"]],  # type: ignore[misc]
        np.array(one.content["/log/one"]["mission_time"], float) / 1e9, strict=True,
    ))  # fmt: skip
    entry_s = since["mode ENTRY, was COAST"]
    tracking_s = since["guidance phase heat-flux, was post-peak"]
    begun = {
        path.rsplit("/", 1)[-1]: one.line(path)[0][0]
        for path in one.content
        if path.startswith("/guidance/")
    }
    assert begun.pop("flown") == 0.0
    for name in ("bank_nominal", "flow_exponent"):
        assert entry_s <= begun.pop(name) < entry_s + 0.1
    assert set(begun) == {
        "flight_path_angle_commanded", "tracking_constant_ratio", "bank_correction",
        "heat_flux_error",
    }  # fmt: skip
    for begun_s in begun.values():
        assert tracking_s <= begun_s < tracking_s + 0.1


def test_the_corridor_is_drawn_and_a_second_limit_beside_it(both: Review) -> None:
    for chart in ("drag", "altitude"):
        assert f"/charts/{chart}/limits/heat_flux" in both.content
        assert f"/charts/{chart}/limits_of_two/heat_flux" in both.content
        assert f"/charts/{chart}/limits_of_two/load_factor" not in both.content


def test_a_cut_off_recording_is_shown_as_far_as_it_goes(flights: Path, tmp_path: Path) -> None:
    whole = (flights / "one" / "flight.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    cut, out = str(tmp_path / "cut.mcap"), tmp_path / "cut.rrd"
    status, _, told = run("review", cut, "--save", str(out))
    assert status == 0
    recording = open_recording(tmp_path / "cut.mcap")
    until_s = recording.until_s
    assert f"cut.mcap: incomplete, shown is the flight until {until_s:.2f} s" in told
    t_s, _ = Review(out).line("/plots/heat_flux/cut/flown")
    assert t_s[-1] == pytest.approx(recording.truth["t_s"][-1])
    assert until_s < CUT_S


Spoil = Callable[[Path, Path], list[str]]


def _foreign(flights: Path, folder: Path) -> list[str]:
    path = folder / "notes.txt"
    path.write_text("no recording")
    return ["review", str(path), "--save", str(folder / "x.rrd")]


def _there_already(flights: Path, folder: Path) -> list[str]:
    (folder / "x.rrd").write_text("precious")
    return ["review", str(flights / "one"), "--save", str(folder / "x.rrd")]


def _nowhere(flights: Path, folder: Path) -> list[str]:
    return ["review", str(flights / "one"), "--save", str(folder / "no" / "x.rrd")]


def _wrong_ending(flights: Path, folder: Path) -> list[str]:
    return ["review", str(flights / "one"), "--screenshot", str(folder / "x.jpg")]


def _no_display(flights: Path, folder: Path) -> list[str]:
    return ["review", str(flights / "one")]


def _no_such_file(flights: Path, folder: Path) -> list[str]:
    return ["review", str(folder / "none.mcap"), "--save", str(folder / "x.rrd")]


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (_foreign, "notes.txt: not an MCAP file, it does not begin with MCAP's magic bytes"),
        (_there_already, "x.rrd: exists already, --force replaces it"),
        (_nowhere, "there is no folder"),
        (_wrong_ending, "allowed is a name that ends in .png"),
        (_no_display, "no display to open a window on"),
        (_no_such_file, "none.mcap: cannot be read, No such file or directory"),
    ],
)
def test_refusals_are_one_sentence(
    spoil: Spoil, sentence: str, flights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    status, out, told = run(*spoil(flights, tmp_path))
    assert (status, out) == (1, "")
    assert sentence in told
    assert told.count("\n") == 1
    if (tmp_path / "x.rrd").exists():
        assert (tmp_path / "x.rrd").read_text() == "precious"


def test_the_manifest_says_what_was_set(flights: Path) -> None:
    manifest = open_recording(flights / "two" / "flight.mcap").manifest
    overrides = json.loads(manifest["overrides"])
    assert float(overrides["limits.heat_flux_max_kwpm2"]) == 1500.0
