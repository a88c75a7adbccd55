"""The same bits, whatever the computer runs as: compiled, interpreted, continued, over a bus."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sim_harness.bus_flight import fly_bus
from sim_harness.flight import FlightRun, fly_memory
from tests.system.flights import (
    FLOWN,
    PIECES,
    ROOT,
    Built,
    Computer,
    World,
    built,
    commands,
    run_of,
    sha256,
)

CYCLES = 150
PROCESS_TIMEOUT_S = 300.0


def fingerprint(law: str, piece: str) -> dict[str, str]:
    """Hashes over frames, truth and final state of a piece flown in memory."""
    world, computer = World(built(law, piece), CYCLES), Computer(built(law, piece))
    world.fly(computer, CYCLES)
    return {
        "frames": sha256(world.frames),
        "truth": sha256(world.truth),
        "state": sha256(computer.state),
    }


def all_fingerprints() -> dict[str, dict[str, str]]:
    """Of every law and piece."""
    pieces = [piece for piece in PIECES if piece != "minute"]
    return {f"{law} {piece}": fingerprint(law, piece) for law in FLOWN for piece in pieces}


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


@pytest.mark.parametrize("law", FLOWN)
def test_two_flights_are_the_same(law: str) -> None:
    assert fingerprint(law, "tracking") == fingerprint(law, "tracking")


@pytest.mark.parametrize("law", FLOWN)
@pytest.mark.parametrize("piece", ["peak", "hand-over"])
def test_a_flight_continued_from_its_bytes_goes_on_the_same(law: str, piece: str) -> None:
    whole, computer = World(built(law, piece), CYCLES), Computer(built(law, piece))
    whole.fly(computer, CYCLES // 3)
    at = len(whole.frames)
    kept = whole.harness.tobytes(), computer.state.tobytes()
    whole.fly(computer, CYCLES - CYCLES // 3)

    part, other = World(built(law, piece), CYCLES), Computer(built(law, piece), armed=False)
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
