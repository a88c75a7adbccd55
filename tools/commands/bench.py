"""`aeroshell bench`: what this machine reaches."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flight_sw.runtime.streams import say, tell

if TYPE_CHECKING:
    from tools.latency import Latency

BEGIN, END = "<!-- latency: begin -->", "<!-- latency: end -->"
SECONDS_MIN, SECONDS_MAX = 1.0, 180.0

app = typer.Typer(help="Measurements of this machine.", no_args_is_help=True)


@app.callback()
def _group() -> None:
    """Measurements of this machine."""


@app.command()
def latency(
    seconds: Annotated[
        float, typer.Option(min=SECONDS_MIN, max=SECONDS_MAX, help="length of each measurement")
    ] = 10.0,
    bus: Annotated[
        list[str] | None, typer.Option(help="memory, unix or socketcan:INTERFACE [default: all]")
    ] = None,
    rows: Annotated[
        Path | None, typer.Option(help="what --json printed elsewhere: its rows follow ours")
    ] = None,
    readme: Annotated[
        Path | None, typer.Option(help="put the table between this file's two markers")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print one JSON object")] = False,
) -> None:
    """Round trip from the navigation set sent to its command complete, idle and on a full bus."""
    from tools.latency import measure

    if readme is not None:
        replaced(readme, "")  # refused before anything is measured
    elsewhere = rows_in(rows) if rows is not None else []
    found = []
    for row in measure(seconds, bus):
        found.append(row)
        say(f"{row.bus}, {row.traffic}: {row.sets} sets")
    found += elsewhere
    if as_json:
        tell(json.dumps(as_object(found, seconds), indent=1))
    else:
        tell(table(found))
    if readme is not None:
        readme.write_text(replaced(readme, table(found)), encoding="utf-8")


def as_object(found: "list[Latency]", seconds: float) -> dict[str, Any]:
    """What `--json` prints."""
    return {"seconds": seconds, "rows": [row._asdict() for row in found]}


def rows_in(path: Path) -> "list[Latency]":
    """The rows of a file with `--json`'s object."""
    from flight_sw.errors import AeroshellError
    from sim_harness.mission.documents import read_json
    from tools.latency import Latency

    found = read_json(path, AeroshellError)
    try:
        return [Latency(**row) for row in found["rows"]]
    except (ValueError, KeyError, TypeError) as error:
        raise AeroshellError(f"--rows {path}: is not what --json prints") from error


def table(found: "list[Latency]") -> str:
    """The rows as Markdown."""
    from tools.flight_timing import PERCENTILES

    lines = [
        "| bus | foreign traffic | " + " | ".join(f"{p} us" for p in PERCENTILES.values())
        + " | sets | late |",
        "| --- | --- |" + " ---: |" * (len(PERCENTILES) + 2),
    ]  # fmt: skip
    for row in found:
        traffic = f"{row.foreign_rate_hz:z,.0f} frames/s" if row.foreign_rate_hz else "none"
        cells = [f"{row.round_trip_us[key]:z,.1f}" for key in PERCENTILES]
        cells += [f"{row.sets:,}", f"{row.late_commands:,}"]
        lines.append(f"| {row.bus} | {traffic} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def replaced(readme: Path, text: str) -> str:
    """The file's text with `text` between the markers."""
    from flight_sw.errors import AeroshellError

    try:
        before = readme.read_text(encoding="utf-8")
    except OSError as error:
        raise AeroshellError(f"--readme {readme}: cannot be read, {error.strerror}") from error
    head, begin, rest = before.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not begin or not end:
        raise AeroshellError(f"--readme {readme}: has no lines '{BEGIN}' and '{END}'")
    return f"{head}{BEGIN}\n\n{text}\n\n{END}{tail}"
