"""Protobuf schemas of a recording, built at run time from the DBC and from record dtypes.

A `Layout` is a message type whose fields all have a fixed width on the wire, so that messages can
be written and read in bulk as rows of bytes. Each schema is a whole FileDescriptorSet: a viewer
decodes the recording without any file of ours.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from google.protobuf import descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.message import DecodeError

from flight_sw.errors import RecordingError
from flight_sw.icd import Message, Signal
from flight_sw.runtime.echo import echoed, is_plain_name

PACKAGE = "aeroshell"
DESCRIPTORS_BYTES_MAX = 1 << 16  # of a schema that is read
VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5  # wire types
TIMESTAMP_FILE = "google/protobuf/timestamp.proto"


class Kind(NamedTuple):
    """How a field looks in the descriptor and on the wire."""

    type: int
    wire_type: int
    width_bytes: int


DOUBLE = Kind(FieldDescriptorProto.TYPE_DOUBLE, FIXED64, 8)
FIXED_U4 = Kind(FieldDescriptorProto.TYPE_FIXED32, FIXED32, 4)
FIXED_I4 = Kind(FieldDescriptorProto.TYPE_SFIXED32, FIXED32, 4)
FIXED_U8 = Kind(FieldDescriptorProto.TYPE_FIXED64, FIXED64, 8)
FIXED_I8 = Kind(FieldDescriptorProto.TYPE_SFIXED64, FIXED64, 8)
KIND_OF_DTYPE = {"f8": DOUBLE, "u4": FIXED_U4, "i4": FIXED_I4, "u8": FIXED_U8, "i8": FIXED_I8}
DTYPE_OF_TYPE = {kind.type: code for code, kind in KIND_OF_DTYPE.items()}


def enum_kind(bits: int) -> Kind:
    """An enumeration as a varint that is always as long as its largest value needs."""
    return Kind(FieldDescriptorProto.TYPE_ENUM, VARINT, -(-bits // 7))


class Field(NamedTuple):
    """One field of a layout; its number is its place, from 1."""

    name: str
    kind: Kind
    names: tuple[tuple[int, str], ...] = ()
    """Values and names of an enumeration."""


@dataclass(frozen=True, slots=True)
class Layout:
    """A message type of fixed width."""

    name: str
    fields: tuple[Field, ...]


@dataclass(frozen=True, slots=True)
class Schema:
    """What MCAP keeps of a message type."""

    name: str
    descriptors: bytes
    """A serialised FileDescriptorSet."""


def varint(value: int) -> bytes:
    """Base-128 varint of a number that is not negative."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def tag(number: int, wire_type: int) -> bytes:
    """What stands before a field's value."""
    return varint(number << 3 | wire_type)


# --- layouts ---------------------------------------------------------------------------------


def _signal_kind(signal: Signal) -> Kind:
    if signal.names and not signal.signed:
        return enum_kind(signal.bits)
    if signal.scale != 1.0 or signal.offset != 0.0 or signal.bits > 32:
        return DOUBLE
    return FIXED_I4 if signal.signed else FIXED_U4


def can_layout(message: Message) -> Layout:
    """The layout of one CAN message: its signals in frame order."""
    fields = tuple(
        Field(s.name, kind, s.names if kind.wire_type == VARINT else ())
        for s in message.signals
        for kind in (_signal_kind(s),)
    )
    return Layout(f"{PACKAGE}.{message.name}", fields)


def flat_fields(dtype: np.dtype) -> list[tuple[str, tuple[str, ...], np.dtype]]:
    """Name, path and type of every number in a record; nested names are joined with `_`."""
    found = []
    for name in dtype.names or ():
        inner = dtype[name]
        if inner.names:
            found += [(f"{name}_{n}", (name, *path), t) for n, path, t in flat_fields(inner)]
        else:
            found.append((name, (name,), inner))
    return found


def record_layout(name: str, dtype: np.dtype) -> Layout:
    """The layout of a record of numbers, nested records flattened."""
    fields = []
    for field, _, inner in flat_fields(dtype):
        kind = KIND_OF_DTYPE.get(inner.str[1:])
        if kind is None:
            allowed = ", ".join(KIND_OF_DTYPE)
            raise RecordingError(f"{name}.{field}: is {inner}, allowed are {allowed}")
        fields.append(Field(field, kind))
    return Layout(f"{PACKAGE}.{name}", tuple(fields))


# --- descriptors -----------------------------------------------------------------------------


def _add_field(message: DescriptorProto, number: int, name: str, type_: int) -> Any:
    return message.field.add(
        name=name, number=number, type=type_, label=FieldDescriptorProto.LABEL_OPTIONAL
    )


