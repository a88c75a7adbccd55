"""Protobuf messages as MCAP message records, in bulk and compiled.

Messages of one type have the same length: each is a copy of a template with its holes filled.
Zero values are written out, and varints are padded to a fixed length; both are valid Protobuf.
Only the raw frames of a minor frame vary in length.
"""

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.records.types_ import U8
from sim_harness.jit import kernel
from sim_harness.telemetry.schema import BYTES, DOUBLE, FIXED64, VARINT, Layout, tag, varint

U1 = npt.NDArray[np.uint8]
I8 = npt.NDArray[np.int64]
Rows = npt.NDArray[np.void]

OPCODE_MESSAGE = 5
HEAD = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
HEAD_BYTES = HEAD.size
UNCOUNTED_BYTES = 9  # opcode and length
LENGTH, SEQUENCE, LOG_TIME, PUBLISH_TIME = 1, 11, 15, 23  # places in the head
WORD_BYTES = 8
BYTE, BYTE_BITS = np.uint64(0xFF), np.uint64(8)
GROUP, GROUP_BITS, MORE = np.uint64(0x7F), np.uint64(7), np.uint64(0x80)  # of a varint

T_S_TAG, FRAMES_TAG = tag(1, FIXED64)[0], tag(2, BYTES)[0]
FRAMES_HEAD_BYTES = HEAD_BYTES + 1 + WORD_BYTES + 1  # as far as the length of the frames
FRAME_BYTES = 16  # struct can_frame
ROW_BYTES = WORD_BYTES + FRAME_BYTES  # of BUS_LOG
FRAMES_MAX = 1000  # in one message: two bytes then hold their length
ROW_BYTES_MAX = FRAMES_HEAD_BYTES + 2 + FRAME_BYTES  # what a frame can take up in a message

HOLE = np.dtype([("start", "i8"), ("width_bytes", "i8")])

FORM_DOUBLE, FORM_INTEGER = 0, -1  # forms of a field; a positive one is the width of a varint

Template = Sequence[bytes | int]
"""A message: fixed bytes, and the widths of the holes between them."""

LOCATION: Template = (
    tag(1, FIXED64), 8, tag(2, FIXED64), 8, tag(3, FIXED64), 8,
    tag(6, BYTES) + varint(12) + tag(1, VARINT), 5, tag(2, VARINT), 5,
)  # fmt: skip
"""foxglove.LocationFix: latitude, longitude, altitude, then seconds and nanoseconds as varints."""
LOCATION_FORMS = np.array([[FORM_DOUBLE, FORM_DOUBLE, FORM_DOUBLE, 5, 5]])


class Block(NamedTuple):
    """Message records end to end, and where each begins."""

    blob: bytes
    channels: I8
    t_ns: U8
    offsets: I8


@kernel
def _put(out: U1, at: int, word: np.uint64, width_bytes: int) -> None:
    """Write the low bytes of a word."""
    for i in range(width_bytes):
        out[at + i] = word & BYTE
        word >>= BYTE_BITS


@kernel
def _padded_varint(value: np.uint64, width_bytes: int) -> np.uint64:
    """The bytes of a varint of a fixed length of at most eight bytes, lowest first."""
    word = np.uint64(0)
    for i in range(width_bytes):
        group = value & GROUP
        if i < width_bytes - 1:
            group |= MORE
        word |= group << np.uint64(8 * i)
        value >>= GROUP_BITS
    return word


@kernel
def _form_words(slots: I8, raw: I8, bits: U8, forms: I8, words: U8) -> None:
    """Write the bits of every field: of `raw`, or of the floats whose `bits` are given."""
    for i in range(len(slots)):
        for k in range(words.shape[1]):
            form = forms[slots[i], k]
            if form == FORM_DOUBLE:
                words[i, k] = bits[i, k]
            elif form == FORM_INTEGER:
                words[i, k] = np.uint64(raw[i, k])
            else:
                words[i, k] = _padded_varint(np.uint64(raw[i, k]), form)


@kernel
def _fill_rows(
    slots: I8, t_ns: U8, words: U8, templates: U1, holes: Rows, sizes: I8, out: U1, offsets: I8
) -> None:
    """Write one message a row of `words`, whose columns are the bits of its fields."""
    at = 0
    for i in range(len(slots)):
        slot = slots[i]
        offsets[i] = at
        for b in range(sizes[slot]):
            out[at + b] = templates[slot, b]
        _put(out, at + LOG_TIME, t_ns[i], WORD_BYTES)
        _put(out, at + PUBLISH_TIME, t_ns[i], WORD_BYTES)
        for k in range(words.shape[1]):
            hole = holes[slot, k]
            _put(out, at + hole["start"], words[i, k], hole["width_bytes"])
        at += sizes[slot]


@kernel
def _group_end(rows: Rows, first: int) -> int:
    """Where the minor frame that begins here ends; one with very many frames is cut."""
    last = first + 1
    while last < len(rows) and last - first < FRAMES_MAX:
        if rows[last]["t_s"] != rows[first]["t_s"]:
            break
        last += 1
    return last


@kernel
def _put_frames_head(out: U1, at: int, octets: U1, first: int, length: int) -> int:
    """Write the fields of aeroshell.CanFrames as far as the frames; returns where those begin."""
    out[at] = T_S_TAG
    at += 1
    for b in range(WORD_BYTES):
        out[at + b] = octets[first, b]
    at += WORD_BYTES
    out[at] = FRAMES_TAG
    at += 1
    if length <= 0x7F:
        out[at] = length
        return at + 1
    out[at] = length & 0x7F | 0x80
    out[at + 1] = length >> 7
    return at + 2


