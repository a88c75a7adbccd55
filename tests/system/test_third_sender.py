"""Among a third sender's frames a flight replays to the bit: the ear heard what counted."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flight_sw import icd
from sim_harness.bus.hub import Hub
from sim_harness.telemetry.reader import open_recording
from tests.system.flights import run_of
from tests.system.paced import piece
from tests.system.replays import replay
from tests.system.third_sender import third_sender
from tools.commands.fly import fly_and_record

pytestmark = pytest.mark.jit_only

HARNESS_IDS = {m.can_id for m in icd.LAYOUT if m.sender == "HARNESS"}


@pytest.fixture(params=["own hub", "another's hub"])
def bus(
    request: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[str, Callable[[], str]]]:
    """The bus of a plan, and the address that another finds it under."""
    if request.param == "own hub":
        monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
        yield "unix", lambda: f"unix:{next(tmp_path.glob('aeroshell-*/bus'), 'none')}"
        return
    with Hub(tmp_path / "hub") as hub:
        yield f"unix:{hub.path}", lambda: f"unix:{hub.path}"


@pytest.mark.parametrize(
    ("pace", "seconds", "seed"), [(0.0, 100.0, 1), (0.0, 100.0, 2), (1.0, 4.0, 3), (5.0, 10.0, 4)]
)
def test_a_flight_among_false_frames_replays_to_the_bit(
    tmp_path: Path, bus: tuple[str, Callable[[], str]], pace: float, seconds: float, seed: int
) -> None:
    plan, address = bus
    with third_sender(address, seed) as sender:
        run = run_of(piece(seconds), tmp_path / "a.load", plan, pace=pace)
        fly_and_record(run, tmp_path)
    recording = open_recording(tmp_path / "flight.mcap")
    found = replay(recording.path)
    assert found.is_identical, found
    assert found.cycles >= seconds / 0.02 * 0.9
    assert found.reports == 0, "the computer heard other frames than the ear"
    assert found.unanswered == 0
    assert len(found.ticks) == run.computer["ticks"]
    assert sender.sent > 300
    strange = ~np.isin(recording.bus["frame"]["can_id"], list(HARNESS_IDS))
    assert strange.sum() > 200
    refused = sum(n for name, n in run.computer["verdicts"].items() if name not in ("OK", "LOST"))
    assert refused > 20, "the computer heard next to nothing of it"  # lockstep is soon over
