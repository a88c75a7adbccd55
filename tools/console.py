"""Rich's consoles: tables of results on stdout, progress on stderr."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console, RenderableType


def result_console() -> "Console":
    """Where tables of a result go."""
    from rich.console import Console

    return Console()


def progress_console() -> "Console":
    """Where progress is shown to whoever looks on."""
    from rich.console import Console

    return Console(stderr=True)


def show(table: "RenderableType") -> None:
    """Print a table of a result."""
    result_console().print(table)
