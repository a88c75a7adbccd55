"""Says on a terminal what takes its time."""

from typing import Self

from flight_sw.runtime.streams import is_watched
from tools.console import progress_console


class StatusLine:
    """A line that says what is done now, gone when it is done; nothing where stderr is a file."""

    def __enter__(self) -> Self:
        self._status = progress_console().status("") if is_watched() else None
        if self._status:
            self._status.start()
        return self

    def __call__(self, text: str) -> None:
        """Show what is done now."""
        if self._status:
            self._status.update(text)

    def __exit__(self, *_: object) -> None:
        if self._status:
            self._status.stop()
