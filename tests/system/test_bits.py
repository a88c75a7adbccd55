"""The same bits, whatever the computer runs as: compiled, interpreted, continued, over a bus,
replayed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flight_sw.guidance.planned.planned_lqr import FROM_JOB, IN_FORCE, SEEKING
from sim_harness.flight.bus_flight import fly_bus
from sim_harness.flight.flight import FlightRun, fly_memory
from sim_harness.replay.replayer import Replayer
from sim_harness.telemetry.reader import open_recording
from tests.system.flights import (
    ALL_LAWS,
    FLOWN,
    MARS_LAWS,
    PIECES,
    PLANNED_LAWS,
    ROOT,
    Built,
    Computer,
    World,
    any_built,
    built,
    commands,
    on_the_plan,
    planning,
    run_of,
    sha256,
    shipped,
)
from tools.commands.fly import fly_and_record

CYCLES = 150
FELT_S = 6.0
PROCESS_TIMEOUT_S = 300.0


MARS_PIECE = "drag felt"
PLANNED_PIECES = ("planning", "on the plan")


def piece_of(law: str, piece: str) -> Built:
    """A piece of Hyperion-1, or the one of Mars, the first second of which the law waits in."""
    if piece in PLANNED_PIECES:
        return planning(law, FELT_S) if piece == "planning" else on_the_plan(law, FELT_S)
    return shipped(law, seconds=FELT_S) if piece == MARS_PIECE else built(law, piece)


def fingerprint(law: str, piece: str) -> dict[str, str]:
    """Hashes over frames, truth and final state of a piece flown in memory."""
    made = piece_of(law, piece)
    world, computer = World(made, CYCLES), Computer(made)
    world.fly(computer, CYCLES)
    return {
        "frames": sha256(world.frames),
        "truth": sha256(world.truth),
        "state": sha256(computer.state),
    }


PLANNED = [(law, piece) for law in PLANNED_LAWS for piece in PLANNED_PIECES]


def all_fingerprints() -> dict[str, dict[str, str]]:
    """Of every law and piece."""
    pieces = [piece for piece in PIECES if piece != "minute"]
    flown = [(law, piece) for law in FLOWN for piece in pieces]
    flown += [(law, MARS_PIECE) for law in MARS_LAWS]
    flown += PLANNED
    return {f"{law} {piece}": fingerprint(law, piece) for law, piece in flown}


@pytest.mark.jit_only
def test_interpreted_and_compiled_code_give_the_same_bits() -> None:
    code = "from tests.system.test_bits import *; print(json.dumps(all_fingerprints()))"
    interpreted = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=PROCESS_TIMEOUT_S,
        check=True,
    )
    assert json.loads(interpreted.stdout) == all_fingerprints()


CONTINUED = [(law, piece) for law in FLOWN for piece in ("peak", "hand-over")]
AT_MARS = [(law, MARS_PIECE) for law in MARS_LAWS]
CONTINUED += [*AT_MARS, *PLANNED]


@pytest.mark.parametrize(
    ("law", "piece"), [*((law, "tracking") for law in FLOWN), *AT_MARS, *PLANNED]
)
def test_two_flights_are_the_same(law: str, piece: str) -> None:
    assert fingerprint(law, piece) == fingerprint(law, piece)


@pytest.mark.parametrize("law", MARS_LAWS)
def test_the_piece_of_mars_begins_before_its_law_and_ends_within_it(law: str) -> None:
    made = piece_of(law, MARS_PIECE)
    world, computer = World(made, CYCLES), Computer(made)
    world.fly(computer, 1)
    assert computer.state["guidance"]["tracking"][0] == 0
    world.fly(computer, CYCLES - 1)
    assert computer.state["guidance"]["tracking"][0] == 1


def test_the_pieces_of_a_plan_begin_in_a_job_and_one_of_them_ends_on_its_plan() -> None:
    for piece, tracks, ends in zip(PLANNED_PIECES, (0, 1), (SEEKING, IN_FORCE), strict=True):
        made = piece_of("planned-lqr", piece)
        world, computer = World(made, CYCLES), Computer(made)
        world.fly(computer, CYCLES // 3)
        assert computer.state["law"]["stage"][0] == SEEKING
        world.fly(computer, CYCLES - CYCLES // 3)
        assert computer.state["guidance"]["tracking"][0] == tracks
        assert computer.state["law"]["stage"][0] == ends
        assert (computer.state["law"]["source"][0] == FROM_JOB) == (ends == IN_FORCE)


@pytest.mark.parametrize(("law", "piece"), CONTINUED)
def test_a_flight_continued_from_its_bytes_goes_on_the_same(law: str, piece: str) -> None:
    made = piece_of(law, piece)
    whole, computer = World(made, CYCLES), Computer(made)
    whole.fly(computer, CYCLES // 3)
    at = len(whole.frames)
    kept = whole.harness.tobytes(), computer.state.tobytes()
    whole.fly(computer, CYCLES - CYCLES // 3)

    part, other = World(made, CYCLES), Computer(made, armed=False)
    part.harness = np.frombuffer(bytearray(kept[0]), part.harness.dtype)
    other.state = np.frombuffer(bytearray(kept[1]), other.state.dtype)
    part.fly(other, CYCLES - CYCLES // 3)
    assert part.frames[at:].tobytes() == whole.frames[at:].tobytes()
    assert len(commands(part.frames[at:])) == CYCLES - CYCLES // 3


def flown_over(bus: str, made: Built, path: Path, recorded: bool = False) -> FlightRun:
    """A whole flight over one kind of bus."""
    run = run_of(made, path / f"{made.law}.load", bus, recorded=recorded)
    if bus == "memory":
        fly_memory(run)
    else:
        assert fly_bus(run) == ""
    return run


@pytest.mark.jit_only
@pytest.mark.parametrize(("law", "piece", "outcome"), [
    ("lqy", "entry", "end condition"), ("nominal", "minute", "time out"),
])  # fmt: skip
def test_two_processes_on_a_bus_fly_what_one_flies_in_memory(
    law: str, piece: str, outcome: str, tmp_path: Path
) -> None:
    made = built(law, piece)
    memory = flown_over("memory", made, tmp_path)
    over_bus = flown_over("unix", made, tmp_path, recorded=law == "lqy")
    assert over_bus.command_sha256 == memory.command_sha256
    assert over_bus.outcome_text == memory.outcome_text == outcome
    for name in memory.harness["truth"].dtype.names or ():
        assert over_bus.harness["truth"][name] == memory.harness["truth"][name], name
    refused = {k: n for k, n in over_bus.computer["verdicts"].items() if n and k != "OK"}
    assert refused == {}
    assert over_bus.computer["cycles"] == memory.harness["truth"]["minor_frames"][0]
    assert over_bus.computer["incomplete_sets"] == 0


@pytest.mark.jit_only
@pytest.mark.parametrize("law", ALL_LAWS)
def test_memory_two_processes_and_their_replay_agree_for_every_law(
    law: str, tmp_path: Path
) -> None:
    made = any_built(law, FELT_S)
    memory = flown_over("memory", made, tmp_path)
    over_bus = run_of(made, tmp_path / f"{law}.load", "unix")
    assert fly_and_record(over_bus, tmp_path) == ""
    found = Replayer(open_recording(tmp_path / "flight.mcap")).run()
    assert over_bus.command_sha256 == memory.command_sha256
    assert found.is_identical, found.difference
    assert found.cycles == round(FELT_S / made.mission.dt_s)
    assert over_bus.harness["truth"][0]["v_rel_mps"] == memory.harness["truth"][0]["v_rel_mps"]
