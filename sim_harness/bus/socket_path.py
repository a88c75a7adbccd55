"""Where the socket of a bus of one's own lies: in a folder of its own, whose path is short enough.

A socket's path has at most 107 bytes; the folder for temporary files may be longer than that.
"""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from flight_sw.can.address import UNIX_PATH_MAX_BYTES
from flight_sw.errors import BusError

NAME = "bus"
PREFIX = "aeroshell-"
UNIQUE_BYTES = len("/" + PREFIX) + 8 + len("/" + NAME)  # what comes behind the folder's own path
SHORT_PLACES = ("/run/user/{user}", "/tmp", "/var/tmp", "/dev/shm")


def places() -> list[str]:
    """Folders for temporary files that leave room for a socket's name, the usual one first."""
    usual = [tempfile.gettempdir(), *(place.format(user=os.getuid()) for place in SHORT_PLACES)]
    return [
        place for place in usual if len(os.fsencode(place)) + UNIQUE_BYTES <= UNIX_PATH_MAX_BYTES
    ]


@contextmanager
def socket_path() -> Iterator[Path]:
    """A path for a socket, in a folder that goes when the block ends."""
    for place in places():
        try:
            made = tempfile.TemporaryDirectory(prefix=PREFIX, dir=place, ignore_cleanup_errors=True)
        except OSError:
            continue
        with made as folder:
            yield Path(folder) / NAME
            return
    usual = tempfile.gettempdir()
    raise BusError(
        f"TMPDIR {usual}: path of {len(os.fsencode(usual))} bytes, a socket in it has room for "
        f"{UNIX_PATH_MAX_BYTES - UNIQUE_BYTES}, and no shorter folder can be written"
    )
