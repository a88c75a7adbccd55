"""Chosen data ids find every one and two wrong bits, checked with a checksum made bit by bit."""

from itertools import combinations

import pytest

from flight_sw import icd
from flight_sw.errors import DesignError
from tests.flight_sw.bus_twin import crc8
from tools.data_ids import choose

USED = tuple(message.data_ids for message in icd.LAYOUT)


def passing(ids: tuple[int, ...], payload: int) -> bool:
    data = payload.to_bytes(8, "little")
    return data[0] == crc8(data[1:] + bytes([ids[data[1] & 0xF]]))


def protected(ids: tuple[int, ...], counter: int) -> int:
    data = bytes([counter]) + b"\x12\x34\x56\x78\x9a\xbc"
    return int.from_bytes(bytes([crc8(data + bytes([ids[counter]]))]) + data, "little")


@pytest.mark.parametrize("counter", [0, 5, 15])
def test_a_chosen_list_finds_every_one_and_two_wrong_bits(counter: int) -> None:
    ids = choose("NEW_MESSAGE", USED)
    frame = protected(ids, counter)
    assert passing(ids, frame)
    masks = [1 << bit for bit in range(64)]
    masks += [a | b for a, b in combinations(masks, 2)]
    assert not any(passing(ids, frame ^ mask) for mask in masks)


def test_a_chosen_list_shares_no_id_with_another_message_at_one_counter() -> None:
    first = choose("A", USED)
    second = choose("B", (*USED, first))
    for ids in (*USED, second):
        assert all(a != b for a, b in zip(first, ids, strict=True))


def test_the_same_name_gets_the_same_list() -> None:
    assert choose("A", USED) == choose("A", USED) != choose("B", USED)


def test_a_full_set_of_lists_is_refused() -> None:
    full = tuple((data_id,) * 16 for data_id in range(1, 256))
    with pytest.raises(DesignError, match="NEW: no list of data ids found beside 255 others"):
        choose("NEW", full)
