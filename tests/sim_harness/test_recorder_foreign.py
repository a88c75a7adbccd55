"""Recordings that others wrote anew, harmed where no checksum of MCAP's looks, or that are none."""

import os
import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from flight_sw.errors import LoadError, RecordingError
from flight_sw.load_image import read_image
from sim_harness.telemetry.reader import open_recording
from tests.sim_harness.recordings import MANIFEST, record

CHUNK_HEAD = struct.Struct("<BQQQQI")  # opcode, length, two times, size, checksum


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight of 30 s."""
    path = tmp_path_factory.mktemp("flight") / "flight.mcap"
    record(path, range(1500))
    return path


def rewritten(
    source: Path, target: Path, change: Callable[..., Any] | None = None, **how: Any
) -> None:
    """The same flight as the mcap library writes it; attachments may be changed."""
    with source.open("rb") as read, target.open("wb") as write:
        reader, writer = make_reader(read), Writer(write, **how)
        writer.start(profile=reader.get_header().profile)
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        for attachment in reader.iter_attachments():
            data = change(attachment.name, attachment.data) if change else attachment.data
            writer.add_attachment(0, 0, attachment.name, attachment.media_type, data)
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "protobuf", number)
            writer.add_message(channels[channel.id], message.log_time, message.data,
                               message.publish_time, message.sequence)  # fmt: skip
        writer.finish()


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunk_bytes", [20_000, 1 << 30])
def test_a_recording_written_anew_by_another_holds_the_same(
    whole: Path, tmp_path: Path, compression: CompressionType, chunk_bytes: int
) -> None:
    path = tmp_path / "a.mcap"
    rewritten(whole, path, compression=compression, chunk_size=chunk_bytes)
    ours, theirs = open_recording(whole), open_recording(path)
    assert theirs.is_complete and theirs.until_s == ours.until_s
    assert np.array_equal(theirs.bus, ours.bus)
    assert np.array_equal(theirs.truth, ours.truth)
    assert theirs.log == ours.log and theirs.manifest == ours.manifest


def test_messages_outside_of_chunks_are_refused(whole: Path, tmp_path: Path) -> None:
    rewritten(whole, tmp_path / "a.mcap", use_chunking=False)
    with pytest.raises(RecordingError, match="has messages outside of chunks"):
        open_recording(tmp_path / "a.mcap")


def chunk_starts(content: bytes) -> list[int]:
    """Where the chunks of a recording begin, one record after the other."""
    at, starts = 8, []
    while content[at] != 0x0F:  # the end of the data
        starts += [at] if content[at] == 0x06 else []
        at += 9 + int.from_bytes(content[at + 1 : at + 9], "little")
    return starts


def test_a_wrong_length_in_a_cut_recording_is_damage_not_its_end(
    whole: Path, tmp_path: Path
) -> None:
    content, path = whole.read_bytes(), tmp_path / "a.mcap"
    starts = chunk_starts(content)
    assert len(starts) > 3
    for start in (starts[0], starts[1], starts[-2]):
        for byte in (1, 3, 4, 8):
            bad = bytearray(content[: starts[-1] + 50])
            bad[start + byte] ^= 1
            path.write_bytes(bad)
            told = open_recording(path).damage
            assert told is not None
            assert re.search(r"damaged at byte \d+, ", told), told
    path.write_bytes(content[: starts[-1] + 50])
    cut = open_recording(path)
    assert not cut.damage
    assert cut.until_s > 28.0


def test_a_wrong_time_in_the_head_of_a_chunk_changes_nothing(whole: Path, tmp_path: Path) -> None:
    content = bytearray(whole.read_bytes())
    start = chunk_starts(bytes(content))[-1]
    path = tmp_path / "a.mcap"
    path.write_bytes(content[: content.rindex(b"\x0f\x04\0\0\0\0\0\0\0")])
    until_s = open_recording(path).until_s
    content[start + CHUNK_HEAD.size - 13] ^= 1  # of its end time
    path.write_bytes(content[: content.rindex(b"\x0f\x04\0\0\0\0\0\0\0")])
    assert open_recording(path).until_s == until_s == pytest.approx(29.98)


def test_a_changed_manifest_is_damage_though_the_recording_is_cut(
    whole: Path, tmp_path: Path
) -> None:
    content = bytearray(whole.read_bytes()[:-1000])
    name, value = next(iter(MANIFEST.items()))
    place = content.index(value.encode(), content.index(name.encode()) + len(name))
    content[place] ^= 1
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="damaged, the checksum of its manifest is wrong"):
        open_recording(path)


def test_a_pipe_is_refused_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "a.mcap"
    os.mkfifo(pipe)
    with pytest.raises(RecordingError, match=r"a\.mcap: is neither a file nor a folder"):
        open_recording(pipe)
    with pytest.raises(LoadError, match=r"a\.mcap: is not a file"):
        read_image(pipe)


def test_an_attachment_that_is_no_dbc_is_told(whole: Path, tmp_path: Path) -> None:
    def harm(name: str, data: bytes) -> bytes:
        return b"no DBC at all" if name.endswith(".dbc") else data

    rewritten(whole, tmp_path / "a.mcap", harm)
    with pytest.raises(RecordingError, match=r"a\.mcap: its DBC cannot be read \("):
        _ = open_recording(tmp_path / "a.mcap").slots


def test_a_topic_of_ours_with_another_schema_is_told(tmp_path: Path, whole: Path) -> None:
    path = tmp_path / "a.mcap"
    manifest = next(iter(read_metadata(whole)))
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="aeroshell")
        writer.add_metadata(*manifest)
        number = writer.register_schema("other.Log", "protobuf", b"")
        writer.add_message(writer.register_channel("/log", "protobuf", number), 0, b"\xff", 0)
        writer.finish()
    with pytest.raises(RecordingError, match=r"/log has schema other\.Log, ours is foxglove\.Log"):
        _ = open_recording(path).log


def read_metadata(path: Path) -> list[tuple[str, dict[str, str]]]:
    """All metadata of a file, as the mcap library reads it."""
    with path.open("rb") as file:
        return [(m.name, m.metadata) for m in make_reader(file).iter_metadata()]
