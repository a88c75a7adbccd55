"""Recordings: what one costs the flight that it is made of, and how fast one is replayed.

A flight with a recording and one without take turns in the same run, and the best of each are
compared: run it on an idle machine all the same, for the recorder compresses beside the loop and
wants a processor of its own. A flight in memory has ended before its file is complete.
"""

import statistics
import time
from pathlib import Path
from typing import Any

import pytest

from sim_harness.flight.flight import FlightPlan, FlightRun
from sim_harness.telemetry.records import RECORDING_NAME
from tools.commands.fly import fly_and_record
from tools.overrides import Prepared, prepare
from tools.replaying import replayed

ROUNDS = 5
SLOWER_MAX = 1.25  # a recorded flight in lockstep over the bus, to one that is not
SIZE_MAX_BYTES = 15_000_000  # a whole flight
REPLAY_MIN = 2000.0  # times real time


@pytest.fixture(scope="module")
def prepared() -> Prepared:
    return prepare("hyperion-1", "lqy", [], None)


def flown_s(prepared: Prepared, bus: str, folder: Path | None) -> tuple[float, float]:
    """How long the loop of a flight took, and how long all of it did with its file complete."""
    plan = FlightPlan(
        prepared.mission, prepared.law, prepared.load_image, prepared.load_path, bus,
        recorded=folder is not None,
    )  # fmt: skip
    run = FlightRun(plan, [])
    start_s = time.perf_counter()
    assert fly_and_record(run, folder) == ""
    return run.wall_s, time.perf_counter() - start_s


@pytest.mark.parametrize("bus", ["memory", "unix"])
def test_what_recording_costs(bus: str, prepared: Prepared, tmp_path: Path, benchmark: Any) -> None:
    turns: list[tuple[tuple[float, float], tuple[float, float]]] = []

    def both() -> None:
        turns.append((flown_s(prepared, bus, None), flown_s(prepared, bus, tmp_path)))

    benchmark.pedantic(both, rounds=ROUNDS, warmup_rounds=1, iterations=1)
    turns = turns[1:]
    loop, whole = (
        min(recorded[part] for _, recorded in turns) / min(alone[part] for alone, _ in turns)
        for part in (0, 1)
    )
    size = (tmp_path / RECORDING_NAME).stat().st_size
    benchmark.extra_info |= {"loop_ratio": loop, "whole_ratio": whole, "bytes": size}
    print(
        f"\n{bus}: recorded, the loop takes {loop:.2f} times as long, the flight with its file "
        f"complete {whole:.2f} times; {size / 1e6:.1f} MB"
    )
    assert size < SIZE_MAX_BYTES
    if bus != "memory":
        assert loop < SLOWER_MAX


def test_replay(prepared: Prepared, tmp_path: Path, benchmark: Any) -> None:
    flown_s(prepared, "memory", tmp_path)
    speeds: list[float] = []

    def once() -> None:
        _, found, wall_s = replayed(tmp_path)
        assert found.is_identical
        speeds.append(found.until_s / wall_s)

    benchmark.pedantic(once, rounds=ROUNDS, warmup_rounds=1, iterations=1)
    best, median = max(speeds), statistics.median(speeds)
    benchmark.extra_info |= {"times_real_time": sorted(speeds)}
    print(f"\nreplay: best {best:,.0f}, median {median:,.0f} times real time")
    assert best > REPLAY_MIN
