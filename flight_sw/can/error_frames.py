"""What a CAN interface tells of itself: error frames, counted by class, and their words.

Linux's SocketCAN hands them up as frames with the error flag; their classes are bits of the
identifier, the controller's state is data byte 1, its error counters are bytes 6 and 7
(linux/can/error.h). A virtual interface and a hub make none themselves; anyone on them may send
one, so that nothing but an account comes of it.
"""

from typing import Any, NamedTuple

import numpy as np

from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

BUS_OFF = 0x40
CONTROLLER = 0x04
CLASSES = {
    BUS_OFF: "bus off",
    0x001: "sending timed out",
    0x002: "arbitration lost",
    0x008: "protocol violated",
    0x010: "transceiver",
    0x020: "no acknowledgement",
    0x080: "bus error",
    0x100: "controller restarted",
}
CONTROLLER_STATES = {
    0x01: "receive buffer overflowed",
    0x02: "send buffer overflowed",
    0x04: "warning level reached receiving",
    0x08: "warning level reached sending",
    0x10: "error passive receiving",
    0x20: "error passive sending",
    0x40: "error active again",
}
CLASS_MASK = 0x1FFFFFFF
CLASS_BITS = np.uint32(CLASS_MASK)
STATE_AT, TRANSMIT_AT, RECEIVE_AT = 8, 48, 56  # bits of the data
BYTE = 0xFF

ERRORS = np.dtype(
    [
        ("frames", "i8"),
        ("bus_off", "i8"),  # of these
        ("classes", "u4"),  # every class told so far
        ("states", "u4"),  # every state of the controller told so far
        ("counters", "u1", (2,)),  # of the controller, sending and receiving, as last told
    ],
    align=True,
)


@kernel
def note_error(errors: Record, can_id: np.uint32, word: np.uint64) -> None:
    """Count one error frame."""
    classes = can_id & CLASS_BITS
    errors["frames"] += 1
    errors["bus_off"] += (classes & BUS_OFF) != 0
    errors["classes"] |= classes
    if classes & CONTROLLER != 0:
        errors["states"] |= np.uint32((word >> np.uint64(STATE_AT)) & np.uint64(BYTE))
    errors["counters"][0] = np.uint8((word >> np.uint64(TRANSMIT_AT)) & np.uint64(BYTE))
    errors["counters"][1] = np.uint8((word >> np.uint64(RECEIVE_AT)) & np.uint64(BYTE))


class Account(NamedTuple):
    """An account of error frames, outside compiled code."""

    frames: int = 0
    bus_off: int = 0
    classes: int = 0
    states: int = 0
    counters: tuple[int, int] = (0, 0)

    def plus(self, can_id: int, data: bytes) -> "Account":
        """With one more frame."""
        classes = can_id & CLASS_MASK
        return Account(
            self.frames + 1,
            self.bus_off + bool(classes & BUS_OFF),
            self.classes | classes,
            self.states | (data[1] if classes & CONTROLLER else 0),
            (data[6], data[7]),
        )

    @property
    def words(self) -> tuple[str, ...]:
        """What was told, the gravest first."""
        found = [text for bit, text in CLASSES.items() if self.classes & bit]
        found += [text for bit, text in CONTROLLER_STATES.items() if self.states & bit]
        return tuple(found) or (("of no known class",) if self.frames else ())

    @property
    def text(self) -> str:
        """The account in words."""
        noun = "error frame" if self.frames == 1 else "error frames"
        sending, receiving = self.counters
        told = f": {', '.join(self.words)}" if self.frames else ""
        return f"{self.frames:,} {noun}{told}; counters {sending} sending, {receiving} receiving"


NO_ERRORS = Account()


def account_of(errors: Any) -> Account:
    """A compiled account, one record of ERRORS."""
    return Account(
        int(errors["frames"]),
        int(errors["bus_off"]),
        int(errors["classes"]),
        int(errors["states"]),
        (int(errors["counters"][0]), int(errors["counters"][1])),
    )
