"""What a recording holds: topics, schemas and rates, on top of the MCAP container.

| topic | schema | rate |
| --- | --- | --- |
| /bus/frames | aeroshell.CanFrames | every minor frame, every CAN frame in bus order |
| /can/<message> | aeroshell.<message> | sampled, frames with a right checksum alone |
| /truth | aeroshell.Truth | sampled |
| /location | foxglove.LocationFix | sampled, of the truth |
| /log | foxglove.Log | every line, and the events that the bus tells of |

log_time is mission time. The sequence number of /bus/frames counts minor frames, so that a gap
shows even where the recorder had no chance to say so.
"""

import json
import zlib
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import numpy.typing as npt

from flight_sw.errors import RecordingError
from sim_harness.telemetry.container import Container
from sim_harness.telemetry.decode import NO_SLOT, Decoder, Sampler, messages_of
from sim_harness.telemetry.events import Events
from sim_harness.telemetry.records import BUS_LOG, TIME_MAX_S, LogLine
from sim_harness.telemetry.schema import (
    can_layout,
    flat_fields,
    frames_schema,
    layout_schema,
    location_schema,
    log_schema,
    message_class,
    record_layout,
)
from sim_harness.telemetry.wire import (
    LOCATION,
    LOCATION_FORMS,
    WORD_BYTES,
    Block,
    RowEncoder,
    encode_frames,
    field_words,
    layout_forms,
    layout_template,
    message_block,
)

Rows = npt.NDArray[np.void]
F8 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint64]

PROFILE = "aeroshell"
FORMAT = "2"
MANIFEST = "aeroshell.manifest"
OUTCOME = "aeroshell.outcome"
CHECKSUM = "crc32"  # of the manifest, which MCAP itself protects in a complete file alone
TRUTH_NAME = "Truth"

FRAMES_CHANNEL, LOG_CHANNEL, LOCATION_CHANNEL, TRUTH_CHANNEL, CAN_CHANNEL = 1, 2, 3, 4, 16
FRAMES_TOPIC, LOG_TOPIC, LOCATION_TOPIC, TRUTH_TOPIC = "/bus/frames", "/log", "/location", "/truth"

RATE_MAX_HZ = 1000.0
NS_PER_S = 1_000_000_000
LOG_SOURCE = "aeroshell"


def nanoseconds(t_s: F8) -> U8:
    """Mission time as MCAP counts it."""
    if t_s.size and not (t_s.min() >= 0.0 and t_s.max() <= TIME_MAX_S):
        wrong = t_s[~((t_s >= 0.0) & (t_s <= TIME_MAX_S))][0]
        raise RecordingError(f"t_s is {wrong}, allowed 0.0 to {TIME_MAX_S}")
    return np.rint(t_s * NS_PER_S).astype(np.uint64)


def checksum_of(manifest: Mapping[str, str]) -> str:
    """CRC-32 over all items of a manifest but the checksum itself."""
    items = sorted((name, value) for name, value in manifest.items() if name != CHECKSUM)
    return f"0x{zlib.crc32(json.dumps(items).encode()):08x}"


