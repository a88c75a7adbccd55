"""The journal of a flight: its rows beside the recording, in the system's hands within a moment.

The recorder compresses chunks beside the loop; a flight in lockstep runs ahead of it by minutes of
flight. So that a process killed at any moment takes less than a second of flight with it, the loop
itself appends what it has logged to a plain file, a block every KEEP_S of flight with one system
call. Against the clock the rows are appended by who drains the logs, and the loop writes nothing.
A journal that cannot be written ends alone. The file is removed once the recording is complete.

What is written survives the process, not the machine: nothing is forced to the disk.
"""

import contextlib
import errno
import json
import os
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import types

from flight_sw.can.libc import IOVEC, c_function, last_errno
from flight_sw.errors import RecordingError
from flight_sw.records.types_ import U8, Record
from flight_sw.runtime.echo import is_plain_name
from sim_harness.jit import kernel
from sim_harness.telemetry.files import read_whole
from sim_harness.telemetry.records import BUS_LOG, TIME_MAX_S

Rows = npt.NDArray[np.void]

SUFFIX = ".journal"
MAGIC = b"AEROJRN2"  # the head has had a checksum since 2
BLOCK_MAGIC = 0x4C4E524A
KEEP_S = 0.25  # of flight, between two blocks
BUS_ROWS, TRUTH_ROWS = 1, 2  # kinds of blocks
HEAD_WORD_BYTES = 4  # of the head's length, and of its CRC-32
BUS_ROW_BYTES = BUS_LOG.itemsize
WORD_BYTES = 8
SUM_START, SUM_FACTOR = np.uint64(0xCBF29CE484222325), np.uint64(0x100000001B3)  # FNV-1a
ENOSPC = errno.ENOSPC
HEAD_BYTES_MAX, ROW_BYTES_MAX, DEPTH_MAX = 1 << 20, 1 << 16, 4  # of what is read
FORMS = ("<f8", "<i8", "<u8", "<f4", "<i4", "<u4", "<i2", "<u2", "|i1", "|u1", "|b1")
NONE = 0  # no file: descriptor 0 is never ours

BLOCK = np.dtype([("magic", "<u4"), ("kind", "<u4"), ("bytes", "<u8"), ("sum", "<u8")])
"""What stands before the rows of a block; the sum is over all of them."""
BLOCK_BYTES = BLOCK.itemsize

JOURNAL = np.dtype(
    [
        ("fd", "i8"),
        ("every", "i8"),  # minor frames from one block to the next
        ("error", "i8"),  # why it ended early
        ("bus_rows", "i8"),  # of the log, that are in the file
        ("truth_rows", "i8"),
        ("bus_address", "u8"),  # of the log
        ("truth_address", "u8"),
        ("block", BLOCK),
        ("iov", IOVEC, (2,)),
        ("block_address", "u8"),
        ("iov_address", "u8"),
    ],
    align=True,
)
"""The loop's end of it, all zero for none. It holds its own address: never copy it in use."""

writev = c_function("writev", types.int64, types.int32, types.uint64, types.int32)


@kernel
def rows_sum(rows: Rows, first: int, last: int, row_words: int) -> np.uint64:
    """The checksum of rows of a log, over all their bytes."""
    words = rows.view(np.uint64)
    found = SUM_START
    for i in range(first * row_words, last * row_words):
        found = (found ^ words[i]) * SUM_FACTOR
    return found


@kernel
def words_sum(words: U8) -> np.uint64:
    """The checksum of words as they stand in a file, which are not to be written to."""
    found = SUM_START
    for i in range(len(words)):
        found = (found ^ words[i]) * SUM_FACTOR
    return found


@kernel
def _append(journal: Record, kind: int, address: np.uint64, size: int, total: np.uint64) -> None:
    """Write one block; a write that fails ends the journal."""
    block = journal["block"]
    block["magic"] = BLOCK_MAGIC
    block["kind"] = kind
    block["bytes"] = size
    block["sum"] = total
    iov = journal["iov"]
    iov[0]["base"] = journal["block_address"]
    iov[0]["size"] = BLOCK_BYTES
    iov[1]["base"] = address
    iov[1]["size"] = size
    written = writev(np.int32(journal["fd"]), journal["iov_address"], np.int32(2))
    if written != BLOCK_BYTES + size:
        journal["error"] = last_errno() if written < 0 else ENOSPC
        journal["fd"] = NONE


