"""A recording as tables: every CAN message at its full rate, the truth, the log, the raw frames."""

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from flight_sw.can.address import (
    ERROR_FLAG,
    EXTENDED_FLAG,
    REMOTE_FLAG,
    STANDARD_MASK,
)
from flight_sw.errors import RecordingError
from flight_sw.icd import FRAME_BYTES
from sim_harness.telemetry.reader import Recording
from tools.flight_facts import named, phases_of

F8 = npt.NDArray[np.float64]
TABLES = ("truth", "log", "frames")  # beside those of the messages
WIDE_MASK = ~(EXTENDED_FLAG | REMOTE_FLAG | ERROR_FLAG) & 0xFFFFFFFF  # 29 bits
PART = ".part"  # of the name of a file that is not whole yet
Column = npt.NDArray[np.float64] | npt.NDArray[np.int64]


def _write_csv(table: pa.Table, path: Path) -> None:
    pyarrow.csv.write_csv(table, path)


def _write_parquet(table: pa.Table, path: Path) -> None:
    pyarrow.parquet.write_table(table, path, compression="zstd")


WRITERS: dict[str, Callable[[pa.Table, Path], None]] = {
    "parquet": _write_parquet,
    "csv": _write_csv,
}


def tables(recording: Recording) -> Iterator[tuple[str, pa.Table]]:
    """Name and content of every table that has a row; enumerations have a column of names too."""
    for message in () if recording.dbc_failure else recording.decoder.messages:
        t_s, columns = recording.message(message.name)
        if len(t_s):
            name = f"can_{message.name}" if message.name in TABLES else message.name
            yield name, _message_table(recording.value_names(message.name), t_s, columns)
    if len(truth := recording.truth):
        yield "truth", pa.table({name: truth[name] for name in truth.dtype.names or ()})
    if log := recording.log:
        levels = [line.level.name for line in log]
        content = {"t_s": [line.t_s for line in log], "level": levels}
        phases = phases_of(recording.manifest)
        yield "log", pa.table({**content, "text": [named(line.text, phases) for line in log]})
    if len(bus := recording.bus):
        yield "frames", _frames_table(bus)


def _message_table(
    names: dict[str, dict[int, str]], t_s: F8, columns: Mapping[str, Column]
) -> pa.Table:
    found: dict[str, object] = {"t_s": t_s}
    for name, column in columns.items():
        # A message may carry the mission time itself; the first column is when it was on the bus.
        found[name if name not in found else f"sent_{name}"] = column
        if name in names:
            found[f"{name}_name"] = _named(column, names[name])
    return pa.table(found)


def _named(column: Column, names: Mapping[int, str]) -> pa.Array:
    """What each value is called; empty where it has no name."""
    values, places = np.unique(column, return_inverse=True)
    words = pa.array([names.get(value, "") for value in values.tolist()], pa.string())
    return words.take(pa.array(places))


def _frames_table(bus: npt.NDArray[np.void]) -> pa.Table:
    """Raw frames: identifiers without their flags, of the data what was sent of it."""
    can_id, dlc = bus["frame"]["can_id"], bus["frame"]["dlc"]
    is_extended, is_remote, is_error = (
        can_id & flag != 0 for flag in (EXTENDED_FLAG, REMOTE_FLAG, ERROR_FLAG)
    )
    is_wide = is_extended | is_error  # classes of an error stand where the identifier would
    sent = np.where(is_remote, 0, np.minimum(dlc, FRAME_BYTES))
    return pa.table(
        {
            "t_s": bus["t_s"].copy(),
            "can_id": can_id & np.where(is_wide, WIDE_MASK, STANDARD_MASK).astype(np.uint32),
            "is_extended": is_extended,
            "is_remote": is_remote,
            "is_error": is_error,
            "dlc": dlc.copy(),
            "data_hex": _hex(bus["frame"]["data"], sent.astype(np.int64)),
        }
    )


def _hex(words: npt.NDArray[np.uint64], sent: npt.NDArray[np.int64]) -> pa.Array:
    """The first so many bytes of each word in hexadecimal, in the order of the bus."""
    octets = np.ascontiguousarray(words).view(np.uint8).reshape(len(words), FRAME_BYTES)
    kept = octets[np.arange(FRAME_BYTES) < sent[:, None]]
    offsets = np.concatenate([[0], np.cumsum(2 * sent)]).astype(np.int64)
    digits = pa.py_buffer(kept.tobytes().hex().encode())
    texts = pa.LargeStringArray.from_buffers(len(words), pa.py_buffer(offsets), digits)
    return texts.cast(pa.string())


def export(recording: Recording, form: str, out: Path, *, force: bool) -> list[Path]:
    """Write one file a table; refuses to replace one unless forced."""
    if form not in WRITERS:
        raise RecordingError(f"--format {form}: allowed are {', '.join(WRITERS)}")
    content = {out / f"{name}.{form}": table for name, table in tables(recording)}
    if not content:
        raise RecordingError(f"{recording.path}: holds no frame and no sample, nothing to export")
    if not force and (there := [path.name for path in content if path.exists()]):
        raise RecordingError(f"--out {out}: holds {there[0]} already, --force replaces it")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"--out {out}: cannot be written, {error.strerror}") from error
    for path, table in content.items():
        write_table(table, path)
    return list(content)


def write_table(table: pa.Table, path: Path) -> None:
    """Write a table in the form that its name ends in, whole or not at all."""
    unfinished = path.with_name(path.name + PART)
    try:
        WRITERS[path.suffix.removeprefix(".")](table, unfinished)
        unfinished.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            unfinished.unlink()
        why = os.strerror(error.errno) if error.errno else error.strerror or str(error)
        raise RecordingError(f"--out {path}: cannot be written, {why}") from error
