"""How flights went over their speed: a row of each at the same speeds, for bands and corridors.

Kept beside the results, because a journal of scalars is no place for curves. While a campaign flies
they lie in `profiles.bin`, a record of fixed size a run at the place of its number, so that neither
order nor a kill matters; finished, they become `profiles.parquet`. A knot holds the state at the
first time that a flight was as slow as that, NaN where it never was.
"""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from sim_harness.flight.flight import FlightRun
from sim_harness.mission.documents import json_of
from sim_harness.mission.mission import Mission
from sim_harness.world.assembly import truth_of
from sim_harness.world.records import TRUTH
from tools.campaign.columns import UNREADABLE, opened, refused
from tools.campaign.folder import MANIFEST, PROFILES, SPOOL
from tools.gains.image import replacing

F4 = npt.NDArray[np.float32]
F8 = npt.NDArray[np.float64]

KEY = "profile"  # of a flown row, taken out before the row is kept
SPEEDS = b"speed_mps"  # of the table's metadata
KNOTS = 128
RATE_HZ = 5.0  # of the truth that the knots are interpolated in
HEAD_ROOM = 1.02  # a vehicle gains speed before it meets air
SPEED_FLOOR = 0.02  # share of the entry speed, where the mission has no end speed
GROUP_ROWS = 1024

FIELDS = (
    "alt_m", "lat_rad", "heading_rad", "drag_mps2", "lift_mps2", "dynamic_pressure_pa",
    "heat_flux_wpm2", "load_factor_g",
)  # fmt: skip
"""Of the truth record, and the columns of the table."""
HEADING = "heading_rad"  # its jump from 180 to -180 deg is no value


class Profiles(NamedTuple):
    """The profiles of a campaign: a row a flight, a column a knot."""

    speed_mps: F8
    runs: npt.NDArray[np.int64]
    fields: dict[str, F4]


def speeds(mission: Mission) -> F8:
    """The speeds of the knots, ascending: the same for every flight of a campaign."""
    entry_mps = float(truth_of(mission)["v_rel_mps"][0])
    low_mps = max(mission.end.speed_mps, SPEED_FLOOR * entry_mps)
    return np.linspace(low_mps, max(HEAD_ROOM * entry_mps, low_mps + KNOTS), KNOTS)


def at_speeds(rows: npt.NDArray[np.void], speed_mps: F8) -> F4:
    """The fields of one flight's truth at the knots, one row a field."""
    slowest = np.minimum.accumulate(rows["v_rel_mps"]) if len(rows) else np.zeros(0)
    first = np.flatnonzero(np.diff(slowest, prepend=np.inf) < 0.0)  # the first time at each speed
    found = np.full((len(FIELDS), len(speed_mps)), np.nan, np.float32)
    if len(first):
        ascending = slowest[first][::-1]
        for i, name in enumerate(FIELDS):
            whole = np.unwrap(rows[name]) if name == HEADING else rows[name]
            values = whole[first][::-1]
            found[i] = np.interp(speed_mps, ascending, values, left=np.nan, right=np.nan)
    return found


class Profiler:
    """Listens to a flight in memory and keeps its truth."""

    def __init__(self) -> None:
        self._rows: list[npt.NDArray[np.void]] = []

    def rows(self, bus: npt.NDArray[np.void], truth: npt.NDArray[np.void]) -> None:
        """Keep what the loop logged."""
        self._rows.append(truth)

    def progress(self, run: FlightRun) -> None:
        """Nothing to show."""

    def waiting(self, text: str) -> None:
        """Nothing to show."""

    def warn(self, t_s: float, text: str) -> None:
        """Nothing to show."""

    def profile(self, run: FlightRun, speed_mps: F8) -> bytes:
        """The flight's profile, its last state included."""
        kept = b"".join(rows.tobytes() for rows in (*self._rows, run.harness["truth"]))
        return at_speeds(np.frombuffer(kept, TRUTH), speed_mps).tobytes()