@kernel
def keep_bus(journal: Record, rows: Rows, written: int) -> None:
    """Append the rows of the bus log since the last block; the log is a ring."""
    length = len(rows)
    first = max(journal["bus_rows"], written - length)
    while first < written and journal["fd"] != NONE:
        at = first % length
        n = min(written - first, length - at)
        total = rows_sum(rows, at, at + n, BUS_ROW_BYTES // WORD_BYTES)
        address = journal["bus_address"] + np.uint64(at * BUS_ROW_BYTES)
        _append(journal, BUS_ROWS, address, n * BUS_ROW_BYTES, total)
        first += n
    journal["bus_rows"] = written


@kernel
def keep_truth(journal: Record, rows: Rows, written: int, row_bytes: int) -> None:
    """Append the rows of the truth log since the last block."""
    length = len(rows)
    first = max(journal["truth_rows"], written - length)
    while first < written and journal["fd"] != NONE:
        at = first % length
        n = min(written - first, length - at)
        total = rows_sum(rows, at, at + n, row_bytes // WORD_BYTES)
        address = journal["truth_address"] + np.uint64(at * row_bytes)
        _append(journal, TRUTH_ROWS, address, n * row_bytes, total)
        first += n
    journal["truth_rows"] = written


class Journal:
    """An open journal."""

    def __init__(self, recording: Path, recording_id: str, truth: np.dtype) -> None:
        self.path = journal_path(recording)
        self.error = ""
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC | os.O_APPEND
        self._fd = NONE
        head = {"recording": recording_id, "truth": _described(truth)}
        text = json.dumps(head).encode()
        try:
            self._fd = os.open(self.path, flags, 0o644)
            self._write(MAGIC + _word(len(text)) + _word(zlib.crc32(text)) + text)
        except OSError as error:
            self._end(error.errno or errno.EIO)

    def _write(self, data: bytes) -> None:
        if os.write(self._fd, data) != len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def _end(self, code: int) -> None:
        self.error = os.strerror(code)
        self.close()

    def serve_loop(
        self, harness: npt.NDArray[np.void], bus: Rows, truth: Rows, period_s: float
    ) -> None:
        """Have the loop itself append what it logs."""
        journal, fields = harness["journal"][0], JOURNAL.fields
        assert fields is not None
        base = harness.ctypes.data + _offset(harness.dtype, "journal")
        journal["block_address"] = base + fields["block"][1]
        journal["iov_address"] = base + fields["iov"][1]
        journal["bus_address"], journal["truth_address"] = bus.ctypes.data, truth.ctypes.data
        journal["every"] = max(int(KEEP_S / period_s), 1)
        journal["fd"] = self._fd

    def look(self, harness: npt.NDArray[np.void]) -> str:
        """Why the journal has ended since the last look; empty if it has not."""
        journal = harness["journal"][0]
        if journal["error"]:
            self._end(int(journal["error"]))
            journal["error"] = 0
        told, self.error = self.error, ""
        return told

    def append(self, kind: int, rows: Rows) -> None:
        """Append rows from outside the loop."""
        if self._fd == NONE or not len(rows):
            return
        total = rows_sum(rows, 0, len(rows), rows.itemsize // WORD_BYTES)
        block = np.array([(BLOCK_MAGIC, kind, rows.nbytes, total)], BLOCK)
        try:
            self._write(block.tobytes() + rows.tobytes())
        except OSError as error:
            self._end(error.errno or errno.EIO)

    def close(self) -> None:
        """Close the file and leave it."""
        if self._fd != NONE:
            os.close(self._fd)
            self._fd = NONE

    def remove(self) -> None:
        """Close the file and remove it: the recording is complete."""
        self.close()
        with contextlib.suppress(OSError):
            self.path.unlink()


def journal_path(recording: Path) -> Path:
    """Where the journal of a recording lies."""
    return recording.with_name(recording.name + SUFFIX)


def _word(number: int) -> bytes:
    return number.to_bytes(HEAD_WORD_BYTES, "little")


def _offset(dtype: np.dtype, name: str) -> int:
    fields: Any = dtype.fields
    return int(fields[name][1])


def _described(dtype: np.dtype) -> list[Any]:
    """A record type in a form that JSON keeps: names, types and places of its fields."""
    fields: Any = dtype.fields
    return [
        [name, _described(inner) if inner.names else inner.str, offset]
        for name, (inner, offset, *_) in fields.items()
    ] + [dtype.itemsize]


class Kept(NamedTuple):
    """What a journal holds, as far as it is whole."""

    recording_id: str
    bus: Rows
    truth: Rows
    damage: str = ""
    """Why it cannot be read at all, a sentence."""


def read_journal(recording: Path) -> Kept | None:
    """The journal beside a recording; None if there is none, or its head is not whole."""
    path = journal_path(recording)
    if not path.exists():
        return None
    try:
        content = read_whole(path)
        head_and_start = _head_of(content)
    except RecordingError as error:
        nothing = np.zeros(0, BUS_LOG)
        return Kept("", nothing, nothing, str(error))
    if head_and_start is None:
        return None
    (recording_id, truth), at = head_and_start
    blocks: dict[int, list[Rows]] = {BUS_ROWS: [], TRUTH_ROWS: []}
    types_of = {BUS_ROWS: BUS_LOG, TRUTH_ROWS: truth}
    while at + BLOCK.itemsize <= len(content):
        block = np.frombuffer(content, BLOCK, 1, at)[0]
        at += BLOCK.itemsize
        rows = _block_rows(content, at, block, types_of)
        if rows is None:
            break  # torn, or harmed: what follows cannot be found
        blocks[int(block["kind"])].append(rows)
        at += rows.nbytes
    bus, kept_truth = (
        np.concatenate([np.zeros(0, types_of[kind]), *blocks[kind]]) for kind in blocks
    )
    return Kept(recording_id, bus, kept_truth)


def _head_of(content: bytes) -> tuple[tuple[str, np.dtype], int] | None:
    """Which recording it belongs to, the type of its truth, and where its blocks begin."""
    length_at, crc_at = len(MAGIC), len(MAGIC) + HEAD_WORD_BYTES
    start = crc_at + HEAD_WORD_BYTES
    size = int.from_bytes(content[length_at:crc_at], "little")
    text = content[start : start + size]
    if content[:length_at] != MAGIC or _word(zlib.crc32(text)) != content[crc_at:start]:
        return None
    if size > HEAD_BYTES_MAX:
        return None
    try:
        head = json.loads(text)
        truth = _dtype(head["truth"], 0)
        if truth.itemsize % WORD_BYTES or truth["t_s"] != np.float64:
            return None
        return (str(head.get("recording", "")), truth), start + size
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None  # with a right checksum: of no writer of ours


def _dtype(described: list[Any], depth: int) -> np.dtype:
    """The record type that `_described` tells of; ValueError if it is none of numbers."""
    *fields, size = described
    if not isinstance(size, int) or not 0 < size <= ROW_BYTES_MAX or depth > DEPTH_MAX:
        raise ValueError(size)
    formats = []
    for name, form, offset in fields:
        if not is_plain_name(name) or not isinstance(offset, int):
            raise ValueError(name)
        if not isinstance(form, list) and form not in FORMS:
            raise ValueError(form)
        formats.append(_dtype(form, depth + 1) if isinstance(form, list) else np.dtype(form))
    offsets = [offset for *_, offset in fields]
    names = [name for name, *_ in fields]
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})


def _block_rows(
    content: bytes, at: int, block: Record, types_of: dict[int, np.dtype]
) -> Rows | None:
    """The rows of a block that is whole."""
    dtype = types_of.get(int(block["kind"]))
    size = int(block["bytes"])
    if block["magic"] != BLOCK_MAGIC or dtype is None or size % dtype.itemsize:
        return None
    if not 0 < size <= len(content) - at:
        return None
    words = np.frombuffer(content, np.uint64, size // WORD_BYTES, at)
    if words_sum(words) != block["sum"]:
        return None
    rows = np.frombuffer(content, dtype, size // dtype.itemsize, at).copy()
    is_timely = (rows["t_s"] >= 0.0) & (rows["t_s"] <= TIME_MAX_S)
    return rows if is_timely.all() else None