class CanTelemetry:
    """Decoded messages: one channel a CAN message."""

    def __init__(self, file: Container, dbc: bytes, rate_hz: float) -> None:
        messages = messages_of(dbc)
        layouts = [can_layout(message) for message in messages]
        channels = [CAN_CHANNEL + slot for slot in range(len(messages))]
        for channel, message, layout in zip(channels, messages, layouts, strict=True):
            file.add_channel(channel, f"/can/{message.name}", layout_schema(layout))
        self._decoder = Decoder(messages)
        self._sampler = Sampler(rate_hz, len(messages))
        self._encoder = RowEncoder([layout_template(layout) for layout in layouts], channels)
        self._forms = layout_forms(layouts)
        self._events = Events(self._decoder)
        self._names = [
            (slot, column, [0, *(value for value, _ in field.names)])
            for slot, layout in enumerate(layouts)
            for column, field in enumerate(layout.fields)
            if field.names
        ]

    def encode(self, rows: Rows, t_ns: U8) -> tuple[Block, list[LogLine]]:
        """Samples of the messages in these frames, and the events that they tell of."""
        slots = self._decoder.slots(rows)
        lines = self._events.lines(rows, slots)
        self._leave_out_unnamed(slots, rows["frame"]["data"])
        picked = self._sampler.pick(rows["t_s"], slots)
        slots = slots[picked]
        raw, physical = self._decoder.values(slots, rows["frame"]["data"][picked])
        words = field_words(slots, raw, physical, self._forms)
        return self._encoder.encode(slots, t_ns[picked], words), lines

    def _leave_out_unnamed(self, slots: I8, data: U8) -> None:
        """Mark false frames whose enumerations have values without a name: no reader takes them."""
        for slot, column, values in self._names:
            mine = np.flatnonzero(slots == slot)
            raw, _ = self._decoder.values(slots[mine], data[mine])
            slots[mine[~np.isin(raw[:, column], values)]] = NO_SLOT


class TruthTelemetry:
    """The truth and where on the planet it is; its record type is that of the first rows."""

    def __init__(self, file: Container, dtype: np.dtype, rate_hz: float) -> None:
        layout = record_layout(TRUTH_NAME, dtype)
        file.add_channel(TRUTH_CHANNEL, TRUTH_TOPIC, layout_schema(layout))
        self.dtype = dtype
        fields = flat_fields(dtype)
        self._paths = [path for _, path, _ in fields]
        sizes = [inner.itemsize for _, _, inner in fields]
        self._is_words = set(sizes) == {WORD_BYTES} and sum(sizes) == dtype.itemsize
        self._sampler = Sampler(rate_hz, 1)
        self._truth = RowEncoder([layout_template(layout)], [TRUTH_CHANNEL])
        self._location = RowEncoder((LOCATION,), (LOCATION_CHANNEL,))
        self._has_location = {"lat_rad", "lon_rad", "alt_m"} <= set(dtype.names or ())

    def encode(self, rows: Rows) -> list[Block]:
        """Samples of the truth, and of the place."""
        rows = rows[self._sampler.pick(rows["t_s"], np.zeros(len(rows), int))]
        t_ns = nanoseconds(rows["t_s"])
        slots = np.zeros(len(rows), int)
        blocks = [self._truth.encode(slots, t_ns, self._words(rows))]
        if self._has_location:
            blocks.append(self._location.encode(slots, t_ns, _location_words(rows, t_ns)))
        return blocks

    def _words(self, rows: Rows) -> U8:
        if self._is_words:
            return rows.view(np.uint64).reshape(len(rows), len(self._paths))
        words = np.zeros((len(rows), len(self._paths)), np.uint64)
        for i, path in enumerate(self._paths):
            column = rows
            for name in path:
                column = column[name]
            words[:, i] = column.astype(f"{column.dtype.kind}8").view(np.uint64)
        return words


def _location_words(rows: Rows, t_ns: U8) -> U8:
    slots = np.zeros(len(rows), int)
    place = np.zeros((len(rows), 5))
    place[:, 0] = np.degrees(rows["lat_rad"])
    place[:, 1] = np.degrees(rows["lon_rad"])
    place[:, 2] = rows["alt_m"]
    stamp = np.zeros((len(rows), 5), np.int64)
    stamp[:, 3], stamp[:, 4] = np.divmod(t_ns, np.uint64(NS_PER_S))
    return field_words(slots, stamp, place, LOCATION_FORMS)


