"""Rich's consoles: tables of results on stdout, progress on stderr."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

WIDTH_MAX = 400  # columns; a terminal narrower than a table wraps its lines: no figure is cut


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


def print_whole(console: "Console", table: "Table") -> None:
    """Print a table as wide as its contents are, whatever the terminal's width."""
    from rich.measure import Measurement

    own = console.width
    options = console.options.update(max_width=WIDTH_MAX)
    console.width = max(own, Measurement.get(console, options, table).maximum)
    console.print(table, soft_wrap=True)
    console.width = own