@kernel
def _fill_frames(
    rows: Rows, octets: U1, row_ns: U8, head: U1, sequence: int, out: U1, offsets: I8, t_ns: U8
) -> int:
    """Write one message a minor frame; returns their number. `octets` are the rows' bytes."""
    n = 0
    at = 0
    first = 0
    while first < len(rows):
        last = _group_end(rows, first)
        for b in range(HEAD_BYTES):
            out[at + b] = head[b]
        body = _put_frames_head(out, at + HEAD_BYTES, octets, first, (last - first) * FRAME_BYTES)
        end = body
        for i in range(first, last):
            for b in range(FRAME_BYTES):
                out[end + b] = octets[i, WORD_BYTES + b]
            end += FRAME_BYTES
        _put(out, at + LENGTH, np.uint64(end - at - UNCOUNTED_BYTES), WORD_BYTES)
        _put(out, at + SEQUENCE, np.uint64(sequence + n), 4)
        _put(out, at + LOG_TIME, row_ns[first], WORD_BYTES)
        _put(out, at + PUBLISH_TIME, row_ns[first], WORD_BYTES)
        t_ns[n] = row_ns[first]
        offsets[n] = at
        n += 1
        at = end
        first = last
    offsets[n] = at
    return n


def template_bytes(template: Template) -> int:
    """The length of a message."""
    return sum(piece if isinstance(piece, int) else len(piece) for piece in template)


def layout_template(layout: Layout) -> Template:
    """The template of a layout."""
    pieces: list[bytes | int] = []
    for number, field in enumerate(layout.fields, start=1):
        pieces += [tag(number, field.kind.wire_type), field.kind.width_bytes]
    return pieces


def layout_forms(layouts: Sequence[Layout]) -> I8:
    """How each field of each layout is sent."""
    width = max(len(layout.fields) for layout in layouts)
    forms = np.full((len(layouts), width), FORM_INTEGER)
    for slot, layout in enumerate(layouts):
        for i, field in enumerate(layout.fields):
            if field.kind == DOUBLE:
                forms[slot, i] = FORM_DOUBLE
            elif field.kind.wire_type == VARINT:
                forms[slot, i] = field.kind.width_bytes
    return forms


def groups_of(t_s: npt.NDArray[np.float64]) -> I8:
    """Where each minor frame begins."""
    return np.flatnonzero(np.diff(t_s, prepend=np.nan) != 0.0)


class RowEncoder:
    """Fills the templates of several message types, each on its own channel."""

    def __init__(self, templates: Sequence[Template], channels: Sequence[int]) -> None:
        sizes = [
            HEAD_BYTES + sum(p if isinstance(p, int) else len(p) for p in t) for t in templates
        ]
        self.width = max(sum(isinstance(p, int) for p in t) for t in templates)
        self._channels = np.array(channels)
        self._sizes = np.array(sizes)
        self._templates = np.zeros((len(sizes), max(sizes)), np.uint8)
        self._holes = np.zeros((len(sizes), self.width), HOLE)  # width 0: no such field
        for slot, template in enumerate(templates):
            self._set_up(slot, template)

    def _set_up(self, slot: int, template: Template) -> None:
        length = int(self._sizes[slot]) - UNCOUNTED_BYTES
        row = bytearray(HEAD.pack(OPCODE_MESSAGE, length, int(self._channels[slot]), 0, 0, 0))
        holes = 0
        for piece in template:
            if isinstance(piece, int):
                self._holes[slot, holes] = len(row), piece
                holes += 1
            row += bytes(piece) if isinstance(piece, int) else piece
        self._templates[slot, : len(row)] = np.frombuffer(row, np.uint8)

    def encode(self, slots: I8, t_ns: U8, words: U8) -> Block:
        """One message a row; `words` holds the bits of every field, low bytes first."""
        sizes = self._sizes[slots]
        out = np.empty(int(sizes.sum()), np.uint8)
        offsets = np.empty(len(slots), np.int64)
        tables = self._templates, self._holes, self._sizes
        _fill_rows(slots, t_ns, words, *tables, out, offsets)
        return Block(out.tobytes(), self._channels[slots], t_ns, offsets)


def field_words(slots: I8, raw: I8, values: npt.NDArray[np.float64], forms: I8) -> U8:
    """The bits of fields that are integers (`raw`) or floats (`values`), as their forms say."""
    words = np.empty(raw.shape, np.uint64)
    _form_words(slots, raw, values.view(np.uint64), forms, words)
    return words


def message_block(channel: int, t_ns: int, payload: bytes) -> Block:
    """A single message of any form."""
    length = HEAD_BYTES - UNCOUNTED_BYTES + len(payload)
    head = HEAD.pack(OPCODE_MESSAGE, length, channel, 0, t_ns, t_ns)
    return Block(head + payload, np.array([channel]), np.array([t_ns], np.uint64), np.zeros(1, int))


def encode_frames(rows: Rows, row_ns: U8, channel: int, sequence: int) -> Block:
    """aeroshell.CanFrames, one message a minor frame; `sequence` counts them."""
    out = np.empty(len(rows) * ROW_BYTES_MAX, np.uint8)
    offsets = np.empty(len(rows) + 1, np.int64)
    t_ns = np.empty(len(rows), np.uint64)
    octets = rows.view(np.uint8).reshape(len(rows), ROW_BYTES)
    head = np.array([*HEAD.pack(OPCODE_MESSAGE, 0, channel, 0, 0, 0)], np.uint8)
    n = _fill_frames(rows, octets, row_ns, head, sequence, out, offsets, t_ns)
    return Block(out[: offsets[n]].tobytes(), np.full(n, channel), t_ns[:n], offsets[:n])
