"""What was planned beside what was flown: drawn from the plan that was flown, or not at all."""

import math
from pathlib import Path

import numpy as np
import pytest

from flight_sw.load_image import activate
from sim_harness.replay.script import attached_load
from sim_harness.telemetry.reader import Recording, open_recording
from sim_harness.telemetry.recorder import Recorder
from tests.tools.test_review import CUT_S as FOREIGN_S
from tests.tools.test_review import Review, run
from tools.review import plots
from tools.review.columns import lanes
from tools.review.source import open_flights
from tools.tracks import Track, Tracks, tracks_of
from tools.tracks.planned import difference, plan_made_again, reports_of

pytestmark = pytest.mark.jit_only

CUT_S = 300.0  # the bank is rolled in, and feedback is on
TARGET_DEG = (-16.0, 64.7)  # [JOSHI] Table 1
EARTH_KM = 6378.137
PANELS = ("heat_flux", "bank", "angle_of_attack", "altitude", "speed", "crossrange_to_go")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The beginning of a flight in thinner air than planned in, its review, and one of the plan of
    its load."""
    folder = tmp_path_factory.mktemp("planned")
    for name, extra in (
        ("a", ("--set", "atmosphere.density_factor=0.9")),
        ("load", ("--set", "design.plan.onboard=no")),
    ):
        options = ("--bus", "memory", "--set", f"time_max_s={CUT_S}", *extra)
        status, _, told = run("fly", "rlv", *options, "--out", str(folder / name))
        assert status == 0, told
    assert run("review", str(folder / "a"), "--save", str(folder / "a.rrd"))[0] == 0
    return folder


@pytest.fixture(scope="module")
def recording(flown: Path) -> Recording:
    """The recording of the plan made onboard."""
    return open_recording(flown / "a" / "flight.mcap")


@pytest.fixture(scope="module")
def track(recording: Recording) -> Track:
    """What was found of its plan."""
    found = tracks_of(recording)
    assert found.gaps == ()
    (track,) = found.tracks
    return track


def test_the_plan_is_the_one_that_telemetry_tells_of(recording: Recording, track: Track) -> None:
    told = {name: values[-1] for name, values in reports_of(recording).columns.items()}
    facts = dict(track.facts)
    assert facts["source"] == "onboard" and facts["planner ended"] == "converged"
    assert int(facts["iterations"]) == told["plan_iterations"]
    assert int(facts["flights ahead"]) == told["plan_flights"]
    assert float(facts["error at the target e_t"]) == pytest.approx(
        told["plan_target_error"], abs=0.05
    )


def test_the_plan_goes_from_the_entry_to_the_target(track: Track) -> None:
    ends = [np.degrees(track.path[name][[0, -1]]) for name in ("lat_rad", "lon_rad")]
    assert [end[0] for end in ends] == pytest.approx([0.0, 0.0], abs=1e-4)
    assert [end[1] for end in ends] == pytest.approx(TARGET_DEG, abs=0.01)
    assert track.path["alt_m"][[0, -1]].tolist() == pytest.approx([121_809.0, 25_000.0], abs=1.0)


def test_flown_less_planned_is_the_error_that_the_tracker_told_of(
    recording: Recording, track: Track
) -> None:
    truth, (t_s, told) = recording.truth, recording.message("TM_PLAN_C")
    later = np.isin(t_s, track.reference["t_s"][-1000:])  # 100 s, with feedback on
    at = np.isin(track.reference["t_s"], t_s[later])
    for name, error, step in (
        ("alt_m", "plan_alt_error_m", 0.5),
        ("v_rel_mps", "plan_v_error_mps", 0.02),
    ):
        flown_at = np.interp(t_s[later], truth["t_s"], truth[name])
        apart = flown_at - track.reference[name][at] - told[error][later]
        assert np.abs(apart).max() < step
        assert np.abs(told[error][later]).max() > 10.0 * step  # thinner air: there is some


def test_planned_lines_stand_beside_the_flown(flown: Path, track: Track) -> None:
    review = Review(flown / "a.rrd")
    for panel in PANELS:
        t_s, _ = review.line(f"/plots/{panel}/a/as_planned")
        np.testing.assert_allclose(t_s, track.reference["t_s"], atol=1e-8)
    _, bank_deg = review.line("/plots/bank/a/as_planned")
    np.testing.assert_allclose(bank_deg, np.degrees(track.reference["bank_rad"]), rtol=1e-12)
    _, flux = review.line("/plots/heat_flux/a/as_planned")
    np.testing.assert_allclose(flux, track.reference["heat_flux_wpm2"] / 1e3, rtol=1e-12)
    for chart in ("drag", "altitude"):
        assert f"/charts/{chart}/flights/a/planned" in review.content
    assert "/plots/mach/a/as_planned" not in review.content  # nothing was planned of it


def test_the_planned_track_ends_on_the_globe_at_the_target(flown: Path) -> None:
    content = Review(flown / "a.rrd").content
    ((strip,),) = content["/globe/flights/a/planned"]["LineStrips3D:strips"]
    x, y, z = np.array(strip)[-1] / np.linalg.norm(np.array(strip)[-1])
    there = math.degrees(math.asin(z)), math.degrees(math.atan2(y, x))
    assert there == pytest.approx(TARGET_DEG, abs=0.01)
    ((name,),) = (
        content["/globe/flights/a/crossrange/name"]["Text:labels"]
        if ("Text:labels" in content["/globe/flights/a/crossrange/name"])
        else content["/globe/flights/a/crossrange/name"]["Points3D:labels"]
    )
    lat, lon = np.radians(TARGET_DEG)
    # From 0 N 0 E along heading 100 deg: the sine of the angle across, by the closed form.
    across = -math.cos(math.radians(100.0)) * math.cos(lat) * math.sin(lon) * -1.0
    across -= math.sin(math.radians(100.0)) * math.sin(lat)
    assert name == f"crossrange {EARTH_KM * math.asin(across):,.0f} km right"


def test_the_sheet_tells_how_the_plan_was_made(flown: Path) -> None:
    ((text,),) = Review(flown / "a.rrd").content["/sheet"]["TextDocument:text"]  # type: ignore[misc]
    assert "| source | onboard |" in text and "| planner ended | converged |" in text


def test_the_job_s_states_are_lanes_from_coast_on(flown: Path) -> None:
    (flight,) = open_flights([flown / "a"])
    found = {lane.title: lane for lane in lanes(flight)}
    assert found["plan stage"].names == ["seeking", "writing", "in force"]
    assert found["plan stage"].t_s[0] == 0.0
    assert found["plan source"].names == ["load", "onboard"]
    panels = [path for path in Review(flown / "a.rrd").content if path.startswith("/guidance/")]
    drawn = {path.split("/")[2] for path in panels}
    assert {"iterations", "flights", "target_error", "excess", "across_error_m"} <= drawn
    assert not {"stage", "source", "ending"} & drawn


def test_the_log_tells_of_the_plan(recording: Recording) -> None:
    texts = [line.text for line in recording.log if line.text.startswith("plan ")]
    flights = int(reports_of(recording).columns["plan_flights"][-1])
    assert texts == [
        "plan seeking",
        "plan writing, was seeking",
        f"plan in force, was writing: converged after {flights} flights ahead, source onboard",
    ]


def test_a_plan_of_the_load_is_taken_from_the_load(flown: Path) -> None:
    recording = open_recording(flown / "load" / "flight.mcap")
    found = tracks_of(recording)
    (track,) = found.tracks
    assert (track.name, found.gaps) == ("planned, of the load", ())
    stored = activate(attached_load(recording))[0]["law"]["stored"]
    n = int(stored["n_rows"])
    assert track.path["lat_rad"].tolist() == stored["state"][:n, 4].tolist()
    assert dict(track.facts)["source"] == "load"


def without_frames(recording: Recording, path: Path, ids: set[int], until_s: float) -> Path:
    """The same recording less the frames of some identifiers before a time."""
    rows = recording.bus
    gone = np.isin(rows["frame"]["can_id"], list(ids)) & (rows["t_s"] < until_s)
    assert gone.any()
    attached = {name: ("", content) for name, content in recording.attachments.items()}
    with Recorder(path, dict(recording.manifest), attached) as recorder:
        recorder.write_bus(rows[~gone])
        recorder.close("end condition")
    return path


def test_a_recording_without_its_first_fix_draws_no_plan_and_says_why(
    recording: Recording, tmp_path: Path
) -> None:
    ids = {m.can_id for m in recording.decoder.messages if m.name.startswith("NAV_")}
    cut = without_frames(recording, tmp_path / "cut.mcap", ids, 0.01)
    found = tracks_of(open_recording(cut))
    assert found.tracks == ()
    (gap,) = found.gaps
    assert "is not the one flown and not shown" in gap
    status, _, told = run("review", str(cut), "--save", str(tmp_path / "cut.rrd"))
    assert status == 0 and gap in told
    content = Review(tmp_path / "cut.rrd").content
    assert not [path for path in content if "planned" in path or "crossrange" in path]
    assert gap in content["/sheet"]["TextDocument:text"][0][0]  # type: ignore[index]


def test_a_recording_without_the_plan_s_telemetry_has_no_plan(
    recording: Recording, tmp_path: Path
) -> None:
    ids = {m.can_id for m in recording.decoder.messages if m.name.startswith("TM_PLAN")}
    cut = without_frames(recording, tmp_path / "cut.mcap", ids, CUT_S)
    assert tracks_of(open_recording(cut)) == Tracks()


@pytest.mark.parametrize(
    ("field", "by", "words"),
    [
        ("iterations", 1, "its iterations"),
        ("flights", 1, "its flights"),
        ("ending", 1, "its ending"),
        ("target_error", 0.5, "its target error"),
        ("excess", 1.0, "its excess"),
    ],
)
def test_a_plan_that_telemetry_does_not_tell_of_is_another(
    recording: Recording, field: str, by: float, words: str
) -> None:
    plan, reports = plan_made_again(recording, 100.0), reports_of(recording)
    assert difference(plan, reports) == ""
    plan[field] += by
    assert difference(plan, reports).startswith(words)


def test_a_plan_with_another_bank_at_one_knot_is_another(recording: Recording) -> None:
    plan, reports = plan_made_again(recording, 100.0), reports_of(recording)
    plan["profile"]["bank_rad"][1] += 1e-4
    assert difference(plan, reports).startswith("its bank ")


def test_a_law_that_plans_nothing_shows_nothing_of_a_plan(tmp_path: Path) -> None:
    out = str(tmp_path / "b")
    run("fly", "hyperion-1", "--bus", "memory", "--set", f"time_max_s={FOREIGN_S}", "--out", out)
    (flight,) = open_flights([tmp_path / "b"])
    assert flight.planned == Tracks() and flight.gaps == []
    assert run("review", out, "--save", str(tmp_path / "b.rrd"))[0] == 0
    content = Review(tmp_path / "b.rrd").content
    assert not [path for path in content if "planned" in path or "crossrange/" in path]
    assert all(not plots.planned_of(panel, flight) for panel in plots_panels())


def plots_panels() -> tuple[plots.Panel, ...]:
    from tools.review.panels import PANELS, TO_GO

    return (*PANELS, *TO_GO)
