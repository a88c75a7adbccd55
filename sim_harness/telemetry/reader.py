"""Reads a recording, complete or not, and checks every byte that has a checksum.

A file without a footer was not finished: what its whole chunks hold is read, and `is_complete`
is false. A wrong checksum anywhere else than at the torn end of such a file is damage: what is
whole is kept, and `damage` says so in one sentence.
"""

import contextlib
import functools
import hashlib
import itertools
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from google.protobuf.message import DecodeError

from flight_sw import icd
from flight_sw.errors import IcdError, RecordingError
from flight_sw.runtime.echo import echoed
from sim_harness.telemetry import scan
from sim_harness.telemetry.decode import NO_SLOT, Decoder, decoder_of
from sim_harness.telemetry.events import Events
from sim_harness.telemetry.files import read_whole
from sim_harness.telemetry.journal import Kept, read_journal
from sim_harness.telemetry.records import BUS_LOG, RECORDING_NAME, LogLevel, LogLine
from sim_harness.telemetry.rows import bus_rows, check_times, frame_counts, truth_rows
from sim_harness.telemetry.schema import (
    PACKAGE,
    flat_fields,
    frames_schema,
    log_schema,
    message_class,
)
from sim_harness.telemetry.unpack import Contents, Topic, read_contents
from sim_harness.telemetry.writer import (
    CHECKSUM,
    FORMAT,
    FRAMES_CHANNEL,
    FRAMES_TOPIC,
    LOG_CHANNEL,
    LOG_TOPIC,
    MANIFEST,
    OUTCOME,
    PROFILE,
    TRUTH_CHANNEL,
    TRUTH_NAME,
    TRUTH_TOPIC,
    checksum_of,
)

Rows = npt.NDArray[np.void]
F8 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int64]

NS_PER_S = 1_000_000_000
NUMBER_CHARACTERS_MAX = 40
SCHEMAS = {
    FRAMES_TOPIC: frames_schema().name,
    LOG_TOPIC: log_schema().name,
    TRUTH_TOPIC: f"{PACKAGE}.{TRUTH_NAME}",
}
CHANNELS = {FRAMES_TOPIC: FRAMES_CHANNEL, LOG_TOPIC: LOG_CHANNEL, TRUTH_TOPIC: TRUTH_CHANNEL}
LOG_LINES_MAX = 100_000  # that are read: a flight has some hundreds
DBC_SUFFIX = ".dbc"
RECORDING_KEY = "recording"  # of the manifest: what ties a journal to its recording


def open_recording(path: Path | str) -> "Recording":
    """Read a recording; a file that is none, is foreign or damaged is refused in one sentence."""
    path = Path(path)
    if path.is_dir():
        path = path / RECORDING_NAME
    contents = read_contents(str(path), read_whole(path), CHANNELS)
    if contents.profile != PROFILE:
        profile = echoed(contents.profile)
        found = f"has profile '{profile}'" if contents.profile else "has no profile"
        raise RecordingError(
            f"{path}: an MCAP file of another project, it {found}, ours is '{PROFILE}'"
        )
    if MANIFEST not in contents.metadata:
        if contents.damages:
            raise RecordingError(f"{path}: damaged{contents.damages[0]}; its manifest is lost")
        raise RecordingError(f"{path}: ends before its manifest, nothing of a flight is in it")
    written = echoed(contents.metadata[MANIFEST].get("format", "missing"))
    if written != FORMAT:
        raise RecordingError(f"{path}: format is {written}, this reader knows {FORMAT}")
    if contents.metadata[MANIFEST].get(CHECKSUM) != checksum_of(contents.metadata[MANIFEST]):
        raise RecordingError(f"{path}: damaged, the checksum of its manifest is wrong")
    kept = None if contents.is_complete else read_journal(path)
    is_own = kept and kept.recording_id == contents.metadata[MANIFEST].get(RECORDING_KEY)
    if kept is not None and not is_own and not kept.damage:
        kept = None  # another flight's
    return Recording(path, contents, kept)


def load_kernels() -> None:
    """Compile, or read from the cache, what reading a recording needs."""
    scan.load_kernels()
    decoder = decoder_of(icd.DBC_PATH.read_bytes())
    decoder.values(decoder.slots(np.zeros(0, BUS_LOG)), np.zeros(0, np.uint64))


