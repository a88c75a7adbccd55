"""The schemas in a recording are whole, and those of others have their published numbers."""

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet

from flight_sw import icd
from flight_sw.errors import RecordingError
from flight_sw.icd import Message, Signal
from sim_harness.telemetry import schema, wire
from sim_harness.world.records import TRUTH

# github.com/foxglove/foxglove-sdk, schemas/proto/foxglove/LocationFix.proto
LOCATION_FIX = {
    "latitude": (1, "TYPE_DOUBLE"),
    "longitude": (2, "TYPE_DOUBLE"),
    "altitude": (3, "TYPE_DOUBLE"),
    "timestamp": (6, "TYPE_MESSAGE"),
    "frame_id": (7, "TYPE_STRING"),
}
# likewise, Log.proto
LOG = {
    "timestamp": (1, "TYPE_MESSAGE"),
    "level": (2, "TYPE_ENUM"),
    "message": (3, "TYPE_STRING"),
    "name": (4, "TYPE_STRING"),
    "file": (5, "TYPE_STRING"),
    "line": (6, "TYPE_FIXED32"),
}
LEVELS = {"UNKNOWN": 0, "DEBUG": 1, "INFO": 2, "WARNING": 3, "ERROR": 4, "FATAL": 5}


def fields_of(found: schema.Schema) -> dict[str, tuple[int, str]]:
    message = FileDescriptorSet.FromString(found.descriptors).file[-1].message_type[0]
    return {f.name: (f.number, FieldDescriptorProto.Type.Name(f.type)) for f in message.field}


def test_location_has_the_published_field_numbers() -> None:
    found = schema.location_schema()
    assert found.name == "foxglove.LocationFix"
    assert fields_of(found) == LOCATION_FIX


def test_log_has_the_published_field_numbers_and_levels() -> None:
    found = schema.log_schema()
    assert found.name == "foxglove.Log"
    assert fields_of(found) == LOG
    levels = schema.message_class(found).DESCRIPTOR.fields_by_name["level"].enum_type.values
    assert {value.name: value.number for value in levels} == LEVELS


ALL = [
    schema.frames_schema(),
    schema.location_schema(),
    schema.log_schema(),
    schema.layout_schema(schema.record_layout("Truth", TRUTH)),
    *(schema.layout_schema(schema.can_layout(message)) for message in icd.LAYOUT),
]


@pytest.mark.parametrize("found", ALL, ids=lambda s: s.name)
def test_descriptors_are_complete_and_make_a_parser(found: schema.Schema) -> None:
    assert schema.message_class(found).DESCRIPTOR.full_name == found.name


@pytest.mark.parametrize("message", icd.LAYOUT, ids=lambda m: m.name)
def test_every_signal_is_a_field_in_frame_order(message: Message) -> None:
    fields = fields_of(schema.layout_schema(schema.can_layout(message)))
    assert [(n, number) for n, (number, _) in fields.items()] == [
        (signal.name, number) for number, signal in enumerate(message.signals, start=1)
    ]


def signal(name: str, bits: int, names: tuple[tuple[int, str], ...] = ()) -> Signal:
    return Signal(name, 12, bits, False, 1.0, 0.0, 0.0, 1.0, "", "", names)


def test_names_that_clash_in_one_message_are_told_apart_and_zero_is_always_named() -> None:
    on_off = ((0, "OFF"), (1, "ON"))
    signals = (
        signal("pump", 1, on_off),
        signal("valve", 1, on_off),
        signal("request", 8, ((1, "ARM"),)),
    )
    message = Message("M", 1, "FSW", 20, (), "", signals)
    kind = schema.message_class(schema.layout_schema(schema.can_layout(message))).DESCRIPTOR
    names = {f.name: [v.name for v in f.enum_type.values] for f in kind.fields}
    assert names == {
        "pump": ["OFF", "ON"],
        "valve": ["VALVE_OFF", "VALVE_ON"],
        "request": ["NONE", "ARM"],
    }


@pytest.mark.parametrize("bits", [1, 7, 8, 14, 15])
def test_an_enumeration_of_any_width_parses_over_its_whole_range(bits: int) -> None:
    message = Message("M", 1, "FSW", 20, (), "", (signal("state", bits, ((1, "ON"),)),))
    layout = schema.can_layout(message)
    top = (1 << bits) - 1
    raw = np.array([[0], [1], [top // 2], [top]])
    slots, t_ns = np.zeros(4, int), np.zeros(4, np.uint64)
    words = wire.field_words(slots, raw, np.zeros((4, 1)), wire.layout_forms([layout]))
    block = wire.RowEncoder([wire.layout_template(layout)], [1]).encode(slots, t_ns, words)
    parse = schema.message_class(schema.layout_schema(layout)).FromString
    ends = [*block.offsets[1:].tolist(), len(block.blob)]
    found = [
        parse(block.blob[a + wire.HEAD_BYTES : b]).state
        for a, b in zip(block.offsets.tolist(), ends, strict=True)
    ]
    assert found == raw[:, 0].tolist()


def test_a_record_of_every_kind_of_number_is_described_and_read_back() -> None:
    dtype = np.dtype([("a_m", "f8"), ("n", "u4"), ("i", "i4"), ("big", "u8"), ("neg", "i8")])
    found = schema.layout_schema(schema.record_layout("Truth", dtype))
    assert [kind for _, kind in fields_of(found).values()] == [
        "TYPE_DOUBLE", "TYPE_FIXED32", "TYPE_SFIXED32", "TYPE_FIXED64", "TYPE_SFIXED64",
    ]  # fmt: skip
    assert schema.record_dtype(found) == dtype


def test_a_record_with_an_array_is_refused_by_name() -> None:
    dtype = np.dtype([("t_s", "f8"), ("table", "f8", (3,))])
    with pytest.raises(RecordingError, match=r"Truth\.table: is .* allowed are f8, u4, i4, u8, i8"):
        schema.record_layout("Truth", dtype)


@pytest.mark.parametrize(
    ("value", "wanted"), [(0, "00"), (1, "01"), (127, "7f"), (128, "8001"), (300, "ac02")]
)
def test_varints_are_those_of_the_encoding_guide(value: int, wanted: str) -> None:
    assert schema.varint(value).hex() == wanted
