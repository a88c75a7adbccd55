"""`python -m tools.foreign_traffic BUS`: frames of strangers at the full rate of a bus.

Frame k is due at start + k intervals, whatever happened before. It runs until its standard input
ends, then prints how many frames it sent and at what rate.
"""

import json
import sys
import threading
import time

import numpy as np

from flight_sw import icd
from flight_sw.can.address import open_bus
from flight_sw.can.libc import monotonic_ns, sleep_until_ns
from flight_sw.can.sockets import BATCH, new_io, send_frames
from flight_sw.records.dictionary import FRAME
from flight_sw.records.types_ import Frames
from flight_sw.runtime import program
from flight_sw.runtime.streams import say, tell
from sim_harness.jit import kernel

FULL_RATE_HZ = 7400.0  # frames of 8 bytes on a bus of 1 Mbit/s
SLICE_NS = 50_000_000
FIRST_ID, LAST_ID = 0x100, 0x7FF


def foreign_identifiers() -> list[int]:
    """Standard identifiers that nobody on our bus knows."""
    ours = {message.can_id for message in icd.LAYOUT}
    return [number for number in range(FIRST_ID, LAST_ID + 1) if number not in ours]


def foreign_frames(n: int) -> Frames:
    """Frames of eight bytes with such identifiers, always the same ones."""
    frames = np.zeros(n, FRAME)
    random = np.random.default_rng(1)
    frames["can_id"] = random.choice(foreign_identifiers(), n)
    frames["dlc"] = 8
    frames["data"] = random.integers(0, 2**64, n, dtype=np.uint64)
    return frames


@kernel
def send_on_time(
    fd: int, io: Frames, frames: Frames, start_ns: int, interval_ns: int, sent: int
) -> int:
    """Send what becomes due within a slice; the total sent so far, below 0 if the bus is lost."""
    end_ns = monotonic_ns() + SLICE_NS
    while monotonic_ns() < end_ns:
        due = (monotonic_ns() - start_ns) // interval_ns + 1 - sent
        if due <= 0:
            sleep_until_ns(start_ns + sent * interval_ns)
            continue
        moved = send_frames(fd, io[0], frames, min(due, len(frames)))
        if moved < 0:
            return -1
        sent += moved
    return sent


def _wait_for_end(over: threading.Event) -> None:
    if sys.stdin is not None:  # closed: it has ended
        sys.stdin.read()
    over.set()


def main(address: str) -> int:
    """Send until standard input ends; prints one JSON object."""
    over = threading.Event()
    threading.Thread(target=_wait_for_end, args=(over,), daemon=True).start()
    frames, io, interval_ns = foreign_frames(BATCH), new_io(), round(1e9 / FULL_RATE_HZ)
    with open_bus(address) as bus:
        bus.setblocking(False)
        send_on_time(bus.fileno(), io, frames[:0], time.monotonic_ns(), SLICE_NS * 10, 1)
        tell("sending")
        sent, start_ns = 0, time.monotonic_ns()
        while not over.is_set() and sent >= 0:
            sent = send_on_time(bus.fileno(), io, frames, start_ns, interval_ns, sent)
        seconds = (time.monotonic_ns() - start_ns) / 1e9
    tell(json.dumps({"frames": sent, "rate_hz": sent / seconds}))
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        say("usage: python -m tools.foreign_traffic BUS")
        sys.exit(2)
    sys.exit(program.run("foreign_traffic", lambda: main(sys.argv[1])))
