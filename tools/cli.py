"""`aeroshell`: one verb an action, one file a verb. Results to stdout, everything else to stderr.

Exit status: 0 done, 1 refused, 2 wrong usage, 130 interrupted.
"""

import atexit
import gc
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    import typer

ALONE = ("fly", "campaign", "missions", "gains", "plan", "info", "export", "replay", "review",
         "report", "timing")  # fmt: skip
GROUPS = ("bench", "bus", "reproduce")


def application() -> "typer.Typer":
    """All commands; imported here, so that what fails in an import is told in a sentence too."""
    from importlib import import_module

    import typer

    app = typer.Typer(
        help="Atmospheric-entry guidance computer and the bench it is tested on.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    for name in ALONE:
        app.command()(getattr(import_module(f"tools.commands.{name}"), name))
    for name in GROUPS:
        app.add_typer(import_module(f"tools.commands.{name}").app, name=name)
    return app


def _end(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def leave_out_working_folder() -> None:
    """Import nothing from the folder that one works in, unless these packages themselves lie there.

    An empty place in PYTHONPATH means that folder: it may hold a flight_sw of its own.
    """
    home = Path(__file__).resolve().parents[1]
    try:
        here = Path.cwd().resolve()
    except OSError:
        here = None
    if here != home:
        sys.path[:] = [place for place in sys.path if place and Path(place).resolve() != here]


def main(arguments: list[str] | None = None) -> int:
    """Run one command and return its exit status; a refusal is one sentence on stderr."""
    leave_out_working_folder()
    from flight_sw.runtime import program

    signal.signal(signal.SIGTERM, _end)
    # At its end the interpreter searches all that is left for cycles: 0.6 s for 200,000 objects.
    atexit.register(gc.freeze)

    def command() -> int:
        program.check_arguments(sys.argv[1:] if arguments is None else arguments)
        application()(args=arguments, standalone_mode=True)
        return program.DONE

    return program.run("aeroshell", command)


if __name__ == "__main__":
    sys.exit(main())