class Spool:
    """The profiles of a campaign in progress."""

    def __init__(self, folder: Path, speed_mps: F8) -> None:
        self.folder = folder
        self.speed_mps = speed_mps
        self.size = len(FIELDS) * len(speed_mps) * np.dtype(np.float32).itemsize
        self._file: Any = None

    def add(self, number: int, profile: bytes | None) -> None:
        """Keep a run's profile; one that was not flown has none."""
        if self._file is None:
            path = self.folder / SPOOL
            self._file = path.open("r+b" if path.exists() else "w+b", buffering=0)
        kept = profile if profile is not None else np.full(self.size // 4, np.nan, "f4").tobytes()
        os.pwrite(self._file.fileno(), kept, (number - 1) * self.size)

    def fill_up(self, n: int) -> None:
        """Keep no profile of the first `n` runs where the file has been cut short before them."""
        path = self.folder / SPOOL
        size = path.stat().st_size if path.is_file() else 0
        if n * self.size > size:
            with path.open("r+b" if path.exists() else "w+b") as spool:
                spool.truncate(size - size % self.size)
                spool.seek(0, os.SEEK_END)
                empty = np.full(self.size // 4, np.nan, "f4").tobytes()
                for _ in range(n - size // self.size):
                    spool.write(empty)

    def finish(self, n: int) -> None:
        """Make profiles.parquet; without one profile, nothing."""
        path = self.folder / SPOOL
        if not path.is_file():
            return
        shape = (n, len(FIELDS), len(self.speed_mps))
        with path.open("r+b") as spool:
            spool.truncate(n * self.size)
        kept = np.memmap(path, np.float32, "r", shape=shape)
        form = schema(self.speed_mps)
        with (
            replacing(self.folder / PROFILES) as temporary,
            pq.ParquetWriter(
                temporary, form, compression="zstd", write_page_checksum=True
            ) as writer,
        ):
            for first in range(0, n, GROUP_ROWS):
                writer.write_table(table(kept[first : first + GROUP_ROWS], first, self.speed_mps))
        del kept
        path.unlink()

    def close(self) -> None:
        """Let go of the file."""
        if self._file is not None:
            self._file.close()


def schema(speed_mps: F8) -> pa.Schema:
    """Run, and a list for each field; the knots' speeds as metadata."""
    of_knots = pa.list_(pa.float32(), len(speed_mps))
    columns = [("run", pa.int64()), *((name, of_knots) for name in FIELDS)]
    return pa.schema(columns, metadata={SPEEDS: json.dumps(speed_mps.tolist())})


def table(block: F4, first: int, speed_mps: F8) -> pa.Table:
    """Some flights' profiles, `first` of them before."""
    knots = len(speed_mps)
    columns: list[Any] = [pa.array(np.arange(first + 1, first + 1 + len(block)))]
    for i in range(len(FIELDS)):
        flat = pa.array(np.ascontiguousarray(block[:, i]).ravel())
        columns.append(pa.FixedSizeListArray.from_arrays(flat, knots))
    return pa.table(columns, schema=schema(speed_mps))


def read_profiles(
    folder: Path, n: int, on_missing: Callable[[], None] = lambda: None
) -> Profiles | None:
    """A finished campaign's profiles; None where it has none."""
    path = folder / PROFILES
    if not path.is_file():
        on_missing()
        return None
    file = opened(path, n, told_by=MANIFEST, values=KNOTS)
    try:
        metadata = file.schema_arrow.metadata or {}
        speed_mps = np.array(json_of(metadata[SPEEDS]), np.float64)
        if speed_mps.ndim != 1 or not 2 <= len(speed_mps) <= KNOTS or not _ascends(speed_mps):
            raise ValueError("its speeds are no ascending numbers")
        check_kinds(file.schema_arrow, len(speed_mps))
        found = file.read(use_threads=False)
        found.validate(full=True)
        fields = {
            name: found[name].combine_chunks().flatten().to_numpy().reshape(n, len(speed_mps))
            for name in FIELDS
        }
        runs = found["run"].to_numpy()
        if not np.array_equal(runs, np.arange(1, n + 1)):
            raise ValueError("its runs are not those of the campaign")
        return Profiles(speed_mps, runs, fields)
    except UNREADABLE as error:
        raise refused(path, error) from None


def _ascends(speed_mps: F8) -> bool:
    return bool(np.all(np.isfinite(speed_mps)) and np.all(np.diff(speed_mps) > 0.0))


def check_kinds(found: pa.Schema, knots: int) -> None:
    """Refuse columns that are no profiles over so many speeds."""
    for field in schema(np.zeros(knots)):
        if field.name not in found.names or found.field(field.name).type != field.type:
            raise ValueError(f"column {field.name} is not of {field.type}")
