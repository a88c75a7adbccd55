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

from flight_sw.errors import RecordingError
from sim_harness.telemetry.reader import Recording
from tools.flight_facts import named, phases_of

F8 = npt.NDArray[np.float64]
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
    for message in recording.decoder.messages:
        t_s, columns = recording.message(message.name)
        if len(t_s):
            yield message.name, _message_table(recording.value_names(message.name), t_s, columns)
    if len(truth := recording.truth):
        yield "truth", pa.table({name: truth[name] for name in truth.dtype.names or ()})
    if log := recording.log:
        levels = [line.level.name for line in log]
        content = {"t_s": [line.t_s for line in log], "level": levels}
        phases = phases_of(recording.manifest)
        yield "log", pa.table({**content, "text": [named(line.text, phases) for line in log]})
    if len(bus := recording.bus):
        digits = bus["frame"]["data"].tobytes().hex()
        frames = {
            "t_s": bus["t_s"].copy(),
            "can_id": bus["frame"]["can_id"].copy(),
            "dlc": bus["frame"]["dlc"].copy(),
            "data_hex": [digits[i : i + 16] for i in range(0, len(digits), 16)],
        }
        yield "frames", pa.table(frames)


def _message_table(
    names: dict[str, dict[int, str]], t_s: F8, columns: Mapping[str, Column]
) -> pa.Table:
    found: dict[str, object] = {"t_s": t_s}
    for name, column in columns.items():
        # A message may carry the mission time itself; the first column is when it was on the bus.
        found[name if name not in found else f"sent_{name}"] = column
        if name in names:
            found[f"{name}_name"] = [names[name].get(value, "") for value in column.tolist()]
    return pa.table(found)


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
