"""Takes an MCAP file apart: records, chunks and their messages, each checksum verified.

The records are parsed by the `mcap` library; finding them is done here, because a file whose
writer was killed ends anywhere, and because the library parses one message at a time. Nothing that
a file says of itself is believed: no length beyond the bytes there are, no chunk larger than
CHUNK_BYTES_MAX, no more in all than a multiple of the file.
"""

import contextlib
import struct
import zlib
from collections.abc import Iterator, Mapping
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
from flight_sw.runtime.echo import echoed
from sim_harness.telemetry import scan
from sim_harness.telemetry.container import COMPRESSION, MAGIC
from sim_harness.telemetry.schema import Schema
from sim_harness.telemetry.wire import HEAD_BYTES, SEQUENCE, UNCOUNTED_BYTES

I8 = npt.NDArray[np.int64]
U1 = npt.NDArray[np.uint8]
RECORD = struct.Struct("<BQ")  # opcode, length of what follows
DATA_END, FOOTER = struct.Struct("<BQI"), struct.Struct("<BQQQI")
CRC_BYTES = 4
OPCODE_MAX = 0x0F  # the last one defined
CHUNK_BYTES_MAX = 1 << 24  # unpacked
UNPACKED_MIN, UNPACKED_PER_BYTE = 1 << 25, 64  # of all chunks together, and by the file's size
METADATA_BYTES_MAX = 1 << 20
NAMED_MAX = 256  # attachments, and sets of metadata
DAMAGES_MAX = 16  # places after which the rest is not looked at any more
COMPRESSION_AT = 28  # in a chunk, behind two times, a size and a checksum
COMPRESSION_MARK = len(COMPRESSION).to_bytes(4, "little") + COMPRESSION.encode()


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
        for blob, starts, _ in self.pieces:  # each is at least a head long
            places = starts[:, None] + np.arange(SEQUENCE, SEQUENCE + 4)
            found.append(np.frombuffer(blob, np.uint8)[places].view(np.uint32)[:, 0])
        return np.concatenate(found)


@dataclass(slots=True)
class Contents:
    """All that a file holds of the topics that were asked for, as far as it is whole."""

    name: str
    wanted: tuple[str, ...] = ()
    usual: tuple[int, ...] = ()
    """Numbers of the wanted topics' channels where the file has lost what says so."""
    profile: str = ""
    is_complete: bool = False
    damages: list[str] = field(default_factory=list)
    """Where it is not as it was written, the end of a sentence each."""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    topics: dict[str, Topic] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: npt.NDArray[np.uint8] = field(
        default_factory=lambda: np.zeros(scan.CHANNELS, np.uint8)
    )
    """What each channel is to the scan: unknown, unwanted, or a topic of those wanted."""
    unpacked_max: int = 0
    """Bytes that the chunks to come may still unpack to."""


UNREADABLE = (
    struct.error,
    UnicodeDecodeError,
    zstandard.ZstdError,
    RuntimeError,
    EOFError,
    MemoryError,
)


class _TornError(Exception):
    """The file ends, or stops to make sense, inside a record."""


class _Body(ReadDataStream):
    """A record's body; no length is believed that goes beyond it."""

    def __init__(self, body: memoryview) -> None:
        super().__init__(BytesIO())
        self._body = body

    def read(self, length: int) -> bytes:
        """So many bytes."""
        end = self._count + length
        if end > len(self._body):
            raise EndOfFile
        found = bytes(self._body[self._count : end])
        self._count = end
        return found


def read_contents(name: str, content: bytes, wanted: Mapping[str, int]) -> Contents:
    """Everything in the file, as far as it is whole; of the messages those of `wanted` topics.

    With each topic stands the number that its channel usually has.
    """
    if content[: len(MAGIC)] != MAGIC:
        raise RecordingError(f"{name}: not an MCAP file, it does not begin with MCAP's magic bytes")
    contents = Contents(name, tuple(wanted), tuple(wanted.values()))
    contents.unpacked_max = UNPACKED_MIN + UNPACKED_PER_BYTE * len(content)
    contents.is_complete = content[-len(MAGIC) :] == MAGIC and len(content) > len(MAGIC)
    view, octets, at = memoryview(content), scan.octets_of(content), len(MAGIC)
    while at < len(content) and len(contents.damages) < DAMAGES_MAX:
        at = int(scan.next_record(octets, at, scan.IS_PASSED_OVER))
        if at == len(content):
            break
        opcode = end = 0
        try:
            opcode, end = _record_at(content, at)
            _take(contents, opcode, view[at + UNCOUNTED_BYTES : end], at)
        except _TornError as error:
            following = _following(content, at)
            # A torn end is what a killed writer leaves: a record that is not whole, and the last.
            if not end and following < 0 and not contents.is_complete:
                return contents
            contents.damages.append(f" at byte {at}, {error}")
            if opcode == Opcode.CHUNK or not end:
                _make_up_for_definitions(contents, content)
            at = following if following >= 0 else len(content)
            continue
        if opcode == Opcode.DATA_END:
            _check_whole(contents, content, at)
            return contents
        at = end
    if contents.is_complete and not contents.damages:
        contents.damages.append(", the record that ends its data is missing")
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


