"""Records the flights that tests/replay replays: `python -m tests.replay.record`.

Run it when a recording no longer fits the layout of records or messages. A recording whose
commands changed is first declared in CHANGELOG.md under *Flight behaviour*.
"""

import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from flight_sw import icd
from flight_sw.load_image import LoadImage
from sim_harness.flight.flight import FlightRun
from sim_harness.replay.replayer import Replayer
from sim_harness.telemetry.reader import open_recording
from tests.system.flights import built, run_of
from tests.system.paced import piece
from tests.system.replays import Bench, record, resealed
from tools.commands.fly import fly_and_record

FOLDER = Path(__file__).parent / "flights"
SECONDS = 16.0
TELEMETRY_HZ = 2.0  # a recording is kept for its frames
CYCLES = 800
FALSE_FRAMES_PER_CYCLE = 3
ATTEMPTS = 10


def on_the_limit(path: Path, law: str = "lqy", piece_name: str = "tracking") -> None:
    """A law where its limits are active, over the bus in lockstep."""
    made = built(law, piece_name)
    made = made._replace(mission=made.mission.model_copy(update={"end": _end(made, SECONDS)}))
    _fly(run_of(made, path.with_suffix(".load"), "unix", truth_rate_hz=TELEMETRY_HZ), path)


def _end(made: Any, seconds: float) -> Any:
    return made.mission.end.model_copy(update={"time_max_s": seconds})


def nominal_peak(path: Path) -> None:
    """The nominal law over the heat-flux peak."""
    on_the_limit(path, "nominal", "peak")


def false_frames(path: Path) -> None:
    """Frames with the harness's identifiers and right checksums among its own."""
    bench = Bench("lqy", CYCLES)
    rng = np.random.default_rng(11)
    ground = [message for message in icd.LAYOUT if message.sender == "HARNESS"]
    for _ in range(CYCLES):
        false = bench.navigation()[rng.integers(0, 7, FALSE_FRAMES_PER_CYCLE)].copy()
        chosen = rng.integers(0, len(ground), FALSE_FRAMES_PER_CYCLE)
        false["can_id"] = [ground[i].can_id for i in chosen]
        for frame in false:
            frame["data"] = resealed(bench.made, frame, int(rng.integers(0, 1 << 51)) << 12)
        bench.see(false)
        bench.cycle()
    record(bench.made, bench.rows, path, pace="lockstep")


def real_time_with_ticks(path: Path) -> None:
    """A flight against the clock whose harness is held up once, so that the computer ticks."""
    for _ in range(ATTEMPTS):
        run = run_of(piece(SECONDS), path.with_suffix(".load"), "unix", pace=1.0,
                     truth_rate_hz=TELEMETRY_HZ)  # fmt: skip
        pause = threading.Timer(SECONDS / 2.0, _hold_up)
        pause.start()
        _fly(run, path)
        pause.join()
        if run.computer.get("ticks", 0):
            return
    raise SystemExit("no flight had a tick")


def _hold_up() -> None:
    """Stop this process for some frames, and have another let it go on."""
    pause = f"kill -STOP {os.getpid()}; sleep 0.09; kill -CONT {os.getpid()}"
    subprocess.run(["sh", "-c", pause], check=True)


def _fly(run: FlightRun, path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        assert fly_and_record(run, Path(folder)) == ""
        path.write_bytes((Path(folder) / "flight.mcap").read_bytes())
    run.plan.load_path.unlink()


FLIGHTS: dict[str, Callable[[Path], None]] = {
    "lqy-on-the-limit": on_the_limit,
    "nominal-over-the-peak": nominal_peak,
    "false-frames": false_frames,
    "real-time-with-ticks": real_time_with_ticks,
}


def load_of(name: str) -> LoadImage:
    """The load that a flight would have today."""
    law, piece_name = ("nominal", "peak") if name.startswith("nominal") else ("lqy", "tracking")
    return built(law, piece_name).image


def main() -> None:
    """Record all flights anew, or those named."""
    FOLDER.mkdir(exist_ok=True)
    for name in sys.argv[1:] or FLIGHTS:
        path = FOLDER / f"{name}.mcap"
        FLIGHTS[name](path)
        found = Replayer(open_recording(path)).run()
        assert found.is_identical, f"{name}: {found.difference}"
        print(f"{path.name}: {found.cycles} frames, {len(found.ticks)} ticks, "
              f"{path.stat().st_size / 1e3:.0f} kB")  # fmt: skip


if __name__ == "__main__":
    main()