class RecordingWriter:
    """A recording being written: every `write` is one chunk on disk when it returns.

    `until_s` is the time of the last frame that is in the file.
    """

    def __init__(
        self,
        path: Path,
        manifest: Mapping[str, str],
        attachments: Mapping[str, tuple[str, bytes]],
        telemetry_rate_hz: float,
    ) -> None:
        if not 0.0 < telemetry_rate_hz <= RATE_MAX_HZ:
            raise RecordingError(
                f"telemetry rate is {telemetry_rate_hz} Hz, allowed above 0 to {RATE_MAX_HZ} Hz"
            )
        dbcs = [content for name, (_, content) in attachments.items() if name.endswith(".dbc")]
        if len(dbcs) != 1:
            raise RecordingError(f"{path.name}: {len(dbcs)} DBC files to attach, wanted is one")
        self._rate_hz = telemetry_rate_hz
        self._minor_frames = 0
        self.until_s = 0.0
        self._truth: TruthTelemetry | None = None
        self._log_message = message_class(log_schema())
        self._file = Container(path, PROFILE, f"aeroshell {_version()}")
        extra = {"format": FORMAT, "telemetry_rate_hz": repr(telemetry_rate_hz)}
        told = {**manifest, **extra}
        self._file.add_metadata(MANIFEST, {**told, CHECKSUM: checksum_of(told)})
        for name, (media_type, content) in attachments.items():
            self._file.add_attachment(name, media_type, content)
        self._file.add_channel(FRAMES_CHANNEL, FRAMES_TOPIC, frames_schema())
        self._file.add_channel(LOG_CHANNEL, LOG_TOPIC, log_schema())
        self._file.add_channel(LOCATION_CHANNEL, LOCATION_TOPIC, location_schema())
        self._can = CanTelemetry(self._file, dbcs[0], telemetry_rate_hz)
        self._load_kernels()

    def write(self, bus: Sequence[Rows], truth: Sequence[Rows], log: Sequence[LogLine]) -> None:
        """Write what has come in as one chunk."""
        blocks: list[Block] = []
        events: list[LogLine] = []
        if bus:
            rows = np.concatenate(bus)
            t_ns = nanoseconds(rows["t_s"])
            frames = encode_frames(rows, t_ns, FRAMES_CHANNEL, self._minor_frames)
            self._minor_frames += len(frames.offsets)
            samples, events = self._can.encode(rows, t_ns)
            blocks += [frames, samples]
        if truth:
            blocks += self._encode_truth(np.concatenate(truth))
        blocks += [self._encode_line(line) for line in (*events, *log)]
        blocks = [block for block in blocks if block.blob]
        if blocks:
            self._file.add_chunk(blocks)
        if bus:
            self.until_s = float(bus[-1]["t_s"][-1])

    def skip(self, minor_frames: int) -> None:
        """Leave a gap in the numbering of minor frames, for those that were lost."""
        self._minor_frames += minor_frames

    def finish(self, outcome: Mapping[str, str]) -> None:
        """Make the file complete."""
        self._file.add_metadata(OUTCOME, outcome)
        self._file.finish()

    def close(self) -> None:
        """Close the file as it is."""
        self._file.close()

    def _load_kernels(self) -> None:
        """Compile, or read from the cache, before the flight; an empty frame leaves no trace."""
        rows, t_ns = np.zeros(1, BUS_LOG), np.zeros(1, np.uint64)
        encode_frames(rows, t_ns, FRAMES_CHANNEL, 0)
        self._can.encode(rows, t_ns)

    def _encode_truth(self, rows: Rows) -> list[Block]:
        if self._truth is None:
            self._truth = TruthTelemetry(self._file, rows.dtype, self._rate_hz)
        if rows.dtype != self._truth.dtype:
            raise RecordingError("the record type of the truth changed during the flight")
        return self._truth.encode(rows)

    def _encode_line(self, line: LogLine) -> Block:
        t_ns = int(nanoseconds(np.array([line.t_s]))[0])
        message = self._log_message(level=int(line.level), message=line.text, name=LOG_SOURCE)
        message.timestamp.FromNanoseconds(t_ns)
        return message_block(LOG_CHANNEL, t_ns, message.SerializeToString())


def _version() -> str:
    try:
        return version("aeroshell")
    except PackageNotFoundError:
        return "of no release"
