"""Replays on the ground's side: what takes long is said, what is written is not overwritten."""

import time
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pyarrow as pa

from flight_sw.errors import AeroshellError, RecordingError
from flight_sw.load_image import LoadImage, read_image
from flight_sw.runtime.kernel_cache import on_compiling
from flight_sw.runtime.streams import say
from sim_harness.replay.open_loop import Compared, compare
from sim_harness.replay.replayer import Replay, Replayer, warm_up
from sim_harness.replay.script import (
    Heard,
    attached_load,
    check_dbc,
    check_messages,
    heard_by_computer,
)
from sim_harness.telemetry.reader import Recording, load_kernels, open_recording
from tools.flight_tables import WRITERS, write_table

RAD_SUFFIX = "_rad"
NOTHING = "holds no minor frame that its flight computer answered, nothing is to be compared"


def say_compiling(what: str) -> AbstractContextManager[None]:
    """Says on stderr if something is compiled in a block."""
    return on_compiling(lambda: say(f"compiling {what} for this processor"))


def replayed(flight: Path) -> tuple[Recording, Replay, float]:
    """A recording, how its replay went, and how long reading and feeding it took.

    Compiled code is loaded before: that takes as long for a second of flight as for an hour.
    """
    with say_compiling("the reader of recordings"):
        load_kernels()
    start_s = time.perf_counter()
    recording = open_recording(flight)
    check_dbc(recording)
    image = attached_load(recording)
    opened_s = time.perf_counter()
    with say_compiling(f"law '{image.law}'"):
        warm_up(image)
    warm_s = time.perf_counter()
    found = Replayer(recording, image).run()
    if not found.cycles and found.difference is None:
        raise RecordingError(f"{recording.path}: {NOTHING}")
    return recording, found, time.perf_counter() - warm_s + opened_s - start_s


def compared_with(flight: Path, load: Path) -> tuple[Recording, LoadImage, Compared]:
    """A recording, and what another load would have commanded of it."""
    recording, image = open_recording(flight), read_image(load)
    check_messages(recording)
    with say_compiling(f"law '{image.law}'"):
        compared = compare(recording, image, _heard(recording))
    if not len(compared.t_s):
        raise RecordingError(f"{recording.path}: {NOTHING}")
    return recording, image, compared


def _heard(recording: Recording) -> Heard:
    """What its computer heard; as it looks where the load that flew is unreadable."""
    try:
        replayer = Replayer(recording)
        replayer.run()
    except AeroshellError:
        return heard_by_computer(recording)
    return replayer.heard


def check_out(out: Path, *, force: bool) -> None:
    """Refuse an output that cannot be written before anything is computed."""
    form = out.suffix.removeprefix(".")
    if form not in WRITERS:
        allowed = ", ".join(f".{name}" for name in WRITERS)
        raise RecordingError(f"--out {out}: allowed are names that end in {allowed}")
    if out.exists() and not force:
        raise RecordingError(f"--out {out}: exists already, --force replaces it")


def write_compared(compared: Compared, out: Path) -> None:
    """Both loads' commands, a row a minor frame, angles in degrees."""
    columns = {"t_s": compared.t_s}
    for side, found in (("recorded", compared.recorded), ("other", compared.other)):
        for name, column in found.items():
            in_deg = name.endswith(RAD_SUFFIX)
            shown = name.removesuffix(RAD_SUFFIX) + ("_deg" if in_deg else "")
            columns[f"{side}_{shown}"] = np.degrees(column) if in_deg else column
    write_table(pa.table(columns), out)
