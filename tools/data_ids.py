"""Chooses the E2E data ids of a new message: `python -m tools.data_ids NAME` prints its list.

The data id goes into the checksum but not onto the bus, and which one it is follows from the
counter. A wrong bit in the counter therefore changes the checksum twice, and the two changes may
cancel. Lists are chosen so that they never do for one or two wrong bits in a frame: the difference
of two ids must not be one that another wrong bit, or none, would undo. No id is used by two
messages at one counter, so that no frame of one passes as a frame of the other.
"""

import random
import sys
import zlib

from flight_sw.can.crc import shifted, shifted_bytes
from flight_sw.errors import DesignError
from flight_sw.icd import COUNTER_VALUES, DATA_IDS_ATTRIBUTE, FRAME_BYTES, LAYOUT
from flight_sw.runtime import program
from flight_sw.runtime.streams import tell

ATTEMPTS = 1000
ID_VALUES = range(1, 256)
COUNTER_BITS = range(8, 12)
FRAME_BITS = range(8 * FRAME_BYTES)

IdList = tuple[int, ...]


def change_of(bit: int) -> int:
    """What a wrong bit of the frame changes in the checksum or in its comparison."""
    byte, place = divmod(bit, 8)
    if byte == 0:
        return 1 << place
    return shifted_bytes(1 << place, FRAME_BYTES + 1 - byte)


def forbidden_differences(counters: int) -> set[int]:
    """Differences of data ids that two counters with this exclusive or must not have."""
    own = 0
    wrong_bits = [bit for bit in COUNTER_BITS if counters >> (bit - COUNTER_BITS[0]) & 1]
    for bit in wrong_bits:
        own ^= change_of(bit)
    undoing = {own}
    if len(wrong_bits) == 1:
        undoing |= {own ^ change_of(bit) for bit in FRAME_BITS if bit not in COUNTER_BITS}
    return {data_id for data_id in range(256) if shifted(data_id) in undoing}


def choose(name: str, used: tuple[IdList, ...]) -> IdList:
    """A list for message `name` beside those in use; the same arguments give the same list."""
    forbidden = [forbidden_differences(counters) for counters in range(COUNTER_VALUES)]
    dice = random.Random(zlib.crc32(name.encode()))
    for _ in range(ATTEMPTS):
        ids: list[int] = []
        for counter in range(COUNTER_VALUES):
            free = [
                data_id
                for data_id in ID_VALUES
                if data_id not in ids
                and all(data_id != other[counter] for other in used)
                and all(data_id ^ ids[k] not in forbidden[k ^ counter] for k in range(counter))
            ]
            if not free:
                break
            ids.append(dice.choice(free))
        if len(ids) == COUNTER_VALUES:
            return tuple(ids)
    raise DesignError(f"{name}: no list of data ids found beside {len(used)} others")


def main() -> int:
    """Print the attribute's value for each name on the command line."""
    used = [message.data_ids for message in LAYOUT]
    for name in sys.argv[1:]:
        used.append(choose(name, tuple(used)))
        tell(f"{name} {DATA_IDS_ATTRIBUTE} {bytes(used[-1]).hex()}")
    return 0


if __name__ == "__main__":
    sys.exit(program.run("data_ids", main))
