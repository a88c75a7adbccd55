"""Recorded flights still get the same commands, or the change is declared.

A recording that no longer fits the layout of messages or records is another matter: its commands
are then compared alone, with the load as it would be today, and the test asks to record it anew.
"""

import warnings
from pathlib import Path

import pytest

from flight_sw.errors import LoadError, RecordingError
from sim_harness.replay.open_loop import compare, spreads
from sim_harness.replay.replayer import Replayer
from sim_harness.replay.script import heard_by_computer
from sim_harness.telemetry.reader import Recording, open_recording
from tests.replay.record import FLIGHTS, FOLDER, load_of

pytestmark = pytest.mark.jit_only

BYTES_MAX = 300_000
DECLARE = (
    "the flight software commands otherwise than it did: if that is meant, declare it in "
    "CHANGELOG.md under Flight behaviour and run `python -m tests.replay.record`"
)
RECORD_ANEW = "messages or records are laid out anew: run `python -m tests.replay.record`"


def same_commands_today(recording: Recording, name: str, why: Exception) -> None:
    """Compare the commands alone, where the recording's own load cannot be read any more."""
    try:
        compared = compare(recording, load_of(name), heard_by_computer(recording))
    except RecordingError as error:
        pytest.fail(f"{RECORD_ANEW} ({error})")
    if name == "real-time-with-ticks":  # where its ticks fell, its own load alone could tell
        warnings.warn(f"{name}: {RECORD_ANEW} ({why})", stacklevel=2)
        return
    assert compared.missing == 0 and len(compared.t_s) > 500, DECLARE
    assert all(spread.largest == 0.0 for spread in spreads(compared)), DECLARE
    warnings.warn(f"{name}: {RECORD_ANEW} ({why})", stacklevel=2)


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_recorded_flight_still_gets_its_commands(name: str) -> None:
    recording = open_recording(FOLDER / f"{name}.mcap")
    try:
        found = Replayer(recording).run()
    except (LoadError, RecordingError) as error:
        same_commands_today(recording, name, error)
        return
    assert found.is_identical, f"{found.difference}: {DECLARE}"
    assert found.cycles >= 800
    assert (len(found.ticks) > 0) == (name == "real-time-with-ticks")


def test_what_is_kept_is_small_and_all_of_it_is_replayed() -> None:
    kept = {path.stem: path for path in Path(FOLDER).glob("*.mcap")}
    assert set(kept) == set(FLIGHTS)
    assert {
        name: p.stat().st_size for name, p in kept.items() if p.stat().st_size > BYTES_MAX
    } == {}