def _following(content: bytes, at: int) -> int:
    """Where to go on behind a bad record: at its end, or at the next chunk; -1 for nowhere.

    A chunk is looked for by what stands in its head: the bad record's length may be wrong.
    """
    with contextlib.suppress(_TornError):
        _, end = _record_at(content, at)
        _record_at(content, end)
        return end
    own = at + UNCOUNTED_BYTES + COMPRESSION_AT
    place = content.find(COMPRESSION_MARK, at)
    while place >= 0:
        start = place - COMPRESSION_AT - UNCOUNTED_BYTES
        if place != own and start > at and content[start] == Opcode.CHUNK:
            return start
        place = content.find(COMPRESSION_MARK, place + 1)
    return -1


def _take(contents: Contents, opcode: int, body: memoryview, at: int) -> None:
    """File away one record of the data section."""
    stream = _Body(body)
    try:
        if opcode == Opcode.HEADER:
            contents.profile = contents.profile or Header.read(stream).profile
        elif opcode == Opcode.METADATA:
            _take_metadata(contents, body)
        elif opcode == Opcode.ATTACHMENT:
            attachment = Attachment.read(stream)
            name = echoed(attachment.name)
            _check(body[-CRC_BYTES:], body[:-CRC_BYTES], f"attachment {name}")
            _check_new(attachment.name, contents.attachments, "attachment")
            contents.attachments[attachment.name] = attachment.data
        elif opcode == Opcode.CHUNK:
            _take_chunk(contents, Chunk.read(stream), at)
        elif opcode == Opcode.MESSAGE:
            raise RecordingError(f"{contents.name}: has messages outside of chunks, none may be")
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            _take_definition(contents, opcode, body)
    except UNREADABLE as error:
        raise _TornError(f"the record there cannot be read ({echoed(error)})") from error
    except EndOfFile as error:
        raise _TornError("the record there is shorter than it says") from error


def _take_metadata(contents: Contents, body: memoryview) -> None:
    if len(body) > METADATA_BYTES_MAX:
        raise _TornError(f"metadata of {len(body):,} bytes, allowed are {METADATA_BYTES_MAX:,}")
    metadata = Metadata.read(_Body(body))
    _check_new(metadata.name, contents.metadata, "set of metadata")
    contents.metadata[metadata.name] = metadata.metadata


def _check_new(name: str, known: Mapping[str, object], what: str) -> None:
    if name in known:
        raise _TornError(f"a second {what} {echoed(name)} is there")
    if len(known) >= NAMED_MAX:
        raise _TornError(f"a further {what} is there, allowed are {NAMED_MAX}")


def _check(stored: bytes | memoryview, data: bytes | memoryview, what: str) -> None:
    want, found = int.from_bytes(stored, "little"), zlib.crc32(data)
    if want != found:
        raise _TornError(f"{what} has CRC-32 {found:#010x}, its record says {want:#010x}")


def _take_chunk(contents: Contents, chunk: Chunk, at: int) -> None:
    blob = _unpacked(chunk, min(CHUNK_BYTES_MAX, contents.unpacked_max))
    _check(chunk.uncompressed_crc.to_bytes(CRC_BYTES, "little"), blob, "chunk")
    contents.unpacked_max -= len(blob)
    octets, view, bad = scan.octets_of(blob), memoryview(blob), list[str]()

    def take(place: int, end: int) -> None:
        try:
            if blob[place] in (Opcode.SCHEMA, Opcode.CHANNEL):
                _take_definition(contents, blob[place], view[place + UNCOUNTED_BYTES : end])
            elif blob[place] <= OPCODE_MAX and not bad:
                bad.append(f"a record of opcode {blob[place]} stands inside the chunk there")
        except (*UNREADABLE, EndOfFile, _TornError) as error:
            bad.append(f"in its chunk a definition cannot be read ({echoed(error)})")

    until = scan.definitions(octets, take)
    starts, sizes, numbers, strange = scan.messages(octets, until, contents.channels)
    for number in np.unique(numbers).tolist():
        mine = numbers == number
        topic = contents.topics[contents.wanted[number - scan.UNWANTED - 1]]
        topic.pieces.append(Piece(blob, starts[mine], sizes[mine]))
    if until < len(blob):
        bad.append(f"no whole record begins at byte {until:,} of the chunk there")
    if strange:
        bad.append(f"{strange:,} messages in the chunk there are of no channel")
    contents.damages += [f" at byte {at}, {why}" for why in bad[:1]]


