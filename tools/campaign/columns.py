"""Reads and writes the Parquet files of a campaign: damage told, memory bounded.

What a file claims is held against its size before anything is read: columns that repeat one value
take little room, and a damaged count much. Pages carry checksums.
"""

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from flight_sw.errors import FlightError
from sim_harness.mission.documents import short
from tools.gains.image import replacing

TEXTS = (
    "mission", "law", "outcome", "outcome_class", "end_trigger", "command_sha256", "load_crc32",
    "limits_exceeded", "case",
)  # fmt: skip
"""Columns of results that hold texts; all others hold numbers or truths."""
COLUMNS_MAX = 1000
FREE_BYTES = 128 * 1024 * 1024  # that may be taken whatever the file's size is
RATIO_MAX = 64  # of the memory taken over the file's size, beyond that
HEADER_BYTES_MAX = 8_000_000
NUMBER_BYTES = 8
UNREADABLE = (
    OSError, ValueError, KeyError, TypeError, OverflowError, MemoryError, pa.ArrowException,
)  # fmt: skip
"""What pyarrow throws at a damaged file."""


def refused(path: Path, why: object) -> FlightError:
    """The sentence about a damaged file."""
    return FlightError(f"{path}: cannot be read ({short(str(why).partition(chr(10))[0])})")


def opened(path: Path, rows: int, told_by: str, values: int = 1) -> pq.ParquetFile:
    """A file with so many rows, its claims checked; `values` are in a cell."""
    try:
        size = path.stat().st_size
        file = pq.ParquetFile(
            path,
            page_checksum_verification=True,
            thrift_string_size_limit=HEADER_BYTES_MAX,
            thrift_container_size_limit=HEADER_BYTES_MAX,
        )
        metadata, names = file.metadata, file.schema_arrow.names
        told, columns = metadata.num_rows, metadata.num_columns
        in_groups = sum(metadata.row_group(i).num_rows for i in range(metadata.num_row_groups))
    except UNREADABLE as error:
        raise refused(path, error) from None
    if told != rows or in_groups != rows:
        raise FlightError(f"{path}: has {told:,} flights, {told_by} says {rows:,}")
    if columns > COLUMNS_MAX or len(set(names)) < len(names):
        raise refused(path, f"it has {columns:,} columns, or two of one name")
    return _bounded(path, file, size, values)


def bound(size: int) -> int:
    """Bytes that may be taken for a file of this size."""
    return FREE_BYTES + RATIO_MAX * size


def _bounded(path: Path, file: pq.ParquetFile, size: int, values: int) -> pq.ParquetFile:
    """Single columns are not asked about: pyarrow ends the process over what is damaged there."""
    needed = file.metadata.num_rows * file.metadata.num_columns * values * NUMBER_BYTES
    if needed > bound(size):
        raise refused(path, f"{size:,} bytes that claim to hold {needed:,}")
    return file


def _kind(kind: pa.DataType) -> str:
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return "text"
    is_number = pa.types.is_integer(kind) or pa.types.is_floating(kind)
    return "number" if is_number or pa.types.is_boolean(kind) else ""


def read_columns(path: Path, rows: int, needed: tuple[str, ...], told_by: str) -> pa.Table:
    """A table of numbers, truths and the texts of results, with so many rows and these columns."""
    file = opened(path, rows, told_by)
    schema = file.schema_arrow
    for name in needed:
        if name not in schema.names:
            raise FlightError(f"{path}: has no column {name}: not that of a campaign")
    for field in schema:
        wanted = "text" if field.name in TEXTS else "number"
        may_be_empty = field.name in TEXTS and _kind(field.type) == "number"  # see `_plain`
        if _kind(field.type) != wanted and not pa.types.is_null(field.type) and not may_be_empty:
            raise refused(path, f"column {short(field.name)} holds {field.type}")
    texts = [field.name for field in schema if _kind(field.type) == "text"]
    size = path.stat().st_size
    try:
        file = pq.ParquetFile(path, read_dictionary=texts, page_checksum_verification=True)
        table = file.read(use_threads=False)
        columns = {name: _plain(table[name], name, bound(size)) for name in schema.names}
        found = pa.table(columns)
        found.validate(full=True)
        for name in needed:
            if found[name].null_count:
                raise refused(path, f"column {name} has gaps")
    except UNREADABLE as error:
        raise refused(path, error) from None
    if len(found) != rows:
        raise FlightError(f"{path}: has {len(found):,} flights, {told_by} says {rows:,}")
    return found


def _plain(column: pa.ChunkedArray, name: str, bytes_max: int) -> pa.ChunkedArray:
    """Texts as such, where they are not too many: the file keeps equal ones once.

    Campaigns have kept a text that no flight told as numbers, none of them there.
    """
    if name in TEXTS and _kind(column.type) == "number":
        if column.null_count < len(column):
            raise ValueError(f"column {name} holds {column.type}")
        return pa.chunked_array([pa.nulls(len(column), pa.string())])
    if not pa.types.is_dictionary(column.type):
        return column
    total = 0
    for chunk in column.chunks:
        lengths = pc.take(pc.binary_length(chunk.dictionary), chunk.indices)
        total += pc.sum(lengths).as_py() or 0
    if total > bytes_max:
        raise ValueError(f"texts of {total:,} bytes")
    return column.cast(pa.string())


def numbers(table: pa.Table, name: str) -> Any:
    """A column of numbers or truths as floats, gaps as not a number."""
    return table[name].cast(pa.float64()).to_numpy(zero_copy_only=False)


def write_table(table: pa.Table, path: Path) -> None:
    """Write under a temporary name, then rename."""
    with replacing(path) as temporary:
        pq.write_table(table, temporary, write_page_checksum=True)
