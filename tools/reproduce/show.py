"""A reproduction on a terminal: a table a part, what its deviations come from, the verdict last."""

from rich import box
from rich.console import Console
from rich.table import Table

from tools.console import print_whole
from tools.reproduce.judged import Reproduction, Row

HOLDS = {True: "yes", False: "NO", None: ""}


FINE_DECIMALS = 3  # of a paper's number: from there on ours is shown with as many


def _here(row: Row) -> str:
    if row.here is None:
        return ""
    decimals = len(row.paper.partition(".")[2]) if row.paper[:1].isdigit() else 0
    if decimals >= FINE_DECIMALS and row.paper[-1].isdigit():
        return f"{row.here:z,.{decimals}f}"
    return f"{row.here:z,.1f}" if abs(row.here) >= 100.0 else f"{row.here:z,.3g}"


def show(reproduction: Reproduction, console: Console) -> None:
    """Print every part; the last line is the verdict."""
    for part in reproduction.parts:
        table = Table(title=part.title, title_justify="left", box=box.SIMPLE_HEAD)
        table.add_column("quantity", no_wrap=True)
        for name in ("paper", "here", "deviation"):
            table.add_column(name, justify="right", no_wrap=True)
        table.add_column("bar", no_wrap=True)
        table.add_column("holds")
        for row in part.rows:
            style = "red" if row.holds is False else None
            unit = f", {row.unit}" if row.unit else ""
            table.add_row(
                row.quantity + unit, row.paper, _here(row), row.deviation, row.bar,
                HOLDS[row.holds], style=style,
            )  # fmt: skip
        print_whole(console, table)
        console.print(part.attribution, highlight=False)
        console.print()
    console.print(reproduction.verdict, highlight=False)
