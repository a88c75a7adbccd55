"""What is logged of vcan0 is what the flight computer heard: a third sender's frames replay too."""

from pathlib import Path

import pytest

from tests.system.flights import run_of
from tests.system.paced import piece
from tests.system.replays import replay
from tests.system.third_sender import third_sender
from tests.vcan.flying import BUS
from tools.commands.fly import fly_and_record

pytestmark = [pytest.mark.vcan, pytest.mark.jit_only]


@pytest.mark.parametrize(("pace", "seconds"), [(0.0, 20.0), (1.0, 5.0)])
def test_a_flight_among_false_frames_replays_to_the_bit(
    tmp_path: Path, pace: float, seconds: float
) -> None:
    with third_sender(lambda: BUS, seed=7, is_deadly=False) as sender:
        run = run_of(piece(seconds), tmp_path / "a.load", BUS, pace=pace)
        assert fly_and_record(run, tmp_path) == ""
    found = replay(tmp_path / "flight.mcap")
    refused = sum(n for name, n in run.computer["verdicts"].items() if name not in ("OK", "LOST"))
    print(f"{sender.sent} false frames, {refused} refused, {found}")
    assert found.is_identical, found
    assert found.cycles >= seconds / 0.02
    assert (found.reports, found.unanswered) == (0, 0)
    assert len(found.ticks) == run.computer["ticks"]
    assert refused > 20
