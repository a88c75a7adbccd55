"""Takes an MCAP file apart: records, chunks and their messages, each checksum verified.

The records are parsed by the `mcap` library; finding them is done here, because a file whose
writer was killed ends anywhere, and because the library parses one message at a time.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import NamedTuple

import lz4.frame
import numpy as np
import numpy.typing as npt
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Metadata
from mcap.records import Schema as SchemaRecord

from flight_sw.errors import RecordingError
from sim_harness.jit import kernel
from sim_harness.telemetry.container import COMPRESSION, MAGIC
from sim_harness.telemetry.schema import Schema
from sim_harness.telemetry.wire import HEAD_BYTES, OPCODE_MESSAGE, SEQUENCE, UNCOUNTED_BYTES

I8 = npt.NDArray[np.int64]
U1 = npt.NDArray[np.uint8]
RECORD = struct.Struct("<BQ")  # opcode, length of what follows
DATA_END, FOOTER = struct.Struct("<BQI"), struct.Struct("<BQQQI")
CRC_BYTES = 4
OPCODE_MAX = 0x0F  # the last one defined
COMPRESSION_AT = 28  # in a chunk, behind two times, a size and a checksum
COMPRESSION_MARK = len(COMPRESSION).to_bytes(4, "little") + COMPRESSION.encode()


@kernel
def _word(octets: U1, at: int, n: int) -> np.int64:
    """A little-endian number of `n` bytes."""
    value = np.int64(0)
    for i in range(n - 1, -1, -1):
        value = value * 256 + np.int64(octets[at + i])
    return value


@kernel
def _scan(octets: U1, opcodes: I8, starts: I8, sizes: I8, channels: I8) -> int:
    """Write what records a chunk is made of, and the channels of messages; returns how many."""
    n = 0
    at = 0
    while at + UNCOUNTED_BYTES <= len(octets) and n < len(starts):
        size = UNCOUNTED_BYTES + _word(octets, at + 1, 8)
        if size > len(octets) - at or size < UNCOUNTED_BYTES:
            break
        opcodes[n] = octets[at]
        starts[n] = at
        sizes[n] = size
        channels[n] = -1
        if opcodes[n] == OPCODE_MESSAGE and size >= HEAD_BYTES:
            channels[n] = _word(octets, at + UNCOUNTED_BYTES, 2)
        n += 1
        at += size
    return n


class Piece(NamedTuple):
    """Messages of one topic in one chunk: where their records begin, and their lengths."""

    blob: bytes
    starts: I8
    sizes: I8


@dataclass(frozen=True, slots=True)
class Topic:
    """All messages of a topic, in the order of the file."""

    schema: Schema | None
    pieces: list[Piece]

    def payloads(self) -> Iterator[bytes]:
        """The messages themselves."""
        for blob, starts, sizes in self.pieces:
            for start, size in zip(starts.tolist(), sizes.tolist(), strict=True):
                yield blob[start + HEAD_BYTES : start + size]

    def sequences(self) -> npt.NDArray[np.uint32]:
        """The sequence numbers."""
        found = [np.zeros(0, np.uint32)]
        for blob, starts, _ in self.pieces:
            places = starts[:, None] + np.arange(SEQUENCE, SEQUENCE + 4)
            found.append(np.frombuffer(blob, np.uint8)[places].view(np.uint32)[:, 0])
        return np.concatenate(found)


@dataclass(slots=True)
class Contents:
    """All that a file holds."""

    name: str
    profile: str = ""
    is_complete: bool = False
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    topics: dict[str, Topic] = field(default_factory=dict)
    channels: dict[int, Topic] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)


UNREADABLE = (struct.error, UnicodeDecodeError, zstandard.ZstdError, KeyError, RuntimeError)


class _TornError(Exception):
    """The file ends, or stops to make sense, inside a record."""


def read_contents(name: str, content: bytes) -> Contents:
    """Everything in the file, as far as it is whole."""
    if content[: len(MAGIC)] != MAGIC:
        raise RecordingError(f"{name}: not an MCAP file, it does not begin with MCAP's magic bytes")
    contents = Contents(name)
    contents.is_complete = content[-len(MAGIC) :] == MAGIC and len(content) > len(MAGIC)
    at = len(MAGIC)
    while at < len(content):
        try:
            opcode, end = _record_at(content, at)
            _take(contents, opcode, content[at + UNCOUNTED_BYTES : end], at)
        except _TornError as error:
            # A torn end is what a killed writer leaves; anything good behind it means damage.
            if contents.is_complete or _is_followed(content, at):
                raise RecordingError(f"{name}: damaged at byte {at}, {error}") from error
            return contents
        if opcode == Opcode.DATA_END:
            _check_whole(contents, content, at)
            return contents
        at = end
    if contents.is_complete:
        raise RecordingError(f"{name}: damaged, the record that ends its data is missing")
    return contents


def _record_at(content: bytes, at: int) -> tuple[int, int]:
    """Opcode of the record at a place, and where it ends."""
    if at + RECORD.size > len(content):
        raise _TornError("the file ends inside a record")
    opcode, length = RECORD.unpack_from(content, at)
    if not 0 < opcode <= OPCODE_MAX:
        raise _TornError(f"no record of MCAP has the opcode {opcode}")
    if at + RECORD.size + length > len(content):
        raise _TornError("the file ends inside a record")
    return opcode, at + RECORD.size + length


def _is_followed(content: bytes, at: int) -> bool:
    """Whether a chunk begins behind a bad record, which a killed writer cannot leave.

    It is looked for by what stands in a chunk's head: the bad record's length may be wrong.
    """
    own = at + UNCOUNTED_BYTES + COMPRESSION_AT
    place = content.find(COMPRESSION_MARK, at)
    while place >= 0:
        start = place - COMPRESSION_AT - UNCOUNTED_BYTES
        if place != own and start > at and content[start] == Opcode.CHUNK:
            return True
        place = content.find(COMPRESSION_MARK, place + 1)
    return False


def _take(contents: Contents, opcode: int, body: bytes, at: int) -> None:
    """File away one record of the data section."""
    stream = ReadDataStream(BytesIO(body))
    try:
        if opcode == Opcode.HEADER:
            contents.profile = Header.read(stream).profile
        elif opcode == Opcode.METADATA:
            metadata = Metadata.read(stream)
            contents.metadata[metadata.name] = metadata.metadata
        elif opcode == Opcode.ATTACHMENT:
            attachment = Attachment.read(stream)
            _check(body[-CRC_BYTES:], body[:-CRC_BYTES], f"attachment {attachment.name}")
            contents.attachments[attachment.name] = attachment.data
        elif opcode == Opcode.CHUNK:
            _take_chunk(contents, Chunk.read(stream))
        elif opcode == Opcode.MESSAGE:
            raise RecordingError(f"{contents.name}: has messages outside of chunks, none may be")
        else:
            _take_definition(contents, opcode, body)
    except UNREADABLE as error:
        raise _TornError(f"the record there cannot be read ({error})") from error
    except EndOfFile as error:
        raise _TornError("the record there is shorter than it says") from error


def _check(stored: bytes, data: bytes, what: str) -> None:
    want, found = int.from_bytes(stored, "little"), zlib.crc32(data)
    if want != found:
        raise _TornError(f"{what} has CRC-32 {found:#010x}, its record says {want:#010x}")


def _take_chunk(contents: Contents, chunk: Chunk) -> None:
    blob = _decompressed(chunk)
    _check(chunk.uncompressed_crc.to_bytes(CRC_BYTES, "little"), blob, "chunk")
    octets = np.frombuffer(bytearray(blob), np.uint8)
    table = np.empty((4, len(blob) // UNCOUNTED_BYTES + 1), np.int64)
    opcodes, starts, sizes, channels = table[:, : _scan(octets, *table)]
    for i in np.flatnonzero(opcodes != OPCODE_MESSAGE).tolist():
        body = blob[starts[i] + UNCOUNTED_BYTES : starts[i] + sizes[i]]
        _take_definition(contents, int(opcodes[i]), body)
    for number in np.unique(channels[opcodes == OPCODE_MESSAGE]).tolist():
        mine = channels == number
        contents.channels[number].pieces.append(Piece(blob, starts[mine], sizes[mine]))


def _decompressed(chunk: Chunk) -> bytes:
    """What a chunk holds: ours are zstd, other writers have more to choose from."""
    if chunk.compression == COMPRESSION:
        return zstandard.decompress(chunk.data, max_output_size=chunk.uncompressed_size)
    if chunk.compression == "lz4":
        return bytes(lz4.frame.decompress(chunk.data))
    if chunk.compression == "":
        return bytes(chunk.data)
    raise _TornError(f"compression '{chunk.compression}' is not known, known are zstd and lz4")


def load_kernels() -> None:
    """Compile, or read from the cache, what taking a file apart needs."""
    _scan(np.zeros(0, np.uint8), *np.zeros((4, 1), np.int64))


def _take_definition(contents: Contents, opcode: int, body: bytes) -> None:
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.SCHEMA:
        schema = SchemaRecord.read(stream)
        contents.schemas[schema.id] = Schema(schema.name, schema.data)
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(stream)
        if channel.id not in contents.channels:  # others repeat it in each chunk
            topic = Topic(contents.schemas[channel.schema_id], [])
            contents.channels[channel.id] = contents.topics[channel.topic] = topic


def _check_whole(contents: Contents, content: bytes, at: int) -> None:
    """Check the sums over everything before the end of the data, and over the summary."""
    if not contents.is_complete:
        return
    name = contents.name
    _, _, want = DATA_END.unpack_from(content, at)
    if want and want != zlib.crc32(content[:at]):
        raise RecordingError(f"{name}: damaged, the checksum of its data section is wrong")
    footer = len(content) - len(MAGIC) - FOOTER.size
    opcode, _, start, _, want = FOOTER.unpack_from(content, footer)
    if opcode != Opcode.FOOTER or start != at + DATA_END.size:
        raise RecordingError(f"{name}: damaged, its footer does not follow its data")
    if want and want != zlib.crc32(content[start : -len(MAGIC) - CRC_BYTES]):
        raise RecordingError(f"{name}: damaged, the checksum of its summary is wrong")
