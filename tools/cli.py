"""`aeroshell`: one verb an action, one file a verb. Results to stdout, everything else to stderr.

Exit status: 0 done, 1 refused, 2 wrong usage, 130 interrupted.
"""

import signal
import sys
from types import FrameType
from typing import NoReturn

import typer

from flight_sw import program
from tools.commands import (
    bench,
    bus,
    campaign,
    export,
    fly,
    gains,
    info,
    missions,
    replay,
    report,
    reproduce,
    review,
    timing,
)

app = typer.Typer(
    help="Atmospheric-entry guidance computer and the bench it is tested on.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command()(fly.fly)
app.command()(campaign.campaign)
app.command()(missions.missions)
app.command()(gains.gains)
app.command()(info.info)
app.command()(export.export)
app.command()(replay.replay)
app.command()(review.review)
app.command()(report.report)
app.command()(timing.timing)
app.add_typer(bench.app, name="bench")
app.add_typer(bus.app, name="bus")
app.add_typer(reproduce.app, name="reproduce")


def _end(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def main(arguments: list[str] | None = None) -> int:
    """Run one command and return its exit status; a refusal is one sentence on stderr."""
    signal.signal(signal.SIGTERM, _end)

    def command() -> int:
        program.check_arguments(sys.argv[1:] if arguments is None else arguments)
        app(args=arguments, standalone_mode=True)
        return program.DONE

    return program.run("aeroshell", command)


if __name__ == "__main__":
    sys.exit(main())
