"""Reads a file whole: a regular one, of a size that is stated; nothing else is waited for."""

import os
import stat
from pathlib import Path

from flight_sw.errors import RecordingError

BYTES_MAX = 1 << 30  # of a recording or a journal: a week of flight


def read_whole(path: Path, most: int = BYTES_MAX) -> bytes:
    """The content of a file; refused in one sentence if it is none, too large or unreadable."""
    try:
        # Without O_NONBLOCK the opening of a pipe waits for its writer.
        with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            about = os.fstat(file.fileno())
            if not stat.S_ISREG(about.st_mode):
                raise RecordingError(f"{path}: is neither a file nor a folder")
            if about.st_size > most:
                raise RecordingError(f"{path}: has {about.st_size:,} bytes, allowed are {most:,}")
            return file.read(most)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read, {error.strerror}") from error
    except ValueError as error:
        raise RecordingError(f"{path!s}: is no name of a file") from error
