"""Damaged recordings, journals and DBC attachments, for `tests.fuzz.children`.

Most cases are damaged inside, with the checksums made right again: it is the inner checks that have
to hold then.
"""

import contextlib
import functools
import io
import json
import random
import re
import struct
import tempfile
import zlib
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, McapRecord, Metadata

from flight_sw import icd
from flight_sw.errors import AeroshellError
from sim_harness.telemetry import journal
from sim_harness.telemetry.container import MAGIC, record_bytes
from sim_harness.telemetry.decode import Decoder, messages_of
from sim_harness.telemetry.journal import Journal, journal_path
from sim_harness.telemetry.reader import open_recording
from sim_harness.telemetry.records import BUS_LOG, LogLevel, LogLine
from sim_harness.telemetry.writer import CHECKSUM, MANIFEST, RecordingWriter, checksum_of
from tests.fuzz.children import Kind
from tests.fuzz.mutate import COUNTS, NAMES, NUMBERS, mutated
from tools.commands.info import _text as text_of_facts
from tools.commands.replay import DIFFERS, replay
from tools.commands.timing import _text as text_of_timing
from tools.flight_facts import facts
from tools.flight_tables import export
from tools.flight_timing import read_timing

FLIGHT = Path(__file__).parents[1] / "replay" / "flights" / "real-time-with-ticks.mcap"
OTHER_LOAD = Path(__file__).parents[2] / "gains" / "hyperion-1" / "sag.load"
FRAMES = 400
RECORD = struct.Struct("<BQ")
KEPT_MESSAGES = ("FSW_STATUS", "FSW_COMMAND", "NAV_TIME", "FSW_BOOT", "RX_HEALTH_C")
WANTED = (Opcode.METADATA, Opcode.ATTACHMENT, Opcode.CHUNK)


@functools.cache
def small_flight() -> bytes:
    """The beginning of a recorded flight, in three chunks."""
    whole = open_recording(FLIGHT)
    manifest = {k: v for k, v in whole.manifest.items() if k not in ("format", CHECKSUM)}
    del manifest["telemetry_rate_hz"]
    attached = {name: ("text/plain", data) for name, data in whole.attachments.items()}
    with tempfile.TemporaryDirectory() as folder:
        writer = RecordingWriter(Path(folder, "a.mcap"), manifest, attached, 10.0)
        for rows in np.split(whole.bus[:FRAMES], [130, 260]):
            until_s = rows["t_s"][-1]
            line = LogLine(float(until_s), LogLevel.WARNING, "a line of the log")
            writer.write([rows], [whole.truth[:3]], [line])
        writer.finish(whole.outcome)
        return Path(folder, "a.mcap").read_bytes()


def records_of(data: bytes) -> list[tuple[int, bytes]]:
    """Opcodes and bodies of the records of a whole file."""
    found, at = [], len(MAGIC)
    while at < len(data) - len(MAGIC):
        opcode, length = RECORD.unpack_from(data, at)
        at += RECORD.size + length
        found.append((opcode, data[at - length : at]))
    return found


def file_of(records: Sequence[tuple[int, bytes]], is_complete: bool) -> bytes:
    """A file of these records; its end says that no checksum of the whole was taken."""
    kept = [(o, body) for o, body in records if is_complete or o < Opcode.DATA_END]
    out = bytearray(MAGIC)
    end = len(MAGIC) + sum(RECORD.size + len(body) for _, body in kept[: _end_at(kept)])
    unchecked = {Opcode.DATA_END: bytes(4), Opcode.FOOTER: struct.pack("<QQI", end, 0, 0)}
    for opcode, body in kept:
        told = unchecked.get(opcode, body)
        out += RECORD.pack(opcode, len(told)) + told
    return bytes(out) + (MAGIC if is_complete else b"")


def _end_at(records: Sequence[tuple[int, bytes]]) -> int:
    return 1 + max((i for i, (o, _) in enumerate(records) if o == Opcode.DATA_END), default=0)


def _body(record: McapRecord) -> bytes:
    return record_bytes(record)[RECORD.size :]


