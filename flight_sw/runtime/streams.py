"""The standard streams of a program of ours: what they cannot take is never raised.

Nobody may be there to be told: descriptors are closed, disks full, readers gone or asleep. None of
it is a reason to end a flight. Lines for whoever looks on (`say`, stderr) are then lost. Of lines
of a result (`tell`, stdout) the first failure is kept, for the program's end to tell; nothing is
written after it, so that a result has no hole. Everything is written at once: nothing waits in a
buffer that the end of the process would have to empty.

This is the only module that writes to them; a test holds the others to it.
"""

import contextlib
import errno
import io
import os
import select
import sys
from collections.abc import Iterator
from typing import Any, TextIO

STANDARD = ("stdin", "stdout", "stderr")  # by descriptor
PATIENCE_S = 0.1  # for a reader of stderr that does not read; then its lines are lost
PIECE_BYTES = 4096  # PIPE_BUF: what a pipe that is ready takes without blocking
ENCODING = "utf-8"


def _bytes_of(text: str, encoding: str) -> bytes:
    """Names of files as the bytes that they are; a character that is lacking as its number."""
    try:
        return text.encode(encoding, "surrogateescape")
    except UnicodeEncodeError:
        return text.encode(encoding, "backslashreplace")
    except LookupError:
        return text.encode(ENCODING, "backslashreplace")


class Stream(io.TextIOBase):
    """A standard stream that raises nothing; `failure` is the first error of writing."""

    def __init__(self, name: str, under: TextIO | None) -> None:
        self._under = under
        self._is_result = name == "stdout"
        self._is_stuck = False
        # The interpreter's own stream is left out: it keeps what it could not write, and fails
        # with it again when the process ends.
        self._fd = STANDARD.index(name) if under is getattr(sys, f"__{name}__") else None
        self.failure: OSError | None = None

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """That of the stream below."""
        return getattr(self._under, "encoding", None) or ENCODING

    @property
    def reader_is_gone(self) -> bool:
        """Whether whoever read it has had enough."""
        return self.failure is not None and self.failure.errno == errno.EPIPE

    def write(self, text: str) -> int:
        """Write what can be written; says that all was."""
        if self._is_result and self.failure is not None:
            return len(text)
        try:
            if self._under is None:
                raise OSError(errno.EBADF, "it is closed")
            if self._fd is None:
                self._under.write(text)
                self._under.flush()
            else:
                self._write(memoryview(_bytes_of(text, self.encoding)))
        except OSError as error:
            self.failure = self.failure or error
        except ValueError:  # a stream of somebody else's, closed; or of fewer characters
            self.failure = self.failure or OSError(errno.EBADF, "it is closed")
        return len(text)

    def _write(self, content: memoryview) -> None:
        assert self._fd is not None
        while content and self._is_ready():
            with contextlib.suppress(BlockingIOError):
                content = content[os.write(self._fd, content[:PIECE_BYTES]) :]

    def _is_ready(self) -> bool:
        """Wait for the reader: of a result as long as it takes, of other lines hardly."""
        poll = select.poll()
        poll.register(self._fd or 0, select.POLLOUT)
        patience_ms = None if self._is_result else 0 if self._is_stuck else PATIENCE_S * 1e3
        self._is_stuck = not poll.poll(patience_ms)
        return not self._is_stuck

    def flush(self) -> None:
        """Nothing waits here."""

    def writable(self) -> bool:
        """It takes everything."""
        return True

    def isatty(self) -> bool:
        """Whether somebody looks on at a terminal."""
        try:
            return self._under is not None and self._under.isatty()
        except ValueError:
            return False

    def fileno(self) -> int:
        """The descriptor, where there is one."""
        if self._fd is None:
            raise io.UnsupportedOperation("fileno")
        return self._fd


def _fill_closed() -> None:
    """Open what the caller closed: or the next file opened would be taken for a standard stream."""
    for fd in range(len(STANDARD)):
        try:
            os.fstat(fd)
        except OSError:
            with contextlib.suppress(OSError):
                os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


@contextlib.contextmanager
def standard_streams() -> Iterator[tuple[Stream, Stream]]:
    """Have whoever writes to stdout and stderr, libraries too, write to streams like these."""
    _fill_closed()
    before = sys.stdout, sys.stderr
    out, err = Stream("stdout", sys.stdout), Stream("stderr", sys.stderr)
    sys.stdout, sys.stderr = out, err
    try:
        yield out, err
    finally:
        sys.stdout, sys.stderr = before


def _guarded(name: str) -> Any:
    stream = getattr(sys, name)
    is_plain = stream is None or stream is getattr(sys, f"__{name}__")
    return Stream(name, stream) if is_plain else stream


def say(text: str) -> None:
    """A line for whoever looks on, to stderr."""
    with contextlib.suppress(OSError, ValueError):
        _guarded("stderr").write(f"{text}\n")


def tell(text: object) -> None:
    """A line of a result, to stdout."""
    with contextlib.suppress(OSError, ValueError):
        _guarded("stdout").write(f"{text}\n")


def is_watched() -> bool:
    """Whether stderr is a terminal, where progress is shown."""
    return Stream("stderr", sys.stderr).isatty()


def is_heard() -> bool:
    """Whether stdout still has a reader: nothing endless goes on without one."""
    stream = sys.stdout
    if not isinstance(stream, Stream):
        return True
    try:
        fd = stream.fileno()
    except OSError:  # somebody else's stream
        return stream.failure is None
    poll = select.poll()
    poll.register(fd, 0)
    return stream.failure is None and not poll.poll(0)
