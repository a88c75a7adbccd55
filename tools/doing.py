"""Says on a terminal what takes its time."""

import sys
from typing import Self


class Doing:
    """A line that says what is done now, gone when it is done; nothing where stderr is a file."""

    def __enter__(self) -> Self:
        from rich.console import Console

        self._status = Console(stderr=True).status("") if sys.stderr.isatty() else None
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