def _in_metadata(body: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    found = Metadata.read(ReadDataStream(BytesIO(body)))
    key = rng.choice([*found.metadata])
    value = rng.choice(NUMBERS + NAMES) if rng.random() < 0.5 else found.metadata[key].encode()
    text = (value if rng.random() < 0.5 else mutated(value, rng)).decode(errors="replace")
    found.metadata[key if rng.random() < 0.8 else text] = text
    if found.name == MANIFEST and rng.random() < 0.9:
        found.metadata[CHECKSUM] = checksum_of(found.metadata)
    return _body(found)


def _in_attachment(body: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    found = Attachment.read(ReadDataStream(BytesIO(body)))
    if rng.random() < 0.3:
        found.name = rng.choice(NAMES).decode(errors="replace") + rng.choice((".dbc", ".load", ""))
    else:
        found.data = mutated(found.data, rng)
    return _body(found)


def _in_chunk(body: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    found = Chunk.read(ReadDataStream(BytesIO(body)))
    content = zstandard.decompress(found.data, max_output_size=found.uncompressed_size)
    content = _in_content(content, rng) if rng.random() < 0.8 else mutated(content, rng)
    form = rng.choice(("zstd", "zstd", "lz4", "", "zstd\0"))
    packed = {"lz4": lz4.frame.compress, "": bytes}.get(form, zstandard.compress)(content)
    found.compression = form
    found.data = packed if rng.random() < 0.9 else mutated(packed, rng)
    found.uncompressed_crc = zlib.crc32(content)
    found.uncompressed_size = len(content) if rng.random() < 0.9 else rng.choice(COUNTS)
    return _body(found)


def _in_content(content: bytes, rng: random.Random) -> bytes:
    """One message or definition of a chunk damaged, mostly with its length made right."""
    places = [0]
    while places[-1] < len(content):
        places.append(places[-1] + RECORD.size + RECORD.unpack_from(content, places[-1])[1])
    i = rng.randrange(len(places) - 1)
    begin, end = places[i], places[i + 1]
    opcode, body = content[begin], mutated(content[begin + RECORD.size : end], rng)
    length = len(body) if rng.random() < 0.7 else rng.choice(COUNTS)
    return content[:begin] + RECORD.pack(opcode, length) + body + content[end:]


INSIDE: dict[int, Callable[[bytes, random.Random, Sequence[bytes]], bytes]] = {
    Opcode.METADATA: _in_metadata,
    Opcode.ATTACHMENT: _in_attachment,
    Opcode.CHUNK: _in_chunk,
}


def _inside(opcode: int, body: bytes, rng: random.Random) -> bytes:
    try:
        return INSIDE[opcode](body, rng, ())
    except Exception:  # it has been damaged before: whatever that leads these parsers to
        return mutated(body, rng)


def damaged(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    """A damaged recording, its checksums mostly right."""
    if rng.random() < 0.2:
        return mutated(data, rng, others)
    records = records_of(data)
    for _ in range(rng.randint(1, 2)):
        inside = [i for i, (opcode, _) in enumerate(records) if opcode in INSIDE]
        i = rng.choice(inside) if inside and rng.random() < 0.8 else rng.randrange(len(records))
        opcode, body = records[i]
        chance = rng.random()
        if chance < 0.1:
            records[i:i] = [records[i]] * rng.choice((1, 1, 50))
        elif chance < 0.15:
            del records[i]
        elif chance < 0.2:
            records[i] = rng.randrange(20), body
        elif opcode in INSIDE and chance < 0.9:
            records[i] = opcode, _inside(opcode, body, rng)
        else:
            records[i] = opcode, mutated(body, rng)
    return file_of(records, is_complete=rng.random() < 0.8)


def _check_shown(text: str) -> None:
    for line in text.splitlines():
        assert line.isprintable(), f"shown on a terminal: {line!r:.300}"


def _put(data: bytes, folder: Path) -> Path:
    path = folder / "flight.mcap"
    path.write_bytes(data)
    return path


def read_recording(data: bytes, folder: Path) -> None:
    """What `info`, `timing` and `export` make of a recording."""
    path = _put(data, folder)
    refused = None
    recording = open_recording(path)
    _check_shown(text_of_facts(facts(recording)))
    for use in (
        lambda: _check_shown(text_of_timing(read_timing(path))),
        lambda: (
            export(recording, "csv" if len(data) % 2 else "parquet", folder / "out", force=True)
            if len(data) % 4 == 0
            else None
        ),
        recording.check_whole,
    ):
        try:
            use()
        except AeroshellError as error:
            refused = error
    if refused is not None:
        raise refused


def _not_json(name: str) -> None:
    raise AssertionError(f"told as a number in JSON: {name}")


def read_replay(data: bytes, folder: Path) -> None:
    """What `replay` makes of it, alone or against another load, as text and as JSON."""
    path, shown = _put(data, folder), io.StringIO()
    other = OTHER_LOAD if len(data) % 3 == 0 else None
    out = folder / ("out.csv" if len(data) % 2 else "out.parquet") if other else None
    as_json = len(data) % 4 < 2
    try:
        with contextlib.redirect_stdout(shown):
            replay(path, other, out, as_json=as_json)
    except SystemExit as ended:  # commands differ, and the text says where
        assert ended.code == DIFFERS
    finally:
        _check_shown(shown.getvalue())
        if as_json and shown.getvalue():
            json.loads(shown.getvalue(), parse_constant=_not_json)


@functools.cache
def small_journals() -> tuple[bytes, ...]:
    """The journal of the small flight."""
    whole = open_recording(FLIGHT)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.mcap")
        kept = Journal(path, whole.manifest["recording"], whole.truth.dtype)
        for rows in np.split(whole.bus[:FRAMES], 5):
            kept.append(journal.BUS_ROWS, np.ascontiguousarray(rows))
            kept.append(journal.TRUTH_ROWS, whole.truth[:2])
        kept.close()
        return (journal_path(path).read_bytes(),)


def damaged_journal(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    """A damaged journal, its checksums mostly right."""
    if rng.random() < 0.3:
        return mutated(data, rng, others)
    size = int.from_bytes(data[8:12], "little")
    head, rest = data[16 : 16 + size], data[16 + size :]
    if rng.random() < 0.6:
        head = mutated(head, rng)
    blocks = []
    while rest:
        block = np.frombuffer(rest, journal.BLOCK, 1)[0].copy()
        end = journal.BLOCK_BYTES + int(block["bytes"])
        rows, rest = rest[journal.BLOCK_BYTES : end], rest[end:]
        if rng.random() < 0.2:
            rows = mutated(rows, rng)
            rows = rows[: len(rows) // 24 * 24]
            block["bytes"] = len(rows) if rng.random() < 0.8 else rng.choice(COUNTS)
            block["kind"] = rng.choice((1, 1, 1, 2, 3))
            block["sum"] = journal.words_sum(np.frombuffer(rows, np.uint64))
        blocks.append(block.tobytes() + rows)
    lengths = struct.pack("<II", len(head), zlib.crc32(head))
    return data[:8] + lengths + head + b"".join(blocks)


def read_with_journal(data: bytes, folder: Path) -> None:
    """What `info` makes of a cut recording and this journal."""
    whole = small_flight()
    path = _put(whole[: whole.rindex(b"aeroshell.outcome") - 400], folder)
    journal_path(path).write_bytes(data)
    recording = open_recording(path)
    _check_shown(text_of_facts(facts(recording)))
    recording.check_whole()


@functools.cache
def small_dbcs() -> tuple[bytes, ...]:
    """Our DBC with a few of its messages."""
    text = icd.DBC_PATH.read_text()
    dropped = [m.can_id for m in icd.LAYOUT if m.name not in KEPT_MESSAGES]
    for can_id in dropped:
        text = re.sub(rf"^BO_ {can_id} .*?\n\n", "", text, flags=re.M | re.S)
        text = re.sub(rf"^(CM_|BA_|VAL_)( \S+)?( [BS][OG]_)? {can_id} .*?;\n", "", text, flags=re.M)
    return (text.encode(),)


def read_dbc(data: bytes, folder: Path) -> None:
    """What the reader makes of a DBC, and of frames through it."""
    decoder = Decoder(messages_of(data))
    rows = np.zeros(64, BUS_LOG)
    rows["frame"]["can_id"], rows["frame"]["dlc"] = np.arange(64) * 3, 8
    rows["frame"]["data"] = np.arange(64, dtype=np.uint64) * np.uint64(0x123456789ABCDEF)
    decoder.slots(rows)
    for slot in range(len(decoder.messages)):
        decoder.columns(slot, rows["frame"]["data"])


def _flights() -> Sequence[bytes]:
    return (small_flight(),)


RECORDINGS = Kind(_flights, read_recording, damaged)
REPLAYS = Kind(_flights, read_replay, damaged)
JOURNALS = Kind(small_journals, read_with_journal, damaged_journal)
DBCS = Kind(small_dbcs, read_dbc)
