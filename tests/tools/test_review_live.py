"""The live view: what it draws, and that no viewer, dead, deaf or missing, touches the flight."""

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim_harness.telemetry.reader import open_recording
from tests.tools.test_review import Review, run
from tools.review import live, viewer
from tools.review.stage import Stage

pytestmark = pytest.mark.jit_only

CUT_S = 60.0
FLY = ("fly", "hyperion-1", "--bus", "memory", "--set", f"time_max_s={CUT_S}", "--json")


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The summary of the flight without a view."""
    out = tmp_path_factory.mktemp("alone") / "a"
    return dict(json.loads(run(*FLY, "--no-record", "--out", str(out))[1]))


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Waits cut short."""
    for name, value in (("EVERY_S", 0.1), ("SENT_WITHIN_S", 0.2), ("LAST_WITHIN_S", 0.5)):
        monkeypatch.setattr(live, name, value)


class Listener:
    """Something that listens like a viewer, and does not read, or hangs up at once."""

    def __init__(self, *, hangs_up: bool) -> None:
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.url = f"rerun+http://127.0.0.1:{self.socket.getsockname()[1]}/proxy"
        self.kept: list[socket.socket] = []
        self._hangs_up = hangs_up
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self.socket.accept()
            except OSError:
                return
            if self._hangs_up:
                connection.close()
            else:
                self.kept.append(connection)

    def close(self) -> None:
        """Stop."""
        self.socket.close()
        for connection in self.kept:
            connection.close()


@pytest.fixture(params=["deaf", "hangs up"])
def listener(request: pytest.FixtureRequest) -> Iterator[Listener]:
    """A viewer that is none."""
    found = Listener(hangs_up=request.param == "hangs up")
    yield found
    found.close()


@pytest.mark.usefixtures("impatient")
def test_a_viewer_that_does_not_read_or_hangs_up_costs_the_flight_nothing(
    listener: Listener, alone: dict[str, Any], tmp_path: Path
) -> None:
    status, out, told = run(*FLY, "--out", str(tmp_path / "a"), "--viewer", listener.url)
    assert status == 0, told
    assert json.loads(out)["command_sha256"] == alone["command_sha256"]
    assert open_recording(tmp_path / "a" / "flight.mcap").is_complete
    assert "live view: " in told
    assert "the viewer is gone" in told or "the viewer was too slow" in told


@pytest.mark.usefixtures("impatient")
def test_a_window_closed_during_the_flight_is_told_once(
    alone: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed = subprocess.Popen(["true"])
    closed.wait()
    answers = iter([True])  # then no more

    def is_sent(stage: Stage, within_s: float) -> bool:
        if (answer := next(answers, None)) is None:
            raise ConnectionError
        return answer

    monkeypatch.setattr(viewer, "open_live", lambda: ("nowhere", closed))
    monkeypatch.setattr(Stage, "connect", lambda stage, _, plan: stage.save(tmp_path / "x", plan))
    monkeypatch.setattr(Stage, "is_sent", is_sent)
    status, out, told = run(*FLY, "--out", str(tmp_path / "a"), "--live")
    assert status == 0
    assert json.loads(out)["command_sha256"] == alone["command_sha256"]
    assert told == f"{live.GONE}\n"


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("elsewhere", "allowed is an address like rerun+http://127.0.0.1:9876/proxy"),
        ("rerun+http://127.0.0.1:1/proxy", "no viewer answers there"),
    ],
)
def test_a_viewer_that_is_not_there_is_told_before_the_flight(
    url: str, sentence: str, tmp_path: Path
) -> None:
    status, _, told = run(*FLY, "--out", str(tmp_path / "a"), "--viewer", url)
    assert status == 1
    assert sentence in told
    assert not (tmp_path / "a").exists()


def test_without_a_display_a_window_is_refused_before_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    status, _, told = run(*FLY, "--out", str(tmp_path / "a"), "--live")
    assert status == 1
    assert "no display to open a window on" in told


def test_the_live_view_draws_what_was_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn, there = tmp_path / "live.rrd", Listener(hangs_up=False)
    stages: list[Stage] = []

    def save_instead(stage: Stage, url: str, blueprint: Any) -> None:
        assert url == there.url
        stages.append(stage)
        stage.save(drawn, blueprint)

    monkeypatch.setattr(Stage, "connect", save_instead)
    status, _, told = run(*FLY, "--out", str(tmp_path / "a"), "--viewer", there.url)
    there.close()
    assert (status, told) == (0, "")
    stages[0].close()
    review = Review(drawn)
    truth = open_recording(tmp_path / "a" / "flight.mcap").truth
    t_s, flux = review.line("/plots/heat_flux/hyperion-1/flown")
    np.testing.assert_allclose(t_s, truth["t_s"], atol=1e-8)
    np.testing.assert_allclose(flux, truth["heat_flux_wpm2"] / 1e3, rtol=1e-12)
    modes = [state for (state,) in review.content["/states/mode"]["StateChange:state"]]  # type: ignore[misc]
    assert modes == ["COAST", "ENTRY"]  # told once each, however many pieces it came in
    assert "/charts/drag/flights/hyperion-1" in review.content


@pytest.mark.skipif(
    not any(Path("/usr/share/vulkan/icd.d").glob("*.json")), reason="no Vulkan driver to draw with"
)
def test_a_viewer_that_has_shown_a_flight_has_no_error_to_show(tmp_path: Path) -> None:
    port = viewer.free_port()
    with (tmp_path / "told").open("w+b") as log:
        process = viewer.start(["--headless", "--port", str(port), "--hide-welcome-screen"], log)
        try:
            client = viewer._connected(process, port, log)
            url = viewer.address(port)
            command = [sys.executable, "-m", "tools.cli", *FLY, "--out", str(tmp_path / "a")]
            subprocess.run([*command, "--viewer", url], check=True, capture_output=True)
            time.sleep(1.0)  # an error comes when the flight's process is gone
            (recording,) = client.get_state().recordings
            lines = client.get_logs()
        finally:
            viewer.end(process)
    assert "aeroshell" in recording.store_id
    assert [line.message for line in lines if line.level == "ERROR"] == []


class NoPainter:
    """Takes nothing."""

    def __init__(self, *_: object) -> None:
        time.sleep(0.3)

    def paint(self, next_rows: object) -> None:
        """Leave everything in the queue."""


@pytest.mark.usefixtures("impatient")
def test_the_queue_is_bounded_and_what_it_drops_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = Listener(hangs_up=False)
    views: list[live.LiveView] = []
    original = live.LiveView.__init__

    def small(view: live.LiveView, *arguments: Any, **options: Any) -> None:
        original(view, *arguments, **options, queue_bytes=100_000)
        views.append(view)

    monkeypatch.setattr(live.LiveView, "__init__", small)
    monkeypatch.setattr(live, "Painter", NoPainter)
    status, _, told = run(*FLY, "--out", str(tmp_path / "a"), "--viewer", there.url)
    there.close()
    assert status == 0
    rows = len(open_recording(tmp_path / "a" / "flight.mcap").bus)
    assert 0.9 * rows < views[0].dropped_rows
    assert f"{views[0].dropped_rows:,} rows are not shown, the viewer was too slow" in told