def _add_enum(message: DescriptorProto, field: Field, taken: set[str], scope: str) -> str:
    """Add the enumeration of a field; its names get the field's as prefix where they clash."""
    names = dict(field.names)
    names = {0: names.pop(0, "NONE"), **names}  # proto3 wants zero, and wants it first
    enum = message.enum_type.add(name=field.name.title().replace("_", ""))
    clash = taken & set(names.values())
    for value, name in names.items():
        enum.value.add(name=f"{field.name.upper()}_{name}" if clash else name, number=value)
    taken |= set(names.values())
    return f".{scope}.{enum.name}"


def _file(name: str) -> tuple[FileDescriptorProto, DescriptorProto]:
    package, _, short = name.rpartition(".")
    path = f"{package}/{short}.proto"
    file = FileDescriptorProto(name=path, package=package, syntax="proto3")
    return file, file.message_type.add(name=short)


def _schema(name: str, *files: FileDescriptorProto) -> Schema:
    descriptors = FileDescriptorSet(file=files).SerializeToString(deterministic=True)
    return Schema(name, descriptors)


def layout_schema(layout: Layout) -> Schema:
    """The schema of a layout."""
    file, message = _file(layout.name)
    taken: set[str] = set()
    for number, field in enumerate(layout.fields, start=1):
        added = _add_field(message, number, field.name, field.kind.type)
        if field.kind.wire_type == VARINT:
            added.type_name = _add_enum(message, field, taken, layout.name)
    return _schema(layout.name, file)


def frames_schema() -> Schema:
    """aeroshell.CanFrames: all frames of one minor frame, each a struct can_frame of 16 bytes."""
    file, message = _file(f"{PACKAGE}.CanFrames")
    _add_field(message, 1, "t_s", FieldDescriptorProto.TYPE_DOUBLE)
    _add_field(message, 2, "frames", FieldDescriptorProto.TYPE_BYTES)
    return _schema(f"{PACKAGE}.CanFrames", file)


def _foxglove(
    name: str, build: Callable[[DescriptorProto], None], *, timestamp_number: int
) -> Schema:
    file, message = _file(f"foxglove.{name}")
    build(message)
    stamp = _add_field(message, timestamp_number, "timestamp", FieldDescriptorProto.TYPE_MESSAGE)
    stamp.type_name = ".google.protobuf.Timestamp"
    file.dependency.append(TIMESTAMP_FILE)
    timestamp = FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(timestamp)
    return _schema(f"foxglove.{name}", timestamp, file)


def location_schema() -> Schema:
    """foxglove.LocationFix, with the published field numbers; what we never set is left out."""

    def build(message: DescriptorProto) -> None:
        for number, name in enumerate(("latitude", "longitude", "altitude"), start=1):
            _add_field(message, number, name, FieldDescriptorProto.TYPE_DOUBLE)
        _add_field(message, 7, "frame_id", FieldDescriptorProto.TYPE_STRING)

    return _foxglove("LocationFix", build, timestamp_number=6)


def log_schema() -> Schema:
    """foxglove.Log, with the published field numbers."""

    def build(message: DescriptorProto) -> None:
        level = message.enum_type.add(name="Level")
        for value, name in enumerate(("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")):
            level.value.add(name=name, number=value)
        _add_field(
            message, 2, "level", FieldDescriptorProto.TYPE_ENUM
        ).type_name = ".foxglove.Log.Level"
        for number, name in enumerate(("message", "name", "file"), start=3):
            _add_field(message, number, name, FieldDescriptorProto.TYPE_STRING)
        _add_field(message, 6, "line", FieldDescriptorProto.TYPE_FIXED32)

    return _foxglove("Log", build, timestamp_number=1)


# --- reading ---------------------------------------------------------------------------------


def message_class(schema: Schema) -> Any:
    """The class that parses messages of a schema, from its descriptors alone."""
    pool = descriptor_pool.DescriptorPool()
    for file in FileDescriptorSet.FromString(schema.descriptors).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def record_dtype(schema: Schema) -> np.dtype:
    """The flat record that a layout made of numbers alone stands for."""
    if len(schema.descriptors) > DESCRIPTORS_BYTES_MAX:
        raise RecordingError(
            f"schema {echoed(schema.name)} has {len(schema.descriptors):,} bytes, "
            f"allowed are {DESCRIPTORS_BYTES_MAX:,}"
        )
    try:
        fields = FileDescriptorSet.FromString(schema.descriptors).file[-1].message_type[0].field
    except (DecodeError, IndexError) as error:
        raise RecordingError(f"schema {echoed(schema.name)} describes no message") from error
    for place, field in enumerate(fields, start=1):
        where = f"schema {echoed(schema.name)}, field {place}"
        if field.type not in DTYPE_OF_TYPE:
            raise RecordingError(f"{where}: {echoed(field.name)} is not a number of fixed width")
        if not is_plain_name(field.name) or field.number != place:
            raise RecordingError(f"{where}: {echoed(field.name)} is no field of a record")
    if len({field.name for field in fields}) != len(fields):
        raise RecordingError(f"schema {echoed(schema.name)} has two fields of one name")
    return np.dtype([(field.name, DTYPE_OF_TYPE[field.type]) for field in fields])
