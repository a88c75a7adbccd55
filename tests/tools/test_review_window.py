"""The review's window: what is laid out in it, and a viewer that ends early or is closed."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rerun.blueprint.components import PanelState
from rerun.chunk import RrdReader

from tests.tools.test_review import Review, Told, run
from tools.review import viewer
from tools.spans import LEAST_SPAN

pytestmark = pytest.mark.jit_only

CUT_S = 30.0
LISTENING_S = 0.6  # a made viewer, before it ends

Layout = dict[str, dict[str, Any]]

VIEWER = """\
#!{python}
import socket, sys, time
from pathlib import Path
Path({told!r}).write_text(" ".join(sys.argv[1:]))
server = socket.create_server(("127.0.0.1", int(sys.argv[sys.argv.index("--port") + 1])))
time.sleep({until_s})
sys.exit({status})
"""


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short flight."""
    folder = tmp_path_factory.mktemp("window") / "short"
    options = ("--bus", "memory", "--set", f"time_max_s={CUT_S}", "--out", str(folder))
    run("fly", "hyperion-1", *options)
    return folder


def laid_out(*flights: Path, out: Path) -> Layout:
    """The properties of each view by its origin, and of each panel, of a saved review."""
    told = run("review", *map(str, flights), "--save", str(out))
    assert told[0] == 0, told
    reader = RrdReader(out)
    by_path: Layout = {}
    for chunk in reader.stream(store=reader.blueprints()[0]):
        path = chunk.entity_path
        where = "/".join(path.split("/")[:3]) if path.startswith("/view/") else path
        batch = chunk.to_record_batch()
        named = [name for name in batch.schema.names if ":" in name]
        found = {name: batch.column(name).to_pylist()[0] for name in named}
        by_path.setdefault(where, {}).update({k: v[0] for k, v in found.items() if v})
    return {view.get("ViewBlueprint:space_origin", path): view for path, view in by_path.items()}


