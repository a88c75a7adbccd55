"""Worst-case load of a CAN bus that carries every periodic message of the DBC.

A classical frame with an 11-bit identifier and n data bytes takes 47 + 8n bits, and bit stuffing
adds at most one bit after the first four of every four that are stuffed: floor((34 + 8n - 1) / 4).
Together 55 + 10n, the three bits between frames included [DAVIS07].

Limits: messages that are sent on an event are listed but add nothing; error frames are left out.
"""

from dataclasses import dataclass

from flight_sw.icd import FRAME_BYTES, LAYOUT, Message

BITS_OF_FRAME = 55  # identifier, control, checksum, end and their stuffing
BITS_OF_BYTE = 10  # eight and their stuffing
BITRATE_BPS = 1_000_000
LOAD_LIMIT = 0.5  # of the bus, kept free for other traffic and for retransmission
MS_PER_S = 1000.0


@dataclass(frozen=True, slots=True)
class MessageLoad:
    """What one message takes of the bus."""

    message: str
    can_id: int
    sender: str
    cycle_ms: int
    frame_bits: int
    load_ratio: float


@dataclass(frozen=True, slots=True)
class BusLoad:
    """What all messages take of the bus together."""

    bitrate_bps: int
    messages: tuple[MessageLoad, ...]

    @property
    def total_ratio(self) -> float:
        """Share of the bus in use."""
        return sum(message.load_ratio for message in self.messages)

    @property
    def is_within_limit(self) -> bool:
        """Whether the bus has the reserve that it must have."""
        return self.total_ratio < LOAD_LIMIT


def worst_frame_bits(data_bytes: int) -> int:
    """Longest possible frame with that many data bytes, pause included."""
    return BITS_OF_FRAME + BITS_OF_BYTE * data_bytes


def bus_load(bitrate_bps: int = BITRATE_BPS, messages: tuple[Message, ...] = LAYOUT) -> BusLoad:
    """The load of these messages, each at its cycle time."""
    bits = worst_frame_bits(FRAME_BYTES)
    rows = []
    for message in messages:
        rate_hz = MS_PER_S / message.cycle_ms if message.cycle_ms else 0.0
        rows.append(
            MessageLoad(
                message=message.name,
                can_id=message.can_id,
                sender=message.sender,
                cycle_ms=message.cycle_ms,
                frame_bits=bits,
                load_ratio=bits * rate_hz / bitrate_bps,
            )
        )
    return BusLoad(bitrate_bps, tuple(rows))
