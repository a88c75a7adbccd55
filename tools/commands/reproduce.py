"""`aeroshell reproduce`: a paper's tables and batches beside what is flown here."""

import json
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from tools.reproduce.judged import Progress, Reproduction

app = typer.Typer(help="Fly a paper again and judge the deviations.", no_args_is_help=True)

JsonOption = Annotated[bool, typer.Option("--json", help="print everything as JSON")]
QuickOption = Annotated[
    bool, typer.Option("--quick", help="the tables and a few flights of each batch")
]


def progress_line() -> "Progress":
    """Tells on a terminal what is being flown."""
    from flight_sw.runtime.streams import is_watched
    from tools.console import progress_console

    console = progress_console()

    def tell(text: str) -> None:
        if is_watched():
            console.print(text, highlight=False)

    return tell


def end_with(reproduction: "Reproduction", as_json: bool) -> None:
    """Show it; exit status 1 where a bar was missed."""
    from flight_sw.runtime.streams import tell
    from tools.console import result_console
    from tools.reproduce.show import show

    if as_json:
        tell(json.dumps(reproduction.to_json(), indent=1))
    else:
        show(reproduction, result_console())
    if not reproduction.all_hold:
        raise typer.Exit(1)


@app.callback()
def papers() -> None:
    """A subcommand a paper."""


@app.command()
def mooij(*, as_json: JsonOption = False, quick: QuickOption = False) -> None:
    """Hyperion-1 of [MOOIJ18]: Tables 1, 2 and 5, the batches of Sections IV and V."""
    from tools.reproduce.mooij import reproduce

    end_with(reproduce(quick=quick, progress=progress_line()), as_json)


@app.command()
def yan(*, as_json: JsonOption = False, quick: QuickOption = False) -> None:
    """Mars lander of [YANHE]: nominal flights, Theorem 2, Table 3, noise, and what goes beyond."""
    from tools.reproduce.yan import reproduce

    end_with(reproduce(quick=quick, progress=progress_line()), as_json)


@app.command()
def joshi(*, as_json: JsonOption = False, quick: QuickOption = False) -> None:
    """Reusable launch vehicle of [JOSHI]: five plans, Tables 3 and 4, heat flux."""
    from tools.reproduce.joshi import reproduce

    end_with(reproduce(quick=quick, progress=progress_line()), as_json)


@app.command()
def betts(*, as_json: JsonOption = False, quick: QuickOption = False) -> None:
    """Orbiter of [BETTS10]: maximum crossrange, found with the computer's own motion."""
    from tools.reproduce.betts import reproduce

    end_with(reproduce(quick=quick, progress=progress_line()), as_json)
