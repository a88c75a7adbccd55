"""The folder of a campaign: what it is, what it flies, and every finished flight at once.

While it flies, each flight is a line of `flights.jsonl`, written when it has ended: a killed
campaign has lost nothing but flights in the air. When all are flown the lines become
`results.parquet`, sorted by run, and the journal goes.
"""

import contextlib
import errno
import fcntl
import json
import os
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from flight_sw.errors import FlightError
from sim_harness.mission.dispersions import Samples
from tools.campaign.columns import TEXTS, write_table
from tools.campaign.folder import (
    GROUP_ROWS,
    JOURNAL,
    LOAD,
    LOCK,
    MANIFEST,
    MISSION,
    RESULTS,
    SAMPLES,
    check_plain,
    has_results,
    journal_lines,
    read_load,
    read_manifest,
    read_samples,
)
from tools.campaign.job import Flyer
from tools.campaign.plan import Plan, encoded
from tools.campaign.profiles import KEY, Spool
from tools.gains.image import replacing, write_atomically

KINDS = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}


class Store:
    """One campaign's folder, held by this process alone."""

    def __init__(self, folder: Path, plan: Plan) -> None:
        self.folder = folder
        self.plan = plan
        self._lock = self._locked()
        self._spool = Spool(folder, Flyer(plan.job).speed_mps)
        try:
            self._adopt()
            self._journal = self._open_journal()
        except BaseException:
            self.close()
            raise

    def _locked(self) -> Any:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            check_plain(self.folder, self.plan.job.law)
            lock = (self.folder / LOCK).open("ab")
        except OSError as error:
            raise FlightError(f"--out {self.folder}: cannot be used ({error.strerror})") from error
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            raise FlightError(
                f"--out {self.folder}: another process is flying this campaign"
            ) from None
        return lock

    def _adopt(self) -> None:
        """Begin in an empty folder, or go on in one of the same campaign."""
        if not (self.folder / MANIFEST).is_file():
            own = {LOCK, SAMPLES, MISSION, LOAD.format(law=self.plan.job.law)}
            own |= {f"{name}.new" for name in (*own, MANIFEST)}  # killed while it began
            others = sorted({p.name for p in self.folder.iterdir()} - own)
            if others:
                raise FlightError(
                    f"--out {self.folder}: holds {others[0]} and no {MANIFEST}: not a campaign"
                )
            self._begin()
            return
        manifest = read_manifest(self.folder)
        stored = manifest["identity"]
        wanted = self.plan.identity
        if differ := [key for key in wanted if stored.get(key) != wanted[key]]:
            told = ", ".join(f"{k} {stored.get(k)} (asked for: {wanted[k]})" for k in differ)
            raise FlightError(f"--out {self.folder}: holds a campaign with {told}")
        self._mend(manifest)

    def _mend(self, manifest: dict[str, Any]) -> None:
        """Write again what is damaged and follows from the plan."""
        job = self.plan.job
        try:
            read_samples(self.folder, manifest)
        except FlightError:
            write_table(samples_table(self.plan.samples), self.folder / SAMPLES)
        try:
            is_same = read_load(self.folder, job.law) == job.load_image
        except FlightError:
            is_same = False
        if not is_same:
            write_atomically(self.folder / LOAD.format(law=job.law), job.load_image)

    def _begin(self) -> None:
        """Samples and load first, the manifest last: a folder with one is whole."""
        plan = self.plan
        write_table(samples_table(plan.samples), self.folder / SAMPLES)
        write_atomically(self.folder / LOAD.format(law=plan.job.law), plan.job.load_image)
        write_atomically(self.folder / MISSION, Path(plan.job.mission_file).read_bytes())
        self.write_manifest({"state": "flying"})

    def write_manifest(self, more: dict[str, Any]) -> None:
        """The manifest, with how the campaign stands."""
        plan = self.plan
        job = plan.job
        manifest = {
            "identity": plan.identity,
            **more,
            "title": plan.title,
            "command": plan.command,
            "version": version("aeroshell"),
            "requirements": [r.model_dump() for r in plan.requirements],
            "told_to_both": list(plan.told_to_both),
            "fixed": dict(plan.fixed),
            "job": encoded(
                {
                    "mission_tree": job.mission_tree,
                    "told_tree": job.told_tree,
                    "design_tree": job.design_tree,
                    "mission_file": job.mission_file,
                    "law": job.law,
                    "case": job.case,
                    "load_file": job.load_file,
                }
            ),
        }
        text = json.dumps(encoded(manifest), indent=1)
        write_atomically(self.folder / MANIFEST, (text + "\n").encode())

    def _open_journal(self) -> Any:
        """The journal at its end; what is no whole result in it is a flight not flown."""
        self.offsets = np.full(self.plan.n, -1, np.int64)
        self.kinds: dict[str, set[type]] = {}
        self.flown = 0
        if self.is_complete:
            self.flown = self.plan.n
            (self.folder / JOURNAL).unlink(missing_ok=True)  # killed between its last two steps
            return None
        journal = (self.folder / JOURNAL).open("ab+")
        for line in journal_lines(self.folder / JOURNAL, self.plan.n):
            self._count(line.row, line.offset)
        end_unfinished_line(journal)
        self._spool.fill_up(int(np.flatnonzero(self.offsets >= 0).max(initial=-1)) + 1)
        return journal

    def _count(self, row: dict[str, Any], offset: int) -> None:
        self.flown += int(self.offsets[row["run"] - 1] < 0)
        self.offsets[row["run"] - 1] = offset
        for key, value in row.items():
            self.kinds.setdefault(key, set()).update(() if value is None else (type(value),))

    @property
    def is_complete(self) -> bool:
        """Whether all flights are in results.parquet."""
        return has_results(self.folder)

    def to_fly(self) -> list[int]:
        """Runs that have no result yet, in order."""
        return [] if self.is_complete else (np.flatnonzero(self.offsets < 0) + 1).tolist()

    def add(self, row: dict[str, Any]) -> None:
        """Keep a finished flight: after this call it survives the process."""
        try:
            self._spool.add(row["run"], row.pop(KEY, None))
            offset = os.fstat(self._journal.fileno()).st_size
            self._append((json.dumps(row) + "\n").encode(), offset)
        except OSError as error:
            raise FlightError(
                f"{self.folder / JOURNAL}: cannot be written ({error.strerror}); what was flown "
                "and could be kept is kept, the same command goes on with it"
            ) from error
        self._count(row, offset)

    def _append(self, line: bytes, offset: int) -> None:
        """Append a whole line or none; a file that was removed would take it and keep nothing."""
        file = self._journal.fileno()
        if os.fstat(file).st_nlink == 0:
            raise FileNotFoundError(errno.ENOENT, "the file was removed")
        try:
            if os.write(file, line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            with contextlib.suppress(OSError):
                os.truncate(file, offset)
            raise

    def _rows(self) -> Iterator[dict[str, Any]]:
        for offset in self.offsets:
            self._journal.seek(int(offset))
            yield json.loads(self._journal.readline())

    def finish(self) -> None:
        """Make results.parquet of the journal, in order of runs, a group of rows at a time."""
        self._spool.finish(self.plan.n)
        schema = pa.schema([(key, kind_of(found, key)) for key, found in self._in_order()])
        with (
            replacing(self.folder / RESULTS) as temporary,
            pq.ParquetWriter(temporary, schema, write_page_checksum=True) as writer,
        ):
            group: list[dict[str, Any]] = []
            for row in self._rows():
                group.append(row)
                if len(group) == GROUP_ROWS:
                    writer.write_table(pa.Table.from_pylist(group, schema))
                    group = []
            if group:
                writer.write_table(pa.Table.from_pylist(group, schema))
        self._journal.close()
        (self.folder / JOURNAL).unlink()

    def _in_order(self) -> list[tuple[str, set[type]]]:
        """Columns: those of the first flown run that has the most, then any others by name."""
        keys = max(self._rows(), key=len).keys()
        return [(k, self.kinds[k]) for k in (*keys, *sorted(set(self.kinds) - set(keys)))]

    def close(self) -> None:
        """Let go of the folder."""
        if getattr(self, "_journal", None) is not None:
            self._journal.close()
        self._spool.close()
        self._lock.close()


def end_unfinished_line(journal: Any) -> None:
    """A line that a kill has torn is made one of its own, so that the next begins a new one."""
    size = journal.seek(0, os.SEEK_END)
    if size:
        journal.seek(size - 1)
        if journal.read(1) != b"\n":
            journal.write(b"\n")
            journal.flush()


def kind_of(found: set[type], key: str = "") -> pa.DataType:
    """The column type for the values seen; a column without any is of texts where it should."""
    if key in TEXTS:
        return pa.string()
    if found == {int, float} or not found:
        return pa.float64()
    return KINDS[next(iter(found))] if len(found) == 1 else pa.string()


def samples_table(samples: Samples) -> pa.Table:
    """A row a flight: its number, its seed, a value for each key."""
    columns: dict[str, Any] = {"run": np.arange(1, len(samples.seeds) + 1), "seed": samples.seeds}
    for i, key in enumerate(samples.keys):
        columns[key] = samples.values[:, i]
    return pa.table(columns)