class Recording:
    """One flight as it was recorded."""

    def __init__(self, path: Path, contents: Contents, kept: Kept | None = None) -> None:
        self.path = path
        self._contents = contents
        self._kept = kept

    @property
    def is_complete(self) -> bool:
        """Whether the recorder finished the file."""
        return self._contents.is_complete

    @property
    def damage(self) -> str:
        """Where the file, or its journal, is not as it was written; empty if nowhere."""
        places = self._contents.damages
        if places:
            more = f" and in {len(places) - 1} places more" if len(places) > 1 else ""
            return f"{self.path}: damaged{places[0]}{more}; read is what is whole"
        return self._kept.damage if self._kept else ""

    def check_whole(self) -> None:
        """Say, once what is whole has been used, that not everything is."""
        if self.damage:
            raise RecordingError(self.damage)

    @functools.cached_property
    def manifest(self) -> Mapping[str, str]:
        """What was flown, with what."""
        told = self._contents.metadata[MANIFEST]
        return {name: value for name, value in told.items() if name != CHECKSUM}

    @property
    def outcome(self) -> Mapping[str, str]:
        """How the flight ended; empty when the file is incomplete."""
        return self._contents.metadata.get(OUTCOME, {})

    @property
    def attachments(self) -> Mapping[str, bytes]:
        """The attached files by name."""
        return self._contents.attachments

    def attachment(self, name: str) -> bytes:
        """One attached file; `name` may be a suffix such as `.load`."""
        found = [n for n in self.attachments if n == name or (name[:1] == "." and n.endswith(name))]
        if len(found) != 1:
            there = echoed(", ".join(self.attachments) or "nothing")
            raise RecordingError(f"{self.path}: has no attachment {name}, attached is {there}")
        return self.attachments[found[0]]

    @functools.cached_property
    def decoder(self) -> Decoder:
        """Reads this recording's frames, through the DBC that came with it."""
        try:
            return decoder_of(self.attachment(DBC_SUFFIX))
        except IcdError as error:
            raise RecordingError(f"{self.path}: its DBC cannot be read ({error})") from error

    @functools.cached_property
    def dbc_failure(self) -> str:
        """Why its frames cannot be decoded; empty if they can."""
        try:
            self.decoder  # noqa: B018
        except RecordingError as error:
            return str(error)
        return ""

    @property
    def has_our_dbc(self) -> bool:
        """Whether it was recorded with the DBC of this version."""
        return self.attachment(DBC_SUFFIX) == icd.DBC_PATH.read_bytes()

    @property
    def dbc_sha256(self) -> tuple[str, str]:
        """Hashes of the DBC that came with it, and of this version's."""
        theirs = hashlib.sha256(self.attachment(DBC_SUFFIX)).hexdigest()
        return theirs, icd.DBC_SHA256

    @property
    def period_s(self) -> float | None:
        """The minor frame; None where the manifest does not tell."""
        return self.manifest_number("period_s")

    def manifest_number(self, key: str, base: int = 10) -> float | None:
        """A number of the manifest; None where it does not tell, or tells none."""
        text = self.manifest.get(key, "")[:NUMBER_CHARACTERS_MAX]
        try:
            found = float(text) if base == 10 else float(int(text, base))
        except ValueError:
            return None
        return found if math.isfinite(found) else None

    @property
    def load_crc32(self) -> int | None:
        """Which load flew; None where the manifest does not tell."""
        told = self.manifest_number("load_crc32", 16)
        return None if told is None else int(told)

    @property
    def until_s(self) -> float:
        """Mission time of the last frame."""
        return float(self.bus["t_s"][-1]) if len(self.bus) else 0.0

    @property
    def from_journal_s(self) -> float:
        """How much of the flight the journal beside an incomplete recording adds to it."""
        recorded = self._recorded_bus
        return self.until_s - (float(recorded["t_s"][-1]) if len(recorded) else 0.0)

    @functools.cached_property
    def _recorded_bus(self) -> Rows:
        return np.concatenate([np.zeros(0, BUS_LOG), *self.bus_chunks()])

    @functools.cached_property
    def bus(self) -> Rows:
        """All CAN frames in bus order, as BUS_LOG; a journal that goes on for longer has them."""
        if self._kept and len(self._kept.bus) > len(self._recorded_bus):
            return self._kept.bus
        return self._recorded_bus

    @property
    def _is_from_journal(self) -> bool:
        return self.bus is not self._recorded_bus

    def bus_chunks(self) -> Iterator[Rows]:
        """The CAN frames chunk by chunk, as BUS_LOG."""
        for piece in self._topic(FRAMES_TOPIC).pieces:
            with self._named():
                rows = bus_rows(piece)
            yield rows

    @contextlib.contextmanager
    def _named(self) -> Iterator[None]:
        """Refusals say which file it is."""
        try:
            yield
        except RecordingError as error:
            raise RecordingError(f"{self.path}: {error}") from error

    @functools.cached_property
    def missing_minor_frames(self) -> int:
        """Minor frames that the recorder dropped, as the gaps in their numbering tell."""
        if self._is_from_journal:
            return 0
        numbers = self._topic(FRAMES_TOPIC).sequences()
        return int(numbers[-1]) + 1 - len(numbers) if len(numbers) else 0

    @functools.cached_property
    def truth(self) -> Rows:
        """The sampled truth, nested fields flattened; empty when none was recorded."""
        recorded = self._recorded_truth()
        if self._kept is None or len(self._kept.truth) <= len(recorded):
            return recorded
        return flattened(self._kept.truth)

    def _recorded_truth(self) -> Rows:
        topic = self._topic(TRUTH_TOPIC)
        if topic.schema is None:
            return np.zeros(0, np.dtype([("t_s", "f8")]))
        with self._named():
            return truth_rows(topic, topic.schema)

    @functools.cached_property
    def log(self) -> list[LogLine]:
        """The log in the order in which it was written."""
        line = message_class(log_schema())
        lines, unread = [], 0
        for payload in itertools.islice(self._topic(LOG_TOPIC).payloads(), LOG_LINES_MAX):
            try:
                read = line.FromString(payload)
                t_s = read.timestamp.ToNanoseconds() / NS_PER_S
                check_times(np.array([t_s]), "a line")
                lines.append(LogLine(t_s, LogLevel(read.level), read.message))
            except (DecodeError, ValueError, RecordingError):
                unread += 1
        if unread:
            text = f"{unread:,} lines of the log cannot be read"
            lines.append(LogLine(lines[-1].t_s if lines else 0.0, LogLevel.WARNING, text))
        return lines + self._lines_of_journal()

    def _lines_of_journal(self) -> list[LogLine]:
        """The events that frames of the journal tell of, and the recorder had no time to log."""
        if not self._is_from_journal or self.dbc_failure:
            return []
        events, recorded = Events(self.decoder), len(self._recorded_bus)
        events.lines(self.bus[:recorded], self.slots[:recorded])
        return events.lines(self.bus[recorded:], self.slots[recorded:])[:LOG_LINES_MAX]

    @functools.cached_property
    def rows_before_gap(self) -> int:
        """Frames in front of the first minor frame that is missing; all if none is."""
        topic = self._topic(FRAMES_TOPIC)
        numbers = topic.sequences()
        lost = np.flatnonzero(numbers != np.arange(len(numbers)))
        if self._is_from_journal or not len(lost):
            return len(self.bus)
        counts = [frame_counts(piece) for piece in topic.pieces]
        return int(np.concatenate(counts)[: int(lost[0])].sum())

    @functools.cached_property
    def slots(self) -> I8:
        """The message in each frame of the bus; NO_SLOT for one of no known form."""
        return self.decoder.slots(self.bus)

    @property
    def frames_not_decoded(self) -> int:
        """Frames with an unknown identifier, a wrong length or a wrong checksum."""
        return int(np.count_nonzero(self.slots == NO_SLOT))

    def value_names(self, message: str) -> dict[str, dict[int, str]]:
        """What the values of a message's enumerations are called, by signal."""
        signals = self.decoder.messages[self.decoder.slot(message)].signals
        return {signal.name: dict(signal.names) for signal in signals if signal.names}

    def message(self, name: str) -> tuple[F8, dict[str, F8 | I8]]:
        """Every good frame of a CAN message: mission times, and values by signal."""
        slot = self.decoder.slot(name)
        rows = self.bus[self.slots == slot]
        return rows["t_s"], self.decoder.columns(slot, rows["frame"]["data"])

    def _topic(self, name: str) -> Topic:
        topic = self._contents.topics.get(name)
        wanted = SCHEMAS[name]
        if topic is not None and topic.schema is not None and topic.schema.name != wanted:
            raise RecordingError(
                f"{self.path}: {name} has schema {echoed(topic.schema.name)}, ours is {wanted}"
            )
        return topic or Topic(None, [])


def flattened(rows: Rows) -> Rows:
    """Records of numbers with nested ones flattened, as a recording has them."""
    fields = flat_fields(rows.dtype)
    out = np.zeros(len(rows), np.dtype([(name, inner) for name, _, inner in fields]))
    for name, path, _ in fields:
        column = rows
        for part in path:
            column = column[part]
        out[name] = column
    return out
