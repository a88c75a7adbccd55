"""The messages of the bus, read once from aeroshell.dbc: the one source of packing, range and rate.

Messages are numbered by ascending identifier (slots). The signals of all messages, without those
of the end-to-end protection, are numbered through in one flat vector of values.
"""

import hashlib
from dataclasses import astuple, dataclass, replace
from pathlib import Path

from cantools.database import Database
from cantools.database.can import Message as DbcMessage
from cantools.database.can import Signal as DbcSignal

from flight_sw.errors import IcdError
from flight_sw.runtime.echo import NAME_MAX, echoed, is_plain_name

DBC_PATH = Path(__file__).with_name("aeroshell.dbc")
DBC_SHA256 = hashlib.sha256(DBC_PATH.read_bytes()).hexdigest()

NODES = ("HARNESS", "FSW")
"""The two ends of the bus; a node's number is its place here."""

FRAME_BYTES = 8
COUNTER_VALUES = 16
E2E_SIGNALS = {"e2e_crc": (0, 8), "e2e_counter": (8, 4)}  # name: first bit, length
DATA_IDS_ATTRIBUTE = "E2EDataIds"


@dataclass(frozen=True, slots=True)
class Signal:
    """One physical value: raw bits, scale, and the range that may be sent."""

    name: str
    start_bit: int
    bits: int
    signed: bool
    scale: float
    offset: float
    low: float
    high: float
    unit: str
    comment: str
    names: tuple[tuple[int, str], ...]
    """What single values are called."""


@dataclass(frozen=True, slots=True)
class Message:
    """One frame of eight bytes: protection first, then its signals."""

    name: str
    can_id: int
    sender: str
    cycle_ms: int
    """0 for a message that is sent on an event."""
    data_ids: tuple[int, ...]
    """The E2E data id for each value of the counter."""
    comment: str
    signals: tuple[Signal, ...]

    @property
    def on_the_wire(self) -> tuple[object, ...]:
        """Everything that decides which bits it has and what they mean: all but the comments."""
        signals = tuple(replace(signal, comment="") for signal in self.signals)
        return astuple(replace(self, comment="", signals=signals))


def _signal(message: str, dbc: DbcSignal) -> Signal:
    where = f"{message}.{dbc.name}"
    if dbc.byte_order != "little_endian" or dbc.is_float or dbc.multiplexer_ids:
        raise IcdError(f"{where}: allowed are little-endian integers without multiplexing")
    if dbc.minimum is None or dbc.maximum is None:
        raise IcdError(f"{where}: has no range")
    return Signal(
        name=dbc.name,
        start_bit=dbc.start,
        bits=dbc.length,
        signed=dbc.is_signed,
        scale=float(dbc.scale),
        offset=float(dbc.offset),
        low=float(dbc.minimum),
        high=float(dbc.maximum),
        unit=dbc.unit or "",
        comment=dbc.comment or "",
        names=tuple((int(k), str(v)) for k, v in (dbc.choices or {}).items()),
    )


def _data_ids(message: DbcMessage) -> tuple[int, ...]:
    attributes = message.dbc.attributes if message.dbc else {}
    text = str(attributes[DATA_IDS_ATTRIBUTE].value) if DATA_IDS_ATTRIBUTE in attributes else ""
    try:
        ids = bytes.fromhex(text)
    except ValueError:
        ids = b""
    if len(ids) != COUNTER_VALUES:
        raise IcdError(
            f"{message.name}: {DATA_IDS_ATTRIBUTE} is '{text}', allowed are 16 bytes in hexadecimal"
        )
    return tuple(ids)


def _message(dbc: DbcMessage) -> Message:
    if dbc.length != FRAME_BYTES or dbc.is_extended_frame:
        raise IcdError(f"{dbc.name}: allowed are 8 data bytes and an 11-bit identifier")
    if len(dbc.senders) != 1 or dbc.senders[0] not in NODES:
        raise IcdError(f"{dbc.name}: sent by {dbc.senders}, allowed is one of {', '.join(NODES)}")
    protection = {s.name: (s.start, s.length) for s in dbc.signals if s.name in E2E_SIGNALS}
    if protection != E2E_SIGNALS:
        raise IcdError(f"{dbc.name}: must carry e2e_crc at bits 0 to 7, e2e_counter at 8 to 11")
    if dbc.cycle_time is None and dbc.send_type != "event":
        raise IcdError(f"{dbc.name}: neither has a cycle time nor is sent on an event")
    return Message(
        name=dbc.name,
        can_id=dbc.frame_id,
        sender=dbc.senders[0],
        cycle_ms=dbc.cycle_time or 0,
        data_ids=_data_ids(dbc),
        comment=dbc.comment or "",
        signals=tuple(_signal(dbc.name, s) for s in dbc.signals if s.name not in E2E_SIGNALS),
    )


def load_messages(path: Path) -> tuple[Message, ...]:
    """The messages of a DBC file in slot order, each checked to be one that the codec can serve."""
    database = Database(strict=True)
    database.add_dbc_file(path)
    messages = tuple(sorted((_message(m) for m in database.messages), key=lambda m: m.can_id))
    _check_names(messages)
    return messages


def _check_names(messages: tuple[Message, ...]) -> None:
    """Names become those of tables, columns and files: plain words, and no two are the same."""
    names = [message.name for message in messages]
    for message in messages:
        signals = [signal.name for signal in message.signals]
        if bad := [n for n in (message.name, *signals) if not is_plain_name(n)]:
            raise IcdError(
                f"{echoed(message.name)}: a name is '{echoed(bad[0])}', allowed are "
                f"letters, digits and _, {NAME_MAX} at most"
            )
        if names.count(message.name) > 1 or len({*signals}) < len(signals):
            raise IcdError(f"{message.name}: two messages, or two of its signals, have one name")
    if len({message.can_id for message in messages}) < len(messages):
        raise IcdError("two messages have one identifier")


LAYOUT = load_messages(DBC_PATH)
MESSAGES = tuple(message.name for message in LAYOUT)
N_MESSAGES = len(LAYOUT)
VALUE_NAMES = tuple((message.name, signal.name) for message in LAYOUT for signal in message.signals)
N_VALUES = len(VALUE_NAMES)

_SLOTS = {name: number for number, name in enumerate(MESSAGES)}
_INDEXES = {names: number for number, names in enumerate(VALUE_NAMES)}


def slot(message: str) -> int:
    """The number of a message."""
    if message not in _SLOTS:
        raise IcdError(f"{DBC_PATH.name}: no message {message}, it has {', '.join(MESSAGES)}")
    return _SLOTS[message]


def layout(message: str) -> Message:
    """All that the DBC says of a message."""
    return LAYOUT[slot(message)]


def signal_names(message: str) -> tuple[str, ...]:
    """The signals of a message in frame order, without those of its protection."""
    return tuple(signal.name for signal in layout(message).signals)


def signal_range(message: str, signal: str) -> tuple[float, float]:
    """The lowest and the highest value that a signal carries."""
    found = layout(message).signals[signal_names(message).index(signal)]
    return found.low, found.high


def value_index(message: str, signal: str) -> int:
    """Where a signal stands in the flat vector of all values."""
    names = signal_names(message)
    if signal not in names:
        raise IcdError(f"{message}: no signal {signal}, it has {', '.join(names)}")
    return _INDEXES[message, signal]
