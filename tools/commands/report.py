"""`aeroshell report`: campaigns as one file of HTML for a review board."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

from flight_sw.runtime.streams import tell

COMPARISON = Path("comparison.html")


def report(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="folders of campaigns; several are compared"),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="file to write [default: DIR/report.html; of several comparison.html]"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="replace a file that exists")] = False,
) -> None:
    """Write what campaigns show as one file: verdicts, corridor, distributions, worst cases."""
    from tools.report.page import REPORT, write_report
    from tools.report.source import ReportError
    from tools.status_line import StatusLine

    path = out or (folders[0] / REPORT if len(folders) == 1 else COMPARISON)
    if path.suffix != ".html":
        raise ReportError(f"--out {path}: allowed is a name that ends in .html")
    if path.exists() and not force:
        raise ReportError(f"--out {path}: exists already, --force replaces it")
    if out and not path.parent.is_dir():
        raise ReportError(f"--out {path}: there is no folder {path.parent}")
    with StatusLine() as status_line:
        write_report(folders, path, command_of(folders, out), status_line)
    tell(path)


def command_of(folders: list[Path], out: Path | None) -> str:
    """The command that writes this report."""
    words = ["aeroshell", "report", *(str(folder) for folder in folders)]
    words += ["--out", str(out)] if out else []
    return shlex.join(words)
