"""What a hub keeps of all that it moves: a ring that its thread writes and another reads."""

import numpy as np

from flight_sw.can.sockets import copy_frame
from flight_sw.records.types_ import Frames, Record
from sim_harness.fence import memory_fence
from sim_harness.jit import kernel

RING_FRAMES = 1 << 18  # half a minute of a full bus: nobody takes them while the loop compiles
RING_MASK = RING_FRAMES - 1

HUB_LOG = np.dtype(
    [
        ("claimed", "i8"),  # frames whose places are being written, or have been
        ("kept", "i8"),  # frames that have been written
        ("taken", "i8"),  # frames that the reader has done with
    ],
    align=True,
)
"""Where writer and reader stand, in frames ever kept."""


@kernel
def keep(hub_log: Record, ring: Frames, frames: Frames, n: int) -> None:
    """Keep frames, on behalf of the hub; a ring without room for any keeps none."""
    if len(ring) == 0:
        return
    hub_log["claimed"] += n
    memory_fence()
    for i in range(n):
        copy_frame(frames[i], ring[(hub_log["kept"] + i) & RING_MASK])
    memory_fence()
    hub_log["kept"] += n
