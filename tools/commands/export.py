"""`aeroshell export`: a recording as tables for other programs."""

from pathlib import Path
from typing import Annotated

import typer

from flight_sw.runtime.streams import say, tell


def export(
    flight: Annotated[Path, typer.Argument(help="a recording: flight.mcap, or its folder")],
    form: Annotated[str, typer.Option("--format", help="parquet or csv")] = "parquet",
    out: Annotated[Path | None, typer.Option(help="folder [default: beside the recording]")] = None,
    force: Annotated[bool, typer.Option("--force", help="replace files in --out")] = False,
) -> None:
    """Write every CAN message, the truth, the log and the raw frames as a table each."""
    from flight_sw.errors import RecordingError
    from sim_harness.telemetry.reader import open_recording
    from tools.flight_tables import export as write

    recording = open_recording(flight)
    folder = out or recording.path.with_name(f"{recording.path.stem}-{form}")
    written = write(recording, form, folder, force=force)
    if not recording.is_complete:
        say(f"{flight}: incomplete, exported is the flight until {recording.until_s:z.2f} s")
    for path in written:
        tell(path)
    recording.check_whole()
    if recording.dbc_failure:
        raise RecordingError(f"{recording.dbc_failure}; no message is exported")
