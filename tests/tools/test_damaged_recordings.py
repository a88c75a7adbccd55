"""What the commands say of recordings that were made to hurt, and what they keep of them."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, Header, Metadata
from typer.testing import CliRunner, Result

from flight_sw.can.address import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG
from sim_harness.telemetry.container import MAGIC, record_bytes
from sim_harness.telemetry.reader import open_recording
from sim_harness.telemetry.records import BUS_LOG
from sim_harness.telemetry.writer import CHECKSUM, MANIFEST, RecordingWriter, checksum_of
from tests.sim_harness.recordings import DBC
from tests.sim_harness.recordings import MANIFEST as TOLD
from tools.cli import app

CASES = Path(__file__).parents[1] / "fuzz" / "found" / "recordings"


def run(*arguments: str | Path) -> Result:
    """One command."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_a_record_of_nine_exabytes_is_told_and_what_is_before_it_is_kept() -> None:
    told = run("info", CASES / "mcap-segv-min.mcap")
    assert "load_crc32" in told.stdout and "0xf36b0eef" in told.stdout
    assert str(told.exception).endswith(
        ".mcap: damaged at byte 613, no whole record begins at byte 0 of the chunk there; "
        "read is what is whole"
    )


def test_a_chunk_that_unpacks_to_more_than_allowed_is_not_unpacked() -> None:
    told = run("info", CASES / "bomb-rightcrc-300MB.mcap")
    assert "hyperion-1" in told.stdout
    assert "the chunk there unpacks to 314,572,797 bytes, allowed are 16,777,216" in str(
        told.exception
    )


def test_a_message_called_by_a_path_is_not_exported_and_the_rest_is(tmp_path: Path) -> None:
    out = tmp_path / "a" / "b" / "c"
    told = run("export", CASES / "export-traversal-rel.mcap", "--out", out)
    assert "a name is '../../evil_rel', allowed are letters, digits and _" in str(told.exception)
    assert sorted(path.name for path in out.iterdir()) == [
        "frames.parquet",
        "log.parquet",
        "truth.parquet",
    ]
    assert [path for path in tmp_path.rglob("*") if path.is_file() and path.parent != out] == []


def test_frames_are_exported_without_what_was_not_sent(tmp_path: Path) -> None:
    rows = np.zeros(6, BUS_LOG)
    word = 0x8877665544332211
    sent = [
        (0x123, 1), (0x7FF, 0), (0x123 | REMOTE_FLAG, 8), (0x1ABCDEF0 | EXTENDED_FLAG, 3),
        (0x1ABCDEF0 | EXTENDED_FLAG | REMOTE_FLAG, 2), (0x40 | ERROR_FLAG, 8),
    ]  # fmt: skip
    for row, (can_id, dlc) in zip(rows, sent, strict=True):
        row["frame"]["can_id"], row["frame"]["dlc"], row["frame"]["data"] = can_id, dlc, word
    path = tmp_path / "flight.mcap"
    writer = RecordingWriter(path, TOLD, DBC, 10.0)
    writer.write([rows], [], [])
    writer.finish({"outcome": "end condition"})
    assert run("export", path, "--out", tmp_path / "out").exit_code == 0
    table = pyarrow.parquet.read_table(tmp_path / "out" / "frames.parquet").to_pydict()
    assert table["can_id"] == [0x123, 0x7FF, 0x123, 0x1ABCDEF0, 0x1ABCDEF0, 0x40]
    assert table["dlc"] == [1, 0, 8, 3, 2, 8]
    assert table["data_hex"] == ["11", "", "", "112233", "", "1122334455667788"]
    assert table["is_extended"] == [False, False, False, True, True, False]
    assert table["is_remote"] == [False, False, True, False, True, False]
    assert table["is_error"] == [False] * 5 + [True]


def made(manifest: dict[str, str], *records: object) -> bytes:
    """An unfinished recording with a manifest whose checksum is right."""
    told = {"format": "2", **manifest}
    head = Metadata(MANIFEST, {**told, CHECKSUM: checksum_of(told)})
    return MAGIC + record_bytes(Header("aeroshell", "test"), head, *records)  # type: ignore[arg-type]


def chunk(content: bytes, size: int | None = None, compression: str = "zstd") -> Chunk:
    data = zstandard.compress(content) if compression == "zstd" else content
    told = len(content) if size is None else size
    return Chunk(compression, data, 0, 0, zlib.crc32(content), told)


HOSTILE_LENGTHS = (2**31, 2**63 - 9, 2**63, 2**64 - 9, 2**64 - 1)


@pytest.mark.parametrize("length", HOSTILE_LENGTHS)
@pytest.mark.parametrize("opcode", [Opcode.MESSAGE, Opcode.CHANNEL, 0x85])
def test_no_length_is_believed_in_a_chunk(tmp_path: Path, opcode: int, length: int) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(made(TOLD, chunk(struct.pack("<BQ", opcode, length) + bytes(60))))
    assert "no whole record begins at byte 0" in open_recording(path).damage


@pytest.mark.parametrize("size", [0, 5, *HOSTILE_LENGTHS])
@pytest.mark.parametrize("compression", ["zstd", ""])
def test_no_size_of_a_chunk_is_believed(tmp_path: Path, size: int, compression: str) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(made(TOLD, chunk(bytes(900), size, compression)))
    assert "the chunk there" in open_recording(path).damage


def test_what_a_manifest_says_moves_no_cursor(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    evil = "\x1b[2J\x1b[H" + "x" * 5000
    files = Attachment(0, 0, "../" * 9 + evil, "text/plain", b"")
    path.write_bytes(made({**TOLD, evil: evil, "period_s": "nan", "load_crc32": "zz"}, files))
    told = run("info", path).stdout
    assert all(line.isprintable() for line in told.splitlines())
    assert "\\x1b[2J" in told and len(told) < 10_000


def test_a_pipe_in_place_of_a_journal_is_not_waited_for(tmp_path: Path) -> None:
    import os

    path = tmp_path / "a.mcap"
    path.write_bytes(made(TOLD))
    os.mkfifo(tmp_path / "a.mcap.journal")
    assert open_recording(path).damage.endswith("a.mcap.journal: is neither a file nor a folder")