def _unpacked(chunk: Chunk, most: int) -> bytes:
    """What a chunk holds: ours are zstd, other writers have more to choose from."""
    size = chunk.uncompressed_size
    if size > most:
        raise _TornError(f"the chunk there unpacks to {size:,} bytes, allowed are {most:,}")
    if chunk.compression == COMPRESSION:
        unpacker = zstandard.ZstdDecompressor(max_window_size=CHUNK_BYTES_MAX)
        blob = unpacker.stream_reader(chunk.data).read(size + 1)
    elif chunk.compression == "lz4":
        blob = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size + 1)
    elif chunk.compression == "":
        blob = chunk.data
    else:
        name = echoed(chunk.compression)
        raise _TornError(f"compression '{name}' is not known, known are zstd and lz4")
    if len(blob) != size:
        raise _TornError(f"the chunk there does not unpack to the {size:,} bytes that it says")
    return bytes(blob)


def _take_definition(contents: Contents, opcode: int, body: memoryview) -> None:
    """A schema or a channel; the first of a number holds: others repeat theirs in each chunk."""
    number = int.from_bytes(body[:2], "little")
    if opcode == Opcode.SCHEMA:
        if number not in contents.schemas:
            schema = SchemaRecord.read(_Body(body))
            contents.schemas[number] = Schema(schema.name, schema.data)
    elif contents.channels[number] == scan.UNKNOWN:
        channel = Channel.read(_Body(body))
        contents.channels[number] = scan.UNWANTED
        if channel.topic in contents.wanted:
            _want(contents, channel)


def _make_up_for_definitions(contents: Contents, content: bytes) -> None:
    """Find in the summary what a lost chunk may have defined; else channels are as usual."""
    footer = len(content) - len(MAGIC) - FOOTER.size
    if contents.is_complete and footer > 0:
        opcode, _, at, _, want = FOOTER.unpack_from(content, footer)
        is_good = opcode == Opcode.FOOTER and 0 < at < footer
        if is_good and want == zlib.crc32(content[at : -len(MAGIC) - CRC_BYTES]):
            with contextlib.suppress(_TornError, EndOfFile, *UNREADABLE):
                while at < footer:
                    opcode, end = _record_at(content, at)
                    if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                        body = memoryview(content)[at + UNCOUNTED_BYTES : end]
                        _take_definition(contents, opcode, body)
                    at = end
    for number, (topic, usual) in enumerate(zip(contents.wanted, contents.usual, strict=True)):
        if topic not in contents.topics and contents.channels[usual] == scan.UNKNOWN:
            contents.topics[topic] = Topic(None, [])
            contents.channels[usual] = scan.UNWANTED + 1 + number


def _want(contents: Contents, channel: Channel) -> None:
    schema = contents.schemas.get(channel.schema_id)
    if schema is None and channel.schema_id:
        raise _TornError(f"the channel of {channel.topic} has a schema that is not there")
    topic = contents.topics.setdefault(channel.topic, Topic(schema, []))
    if topic.schema is not None and topic.schema != schema:
        raise _TornError(f"{channel.topic} has channels of two schemas")
    number = scan.UNWANTED + 1 + contents.wanted.index(channel.topic)
    contents.channels[channel.id] = number


def _check_whole(contents: Contents, content: bytes, at: int) -> None:
    """Check the sums over everything before the end of the data, and over the summary."""
    footer = len(content) - len(MAGIC) - FOOTER.size
    if not contents.is_complete:
        return
    if footer < at + DATA_END.size:
        contents.damages.append(", its footer does not follow its data")
        return
    _, length, want = DATA_END.unpack_from(content, at)
    if length != CRC_BYTES or (want and want != zlib.crc32(content[:at])):
        contents.damages.append(", the checksum of its data section is wrong")
    opcode, _, start, _, want = FOOTER.unpack_from(content, footer)
    if opcode != Opcode.FOOTER or start != at + DATA_END.size:
        contents.damages.append(", its footer does not follow its data")
    elif want and want != zlib.crc32(content[start : -len(MAGIC) - CRC_BYTES]):
        contents.damages.append(", the checksum of its summary is wrong")
