"""Messages of a recording as records, in bulk: CAN frames, and the truth.

The recorder lays each of them out in one way alone; what is laid out otherwise is refused.
"""

import numpy as np
import numpy.typing as npt

from flight_sw.errors import RecordingError
from sim_harness.telemetry.records import BUS_LOG, TIME_MAX_S
from sim_harness.telemetry.schema import KIND_OF_DTYPE, Schema, record_dtype, tag
from sim_harness.telemetry.unpack import Piece, Topic
from sim_harness.telemetry.wire import (
    FRAME_BYTES,
    FRAMES_HEAD_BYTES,
    FRAMES_TAG,
    HEAD_BYTES,
    T_S_TAG,
    WORD_BYTES,
)

Rows = npt.NDArray[np.void]
F8 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int64]
U1 = npt.NDArray[np.uint8]

MORE, GROUP = 0x80, 0x7F  # of a varint
FRAMES_TAG_AT = HEAD_BYTES + 1 + WORD_BYTES
T_S = "t_s"
STRANGE = "a message that the recorder does not lay out so"


def check_times(t_s: F8, what: str) -> None:
    """Refuse what no clock of a flight shows: everything that reads a recording goes by it."""
    if t_s.size and not (t_s.min() >= 0.0 and t_s.max() <= TIME_MAX_S):
        wrong = t_s[~((t_s >= 0.0) & (t_s <= TIME_MAX_S))][0]
        raise RecordingError(f"{what} has t_s {wrong}, allowed are 0 to {TIME_MAX_S:g} s")


def frame_counts(piece: Piece) -> I8:
    """Frames in each aeroshell.CanFrames message, of which all are laid out as they should be."""
    octets = np.frombuffer(piece.blob, np.uint8)
    return (piece.sizes - _bodies(octets, piece.starts)) // FRAME_BYTES


def _bodies(octets: U1, starts: I8) -> I8:
    """How far into each message its frames begin: their length is a varint of one byte or two."""
    return FRAMES_HEAD_BYTES + 1 + (octets[starts + FRAMES_HEAD_BYTES] > GROUP)


def _check_frames(octets: U1, starts: I8, sizes: I8) -> None:
    """Refuse messages of another form. What is looked at lies within each of them."""
    good = bool((sizes > FRAMES_HEAD_BYTES + 1).all())
    if good:
        low, high = (octets[starts + FRAMES_HEAD_BYTES + i].astype(np.int64) for i in (0, 1))
        length = np.where(low & MORE, low & GROUP | high << 7, low)
        good = bool(
            (octets[starts + HEAD_BYTES] == T_S_TAG).all()
            and (octets[starts + FRAMES_TAG_AT] == FRAMES_TAG).all()
            and (_bodies(octets, starts) + length == sizes).all()
            and (length % FRAME_BYTES == 0).all()
        )
    if not good:
        raise RecordingError(f"among its frames is {STRANGE}")


def bus_rows(piece: Piece) -> Rows:
    """Frames of aeroshell.CanFrames messages as BUS_LOG."""
    blob, starts, sizes = piece
    octets = np.frombuffer(blob, np.uint8)
    _check_frames(octets, starts, sizes)
    times = starts[:, None] + np.arange(HEAD_BYTES + 1, FRAMES_TAG_AT)
    t_s = octets[times].view(np.float64)[:, 0]
    check_times(t_s, "a frame")
    spans = zip((starts + _bodies(octets, starts)).tolist(), (starts + sizes).tolist(), strict=True)
    frames = b"".join([blob[a:b] for a, b in spans])
    rows = np.zeros(len(frames) // FRAME_BYTES, BUS_LOG)
    rows["frame"] = np.frombuffer(frames, BUS_LOG["frame"])
    rows["t_s"] = np.repeat(t_s, frame_counts(piece))
    return rows


def truth_rows(topic: Topic, schema: Schema) -> Rows:
    """The samples of the truth, as the schema that came with them says."""
    dtype = record_dtype(schema)
    if dtype.names is None or T_S not in dtype.names or dtype[T_S] != np.float64:
        raise RecordingError(f"its schema of the truth has no field {T_S}")
    tags = {
        f"tag_{n}": tag(n, KIND_OF_DTYPE[dtype[name].str[1:]].wire_type)
        for n, name in enumerate(dtype.names, start=1)
    }
    wire = np.dtype(
        [
            part
            for (mark, octets), name in zip(tags.items(), dtype.names, strict=True)
            for part in ((mark, f"V{len(octets)}"), (f"of_{name}", dtype[name]))
        ]
    )
    found = [np.zeros(0, wire)]
    for piece in topic.pieces:
        if (piece.sizes != HEAD_BYTES + wire.itemsize).any():
            raise RecordingError(f"among its samples of the truth is {STRANGE}")
        payloads = b"".join(Topic(schema, [piece]).payloads())
        found.append(np.frombuffer(payloads, wire))
    rows = np.concatenate(found)
    out = np.zeros(len(rows), dtype)
    for (mark, octets), name in zip(tags.items(), dtype.names, strict=True):
        if (rows[mark] != np.void(octets)).any():
            raise RecordingError(f"among its samples of the truth is {STRANGE}")
        out[name] = rows[f"of_{name}"]
    check_times(out[T_S], "a sample of the truth")
    return out
