"""An MCAP file written chunk by chunk, each of them on disk when the call returns.

The records are those of the `mcap` library; its writer is not used because it takes one message at
a time, and a flight has 200,000 of them. A file that was not finished has no footer: that is how a
reader knows. Everything before its last whole chunk is good.
"""

import contextlib
import errno
import os
import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Statistics,
    SummaryOffset,
)
from mcap.records import Schema as SchemaRecord

from sim_harness.telemetry.schema import Schema
from sim_harness.telemetry.wire import Block

MAGIC = b"\x89MCAP0\r\n"
COMPRESSION = "zstd"
LEVEL = 1  # level 3 takes twice as long for 2 % less
INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length, channel, bytes of entries
INDEX_ENTRY = np.dtype([("t_ns", "<u8"), ("offset", "<u8")])


def record_bytes(*records: McapRecord) -> bytes:
    """Records as they stand in a file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


class Container:
    """An open file: metadata and attachments, then chunks, then `finish`."""

    def __init__(self, path: Path, profile: str, library: str) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        self._length = 0
        self._crc = 0
        self._compressor = zstandard.ZstdCompressor(level=LEVEL)
        self._channels: dict[int, tuple[SchemaRecord, Channel]] = {}
        self._defined: dict[int, int] = {}  # messages so far by channel, in order of definition
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._chunks: list[ChunkIndex] = []
        self._write(MAGIC + record_bytes(Header(profile, library)))

    def _write(self, data: bytes) -> None:
        """Append; when that fails the file ends where it ended before.

        A file that was removed takes everything without complaint, and keeps nothing.
        """
        rest = memoryview(data)
        try:
            if os.fstat(self._fd).st_nlink == 0:
                raise FileNotFoundError(errno.ENOENT, "the file was removed")
            while rest:
                rest = rest[os.write(self._fd, rest) :]
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._fd, self._length)
            raise
        self._length += len(data)
        self._crc = zlib.crc32(data, self._crc)

    def add_metadata(self, name: str, items: Mapping[str, str]) -> None:
        """Write a named set of texts."""
        data = record_bytes(Metadata(name, dict(items)))
        self._metadata.append(MetadataIndex(self._length, len(data), name))
        self._write(data)

    def add_attachment(self, name: str, media_type: str, content: bytes) -> None:
        """Write a file into the file."""
        data = record_bytes(Attachment(0, 0, name, media_type, content))
        index = AttachmentIndex(self._length, len(data), 0, 0, len(content), name, media_type)
        self._attachments.append(index)
        self._write(data)

    def add_channel(self, number: int, topic: str, schema: Schema) -> None:
        """Announce a channel; it is written with its first message."""
        kept = SchemaRecord(number, schema.descriptors, "protobuf", schema.name)
        self._channels[number] = kept, Channel(number, topic, "protobuf", {}, number)

    def add_chunk(self, blocks: Sequence[Block]) -> None:
        """Compress messages into one chunk and write it with its index."""
        channels = np.concatenate([block.channels for block in blocks])
        used = np.flatnonzero(np.bincount(channels)).tolist()
        new = [n for n in used if n not in self._defined]
        definitions = record_bytes(*(record for n in new for record in self._channels[n]))
        entries = np.zeros(len(channels), INDEX_ENTRY)
        entries["t_ns"] = np.concatenate([block.t_ns for block in blocks])
        starts = np.cumsum([len(definitions)] + [len(block.blob) for block in blocks[:-1]])
        entries["offset"] = np.concatenate(
            [block.offsets + start for block, start in zip(blocks, starts, strict=True)]
        )
        content = definitions + b"".join(block.blob for block in blocks)
        chunk = Chunk(
            compression=COMPRESSION,
            data=self._compressor.compress(content),
            message_end_time=int(entries["t_ns"].max()),
            message_start_time=int(entries["t_ns"].min()),
            uncompressed_crc=zlib.crc32(content),
            uncompressed_size=len(content),
        )
        data = record_bytes(chunk)
        counts, offsets, index = _message_index(channels, entries, self._length + len(data))
        self._chunks.append(_chunk_index(chunk, self._length, len(data), (offsets, len(index))))
        self._write(data + index)
        for number, count in counts.items():
            self._defined[number] = self._defined.get(number, 0) + count

    def finish(self) -> None:
        """Write what makes the file complete, and close it."""
        self._write(record_bytes(DataEnd(self._crc)))
        start = self._length
        groups = self._summary()
        summary = b"".join(record_bytes(*group) for _, group in groups)
        offsets, at = [], start
        for opcode, group in groups:
            length = len(record_bytes(*group))
            if length:
                offsets.append(SummaryOffset(opcode, at, length))
            at += length
        summary += record_bytes(*offsets)
        footer = record_bytes(Footer(start, at, 0))
        crc = zlib.crc32(summary + footer[:-4])
        self._write(summary + record_bytes(Footer(start, at, crc)) + MAGIC)
        self.close()

    def _summary(self) -> list[tuple[int, list[McapRecord]]]:
        kept = [self._channels[n] for n in self._defined]
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(kept),
            channel_message_counts=self._defined,
            chunk_count=len(self._chunks),
            message_count=sum(self._defined.values()),
            message_end_time=max((c.message_end_time for c in self._chunks), default=0),
            message_start_time=min((c.message_start_time for c in self._chunks), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(kept),
        )
        return [
            (Opcode.SCHEMA, [schema for schema, _ in kept]),
            (Opcode.CHANNEL, [channel for _, channel in kept]),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, [*self._chunks]),
            (Opcode.ATTACHMENT_INDEX, [*self._attachments]),
            (Opcode.METADATA_INDEX, [*self._metadata]),
        ]

    def close(self) -> None:
        """Close the file as it is; without `finish` it stays incomplete."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def _message_index(
    channels: np.ndarray, entries: np.ndarray, start: int
) -> tuple[dict[int, int], dict[int, int], bytes]:
    """Messages by channel, where in the file each channel's index begins, and the indexes."""
    content = entries[np.argsort(channels, kind="stable")].tobytes()
    counts = {n: count for n, count in enumerate(np.bincount(channels).tolist()) if count}
    offsets, pieces, at, begin = {}, [], start, 0
    for number, count in counts.items():
        size = count * INDEX_ENTRY.itemsize
        head = INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + size, number, size)
        offsets[number] = at
        pieces += [head, content[begin : begin + size]]
        at += len(head) + size
        begin += size
    return counts, offsets, b"".join(pieces)


def _chunk_index(
    chunk: Chunk, at: int, length: int, index: tuple[dict[int, int], int]
) -> ChunkIndex:
    return ChunkIndex(
        chunk_length=length,
        chunk_start_offset=at,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        message_end_time=chunk.message_end_time,
        message_index_length=index[1],
        message_index_offsets=index[0],
        message_start_time=chunk.message_start_time,
        uncompressed_size=chunk.uncompressed_size,
    )
