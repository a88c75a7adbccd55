"""Small flights to record: frames packed by cantools, so that nothing under test made them."""

import functools
import time
from pathlib import Path
from typing import Any

import cantools
import numpy as np

from flight_sw import icd
from flight_sw.can import codec, e2e
from sim_harness.telemetry.recorder import Recorder
from sim_harness.telemetry.records import BUS_LOG

DT_S = 0.02
DRAIN_S = 120.0  # of the clock: nobody waits for ever
DATABASE = cantools.database.load_file(icd.DBC_PATH)
CODEC = codec.build_codec()[0]
DBC = {icd.DBC_PATH.name: ("text/plain", icd.DBC_PATH.read_bytes())}
MANIFEST = {"mission": "test-1", "law": "none", "seed": "7"}

TRUTH = np.dtype(
    [
        ("minor_frames", "i8"),
        ("t_s", "f8"),
        ("lon_rad", "f8"),
        ("lat_rad", "f8"),
        ("alt_m", "f8"),
        ("held", np.dtype([("sin_bank", "f8")])),
    ],
    align=True,
)


def values_of(message: Any, cycle: int) -> dict[str, float]:
    """Values within range for every signal, other ones each cycle."""
    found = {}
    for number, signal in enumerate(message.signals):
        low = signal.conversion.numeric_scaled_to_raw(signal.minimum)
        high = signal.conversion.numeric_scaled_to_raw(signal.maximum)
        raw = round(low) + (cycle * 7919 + number * 104729) % (round(high) - round(low) + 1)
        found[signal.name] = signal.conversion.raw_to_scaled(raw, decode_choices=False)
    return found


def packed(name: str, values: dict[str, float], cycle: int) -> int:
    """A protected frame word with these values."""
    data = DATABASE.get_message_by_name(name).encode(values, strict=True)
    word = np.uint64(int.from_bytes(data, "little"))
    return int(e2e.protect(CODEC, icd.slot(name), word, cycle % 16))


@functools.cache
def word_of(name: str, cycle: int) -> int:
    """A protected frame word of a message with values of its own each cycle."""
    return packed(name, values_of(DATABASE.get_message_by_name(name), cycle), cycle)


def one_message(name: str, values: list[dict[str, float]]) -> np.ndarray:
    """Rows of one message, a minor frame each; signals that are not given are 0."""
    zeros = {s.name: 0.0 for s in DATABASE.get_message_by_name(name).signals}
    rows = np.zeros(len(values), BUS_LOG)
    rows["t_s"] = np.arange(len(values)) * DT_S
    rows["frame"]["can_id"], rows["frame"]["dlc"] = icd.layout(name).can_id, icd.FRAME_BYTES
    words = [packed(name, {**zeros, **v}, cycle) for cycle, v in enumerate(values)]
    rows["frame"]["data"] = words
    return rows


def bus_rows(cycles: range, names: tuple[str, ...] = icd.MESSAGES) -> np.ndarray:
    """Every message once in each minor frame."""
    rows = np.zeros(len(cycles) * len(names), BUS_LOG)
    for i, (cycle, name) in enumerate((c, n) for c in cycles for n in names):
        frame = rows[i]["frame"]
        rows[i]["t_s"] = cycle * DT_S
        frame["can_id"], frame["dlc"] = icd.layout(name).can_id, icd.FRAME_BYTES
        frame["data"] = word_of(name, cycle)
    return rows


def truth_rows(cycles: range) -> np.ndarray:
    """Smooth truth, one row a minor frame."""
    number = np.arange(cycles.start, cycles.stop)
    rows = np.zeros(len(cycles), TRUTH)
    rows["minor_frames"] = number
    rows["t_s"] = number * DT_S
    rows["lon_rad"], rows["lat_rad"] = -1.0 + number * 1e-4, np.sin(number * 1e-3)
    rows["alt_m"] = 122e3 - number
    rows["held"]["sin_bank"] = np.cos(number * 0.1)
    return rows


def drain(recorder: Recorder) -> None:
    """Wait until all that was handed over is on disk, in a chunk of its own."""
    recorder._wake.set()
    end_s = time.monotonic() + DRAIN_S
    while recorder._waiting_bytes and recorder.failure is None:
        assert time.monotonic() < end_s, "the recorder does not write"
        time.sleep(0.001)


def record(path: Path, cycles: range, step: int = 25, **options: Any) -> Recorder:
    """Record a whole flight, a chunk every `step` minor frames, and close it."""
    recorder = Recorder(path, MANIFEST, DBC, **options)
    for start in range(cycles.start, cycles.stop, step):
        part = range(start, min(start + step, cycles.stop))
        recorder.write_bus(bus_rows(part))
        recorder.write_truth(truth_rows(part))
        drain(recorder)
    recorder.close("end condition", {"heat_load_mjpm2": "1.5"})
    return recorder
