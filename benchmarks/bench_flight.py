"""Whole flights of Hyperion-1: simulated time over wall time, and what a minor frame takes.

Every figure is a ratio to something measured in the same run: a flight to real time, the bus to
memory, the recorded flight to the unrecorded one. `make bench` prints them.
"""

import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from sim_harness.flight.bus_flight import fly_bus
from sim_harness.flight.flight import FlightPlan, FlightRun, fly_memory
from tools.overrides import Prepared, prepare

ROUNDS = 5
FRAME_S = 0.02


@pytest.fixture(scope="module")
def prepared() -> Prepared:
    return prepare("hyperion-1", "lqy", [], None)


def flown(prepared: Prepared, bus: str) -> FlightRun:
    """One unrecorded flight."""
    run = FlightRun(
        FlightPlan(
            prepared.mission, prepared.law, prepared.load_image, prepared.load_path, bus,
            recorded=False,
        ),
        [],
    )  # fmt: skip
    fly_memory(run) if bus == "memory" else fly_bus(run)
    return run


@pytest.mark.parametrize("bus", ["memory", "unix"])
def test_flight(bus: str, prepared: Prepared, benchmark: Any) -> None:
    runs: list[FlightRun] = []
    benchmark.pedantic(
        lambda: runs.append(flown(prepared, bus)), rounds=ROUNDS, warmup_rounds=1, iterations=1
    )
    reached = sorted(float(run.harness["truth"]["t_s"][0]) / run.wall_s for run in runs)
    steps = [run.computer["step_time_us"] for run in runs]
    step = {key: min(one[key] for one in steps) for key in steps[0]}
    benchmark.extra_info |= {"times_real_time": reached, "step_time_us": step}
    shares = ", ".join(f"{key} {us:.1f} us ({us / FRAME_S / 1e6:.2%})" for key, us in step.items())
    print(
        f"\n{bus}: best {reached[-1]:,.0f}, median {statistics.median(reached):,.0f} "
        f"times real time; minor frame of 20 ms: {shares}"
    )


def test_start(tmp_path: Path) -> None:
    """From the command to the end of the shortest flight, with warm caches."""
    command = [
        sys.executable, "-m", "tools.cli", "fly", "hyperion-1", "--bus", "unix", "--no-record",
        "--set", "time_max_s=0.1", "--out", str(tmp_path), "--force",
    ]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True)
    taken_s = []
    for _ in range(ROUNDS):
        start_s = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        taken_s.append(time.perf_counter() - start_s)
    bare = time.perf_counter()
    subprocess.run([sys.executable, "-c", "import numba, cantools, scipy.interpolate"], check=True)
    bare_s = time.perf_counter() - bare
    print(
        f"\nstart to end of a 0.1 s flight over unix: best {min(taken_s):.2f} s, "
        f"{min(taken_s) / bare_s:.1f} times importing numba, cantools and scipy alone"
    )
