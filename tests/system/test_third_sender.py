"""Among a third sender's frames a flight replays to the bit: what counted was heard."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flight_sw import icd
from flight_sw.can.e2e import crc_ok
from flight_sw.reception.requests import ARM
from sim_harness.bus.hub import Hub
from sim_harness.flight.loop import COMPUTER_SILENT
from sim_harness.replay.feed import NEITHER
from sim_harness.replay.replayer import Replayer
from sim_harness.telemetry.reader import open_recording
from tests.system.flights import built, request, run_of
from tests.system.paced import piece
from tests.system.replays import Bench, record, replay
from tests.system.third_sender import DEADLY, false_frames, third_sender
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


def test_time_messages_and_commands_have_right_checksums_where_they_may() -> None:
    codec = built("lqy").load["codec"][0]
    for is_deadly in (False, True):
        frames = false_frames(4096, 1, is_deadly)
        for name in DEADLY:
            of_it = frames[(frames["can_id"] == icd.layout(name).can_id) & (frames["dlc"] == 8)]
            right = [crc_ok(codec, icd.slot(name), frame["data"]) for frame in of_it]
            assert len(right) > 50
            assert (np.mean(right) > 0.9) == is_deadly
            assert (np.mean(right) < 0.1) != is_deadly


@pytest.mark.parametrize("behind", [0, 400])
def test_where_the_computer_began_to_hear_is_found_behind_a_long_wait(
    tmp_path: Path, behind: int
) -> None:
    """And when it is that many frames behind the bus as it gives its first answer."""
    strange = np.tile(false_frames(4096, 6, is_deadly=False), 8)
    unheard, heard, later = np.split(strange[: 30_000 + behind], [29_300, 30_000])
    bench = Bench("lqy", 100)
    bench.begin_anew()
    bench.log(unheard)
    begun = np.concatenate([heard, request(bench.made, ARM), bench.navigation()])
    bench.overtaken_cycle(begun, later)
    for _ in range(99):
        bench.cycle()
    path = record(bench.made, bench.rows, tmp_path / "flight.mcap")
    replayer = Replayer(open_recording(path))
    assert np.flatnonzero(replayer.heard.kinds != NEITHER)[0] == len(unheard)
    found = replayer.run()
    assert found.is_identical, found
    assert (found.reports, found.cycles) == (0, 100)


def test_a_flight_in_lockstep_that_false_commands_end_says_so_and_replays_to_there(
    tmp_path: Path, bus: tuple[str, Callable[[], str]]
) -> None:
    """They move the harness's sequence: an answer is refused, and nothing is sent twice."""
    plan, address = bus
    with third_sender(address, 5, is_deadly=True):
        run = run_of(piece(600.0), tmp_path / "a.load", plan)
        failure = fly_and_record(run, tmp_path)
    assert run.outcome == COMPUTER_SILENT
    assert "flight computer silent" in run.outcome_text
    assert failure != ""
    recording = open_recording(tmp_path / "flight.mcap")
    assert recording.outcome["outcome"] == run.outcome_text
    found = replay(recording.path)
    assert found.is_identical, found
    assert 0 < found.cycles < 600.0 / 0.02


@pytest.mark.alone  # beside other work a full queue keeps frames from the computer, not us
@pytest.mark.parametrize(
    ("pace", "seconds", "seed"), [(0.0, 100.0, 1), (0.0, 100.0, 2), (1.0, 4.0, 3), (5.0, 10.0, 4)]
)
def test_a_flight_among_false_frames_replays_to_the_bit(
    tmp_path: Path, bus: tuple[str, Callable[[], str]], pace: float, seconds: float, seed: int
) -> None:
    plan, address = bus
    with third_sender(address, seed, is_deadly=pace > 0.0) as sender:
        run = run_of(piece(seconds), tmp_path / "a.load", plan, pace=pace)
        assert fly_and_record(run, tmp_path) == ""
    assert run.outcome_text == "time out"  # flown to the end of its piece
    recording = open_recording(tmp_path / "flight.mcap")
    found = replay(recording.path)
    assert found.is_identical, found
    assert found.cycles >= seconds / 0.02 * 0.9
    assert found.unanswered == 0
    assert found.reports == 0, "the computer heard other frames than we"
    assert len(found.ticks) == run.computer["ticks"]
    assert sender.sent > 300
    strange = ~np.isin(recording.bus["frame"]["can_id"], list(HARNESS_IDS))
    assert strange.sum() > 200
    refused = sum(n for name, n in run.computer["verdicts"].items() if name not in ("OK", "LOST"))
    assert refused > 20, "the computer heard next to nothing of it"