@pytest.fixture(scope="module")
def layout(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> Layout:
    """The layout of a review of one flight."""
    return laid_out(flight, out=tmp_path_factory.mktemp("layout") / "x.rrd")


def test_the_bar_with_the_buttons_that_close_the_window_is_shown(layout: Layout) -> None:
    assert layout["/top_panel"]["PanelBlueprint:state"] == PanelState.Expanded.value


def test_counts_and_loads_of_the_bus_are_drawn_from_zero(layout: Layout) -> None:
    for origin, high in (("/bus/frames", 483.0), ("/bus/load", 6.5), ("/bus/refused", 0.0)):
        low, top = layout[origin]["ScalarAxis:range"]
        assert low == 0.0
        assert top > high


def test_the_plot_of_refusals_shows_no_frame_that_was_heard(
    flight: Path, tmp_path: Path, layout: Layout
) -> None:
    assert run("review", str(flight), "--save", str(tmp_path / "x.rrd"))[0] == 0
    content = Review(tmp_path / "x.rrd").content
    counters = {path.rsplit("/", 1)[-1] for path in content if path.startswith("/bus/refused/")}
    assert counters == {
        "wrong_crc", "repeated", "wrong_sequence", "wrong_length", "out_of_range", "implausible",
        "misdirected", "unknown_id", "incomplete_sets", "lost", "foreign",
        "candidates_believed",
    }  # fmt: skip
    assert layout["/bus/refused"]["ScalarAxis:range"][1] < 2.0  # none was refused


def test_an_axis_does_not_show_round_off(tmp_path: Path) -> None:
    """Over Mars at rest along the equator, crossrange and heading do not change."""
    folder = tmp_path / "mars"
    run("fly", "mars-lander", "--bus", "memory", "--set", "time_max_s=3", "--out", str(folder))
    layout = laid_out(folder, out=tmp_path / "x.rrd")
    low, high = layout["/plots/crossrange_to_go"]["ScalarAxis:range"]
    assert (low, high) == (-LEAST_SPAN["km"], LEAST_SPAN["km"])
    low, high = layout["/plots/heading"]["ScalarAxis:range"]
    assert (low, high) == pytest.approx((90.0 - LEAST_SPAN["deg"], 90.0 + LEAST_SPAN["deg"]))


def test_a_law_that_waits_draws_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "mars"
    run("fly", "mars-lander", "--bus", "memory", "--set", "time_max_s=3", "--out", str(folder))
    assert run("review", str(folder), "--save", str(tmp_path / "x.rrd"))[0] == 0
    content = Review(tmp_path / "x.rrd").content
    told = [path for path, columns in content.items() if "Scalars:scalars" in columns]
    assert any(path.startswith("/plots/") for path in told)
    assert not any(path.startswith("/guidance/") for path in told)


def test_a_line_alone_goes_by_the_title_and_lines_together_by_a_legend(
    layout: Layout, flight: Path, tmp_path: Path
) -> None:
    def legends(found: Layout) -> list[bool]:
        views = ("/plots/altitude", "/plots/bank", "/plots/heat_flux", "/plots/dynamic_pressure")
        return [found[view]["PlotLegend:visible"] for view in views]

    assert legends(layout) == [False, True, True, False]  # no limit of dynamic pressure
    again = tmp_path / "again.mcap"
    again.write_bytes((flight / "flight.mcap").read_bytes())
    assert all(legends(laid_out(flight, again, out=tmp_path / "both.rrd")))


def test_the_sheet_names_the_limit_that_there_is_and_says_where_there_is_none(
    flight: Path, tmp_path: Path
) -> None:
    assert run("review", str(flight), "--save", str(tmp_path / "x.rrd"))[0] == 0
    ((text,),) = Review(tmp_path / "x.rrd").content["/sheet"]["TextDocument:text"]  # type: ignore[misc]
    rows = [[cell.strip() for cell in line.split("|")] for line in text.splitlines()]
    limits = {row[1]: row[4] for row in rows if len(row) > 4}
    assert limits["peak heat flux"] == "1,700"
    assert limits["peak dynamic pressure"] == "none"


@pytest.fixture
def opened(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[int, float], Told]:
    """A review opened in a made viewer that listens, and ends with a status after a while."""
    monkeypatch.setenv("DISPLAY", ":0")
    program = tmp_path / "viewer"
    monkeypatch.setattr(viewer, "executable", lambda: str(program))

    def open_in(status: int, until_s: float = LISTENING_S) -> Told:
        told = str(tmp_path / "arguments")
        program.write_text(
            VIEWER.format(python=sys.executable, told=told, until_s=until_s, status=status)
        )
        program.chmod(0o755)
        return run("review", str(flight))

    return open_in


def test_a_viewer_that_ends_while_it_loads_is_told_in_one_sentence(
    opened: Callable[[int], Told],
) -> None:
    status, out, told = opened(1)
    assert (status, out) == (1, "")
    assert told.startswith("aeroshell: the Rerun viewer ended too early")
    assert told.count("\n") == 1


def test_a_window_closed_while_it_loads_is_no_failure(opened: Callable[[int], Told]) -> None:
    assert opened(0) == (0, "", "")


def test_the_viewer_listens_to_this_machine_alone(
    opened: Callable[[int], Told], tmp_path: Path
) -> None:
    opened(0)
    assert "--bind 127.0.0.1 " in (tmp_path / "arguments").read_text()


def test_an_interrupt_while_the_window_opens_takes_the_viewer_along(
    opened: Callable[[int, float], Told], monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[Any] = []

    def interrupt(client: object, process: Any) -> None:
        started.append(process)
        raise KeyboardInterrupt

    monkeypatch.setattr(viewer, "_await_loaded", interrupt)
    assert opened(0, 60.0)[0] == 130
    assert started[0].poll() is not None


def test_a_viewer_that_says_nothing_is_told_and_tried_once_more(
    opened: Callable[[int, float], Told], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes the connection and never answers: Rerun's client would wait without limit."""
    started: list[Any] = []
    start = viewer.start

    def counted(*arguments: Any) -> Any:
        started.append(start(*arguments))
        return started[-1]

    monkeypatch.setattr(viewer, "start", counted)
    monkeypatch.setattr(viewer, "LOAD_S", 0.5)
    status, out, told = opened(0, 60.0)
    assert (status, out, len(started)) == (1, "", 2)
    assert all(process.poll() is not None for process in started)
    late = "the Rerun viewer did not answer within 0.5 s"
    assert told == f"{late}; trying once more\naeroshell: {late}\n"


def test_a_viewer_that_is_late_once_is_used_the_second_time() -> None:
    attempts = iter((viewer.LateError("late"), None))

    def attempt() -> str:
        if error := next(attempts):
            raise error
        return "shown"

    assert viewer.retry_if_late(attempt) == "shown"
