"""Error frames as linux/can/error.h lays them out, counted the same compiled and uncompiled."""

import numpy as np
import pytest

from flight_sw.can.error_frames import ERRORS, NO_ERRORS, account_of, note_error
from sim_harness.flight.error_watch import ErrorWatch

FLAG = 0x20000000
NO_DATA = bytes(8)


def word(data: bytes) -> np.uint64:
    return np.uint64(int.from_bytes(data, "little"))


@pytest.mark.parametrize(
    ("classes", "data", "words"),
    [
        (0x001, NO_DATA, ("sending timed out",)),
        (0x002, NO_DATA, ("arbitration lost",)),
        (0x008, NO_DATA, ("protocol violated",)),
        (0x010, NO_DATA, ("transceiver",)),
        (0x020, NO_DATA, ("no acknowledgement",)),
        (0x040, NO_DATA, ("bus off",)),
        (0x080, NO_DATA, ("bus error",)),
        (0x100, NO_DATA, ("controller restarted",)),
        (0x004, bytes((0, 0x01)) + bytes(6), ("receive buffer overflowed",)),
        (0x004, bytes((0, 0x02)) + bytes(6), ("send buffer overflowed",)),
        (0x004, bytes((0, 0x04)) + bytes(6), ("warning level reached receiving",)),
        (0x004, bytes((0, 0x08)) + bytes(6), ("warning level reached sending",)),
        (0x004, bytes((0, 0x10)) + bytes(6), ("error passive receiving",)),
        (0x004, bytes((0, 0x20)) + bytes(6), ("error passive sending",)),
        (0x004, bytes((0, 0x40)) + bytes(6), ("error active again",)),
        (0x040 | 0x004, bytes((0, 0x28)) + bytes(6),
         ("bus off", "warning level reached sending", "error passive sending")),
        (0x020, bytes((0, 0x01)) + bytes(6), ("no acknowledgement",)),  # not of the controller
        (0x200, NO_DATA, ("of no known class",)),
    ],
)  # fmt: skip
def test_every_class_has_its_words(classes: int, data: bytes, words: tuple[str, ...]) -> None:
    errors = np.zeros(1, ERRORS)
    note_error(errors[0], np.uint32(FLAG | classes), word(data))
    assert account_of(errors[0]).words == words
    assert NO_ERRORS.plus(FLAG | classes, data) == account_of(errors[0])


def test_both_accounts_agree_over_many_frames() -> None:
    rng = np.random.default_rng(1)
    errors, account = np.zeros(1, ERRORS), NO_ERRORS
    for _ in range(200):
        can_id, data = FLAG | int(rng.integers(0, 0x400)), rng.bytes(8)
        note_error(errors[0], np.uint32(can_id), word(data))
        account = account.plus(can_id, data)
        assert account_of(errors[0]) == account
    assert account.frames == 200 and 0 < account.bus_off < 200


def test_the_text_names_counts_classes_and_counters() -> None:
    data = bytes((0, 0, 0, 0, 0, 0, 255, 7))
    account = NO_ERRORS.plus(FLAG | 0x60, data)
    assert account.text == (
        "1 error frame: bus off, no acknowledgement; counters 255 sending, 7 receiving"
    )
    assert NO_ERRORS.text == "0 error frames; counters 0 sending, 0 receiving"


def test_a_flight_tells_each_kind_once_and_bus_off_ever_more_rarely() -> None:
    watch, account, told = ErrorWatch(), NO_ERRORS, []
    assert watch.look(account) == ""
    for classes in (0x20, 0x20, 0x80, *[0x40] * 20):
        account = account.plus(FLAG | classes, NO_DATA)
        if watch.look(account):
            told.append((account.frames, account.bus_off))
    assert told == [(1, 0), (3, 0), (4, 1), (5, 2), (7, 4), (11, 8), (19, 16)]
