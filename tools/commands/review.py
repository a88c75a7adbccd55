"""`aeroshell review`: recorded flights as an entry engineer looks at them, in Rerun."""

import contextlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flight_sw.runtime.streams import say, tell

if TYPE_CHECKING:
    from tools.review.source import FlightData
    from tools.review.stage import Stage


def review(
    flights: Annotated[
        list[Path], typer.Argument(help="recordings, or folders with a flight.mcap; laid over")
    ],
    save: Annotated[
        Path | None, typer.Option(help="write the review to this .rrd instead of showing it")
    ] = None,
    screenshot: Annotated[
        Path | None, typer.Option(help="draw the review to this .png, without a window")
    ] = None,
    at_s: Annotated[
        float | None, typer.Option("--at", help="mission time in s drawn [default: peak heat flux]")
    ] = None,
    tab: Annotated[
        str, typer.Option(help="Entry, Trajectory, Guidance, Bus and timing, Flights")
    ] = "Entry",
    force: Annotated[bool, typer.Option("--force", help="replace files that exist")] = False,
) -> None:
    """Show flights in Rerun: track, corridor, limits, commands, guidance, bus, events."""
    from flight_sw.errors import RecordingError
    from tools.review.layout import TABS, blueprint
    from tools.review.review import draw, peak_s, plan
    from tools.review.source import open_flights
    from tools.review.stage import Stage
    from tools.status_line import StatusLine

    if tab not in TABS:
        raise RecordingError(f"--tab {tab}: allowed are {', '.join(TABS)}")
    _check_outputs(save, screenshot, force)
    with StatusLine() as status_line:
        status_line("reading the recordings")
        found = open_flights(flights)
        _check_moment(at_s, max(flight.recording.until_s for flight in found))
        _tell_gaps(found)
        shape = plan(found)
        with tempfile.TemporaryDirectory(prefix="aeroshell-") as folder:
            drawn = Path(folder) / "review.rrd"
            stage = Stage(", ".join(flight.label for flight in found))
            status_line("drawing the review")
            stage.save(drawn, blueprint(shape, tab))
            draw(stage, found, shape)
            _close(stage, drawn)
            moment_s = peak_s(found[0]) if at_s is None else at_s
            _hand_out(drawn, save, screenshot, moment_s, status_line)


def _close(stage: "Stage", drawn: Path) -> None:
    """Complete the drawing; Rerun itself says nothing of a disk that was full meanwhile."""
    import shutil
    import warnings

    from rerun.chunk import RrdReader

    from flight_sw.errors import RecordingError

    try:
        stage.close()
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # it warns of a file without its end
            RrdReader(drawn)
    except (RuntimeError, OSError, Warning) as error:
        free_mb = shutil.disk_usage(drawn.parent).free / 1e6
        raise RecordingError(
            f"{drawn}: was not written whole, {free_mb:z,.1f} MB are free in its folder"
        ) from error


def _hand_out(
    drawn: Path,
    save: Path | None,
    screenshot: Path | None,
    moment_s: float,
    status_line: Callable[[str], None],
) -> None:
    """Bring the review to where it is wanted."""
    from tools.review import viewer

    if screenshot is not None:
        status_line("drawing the picture")
        viewer.screenshot(drawn, drawn.with_suffix(".png"), moment_s)
        _put(drawn.with_suffix(".png"), screenshot, "--screenshot")
    if save is not None:
        _put(drawn, save, "--save")
    if save is None and screenshot is None:
        status_line("opening the viewer")
        viewer.open_window(drawn, moment_s)


def _put(source: Path, out: Path, option: str) -> None:
    """Copy a file to its place, whole or not at all."""
    import shutil

    from flight_sw.errors import RecordingError

    part = out.with_name(out.name + ".part")
    try:
        shutil.copyfile(source, part)
        part.replace(out)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink()
        raise RecordingError(f"{option} {out}: cannot be written, {error.strerror}") from error
    tell(out)


def _check_outputs(save: Path | None, screenshot: Path | None, force: bool) -> None:
    """Refuse a wrong name, and to replace what is there, before anything is read."""
    from flight_sw.errors import RecordingError

    for option, out, suffix in (("--save", save, ".rrd"), ("--screenshot", screenshot, ".png")):
        if out is None:
            continue
        if out.suffix != suffix:
            raise RecordingError(f"{option} {out}: allowed is a name that ends in {suffix}")
        if out.exists() and not force:
            raise RecordingError(f"{option} {out}: exists already, --force replaces it")
        if not out.parent.is_dir():
            raise RecordingError(f"{option} {out}: there is no folder {out.parent}")


def _check_moment(at_s: float | None, until_s: float) -> None:
    from flight_sw.errors import RecordingError

    if at_s is not None and not 0.0 <= at_s <= until_s:
        raise RecordingError(f"--at {at_s:g}: allowed is a time of flight, 0 to {until_s:z.2f} s")


def _tell_gaps(flights: "list[FlightData]") -> None:
    """What is missing of a flight, a line each on stderr."""
    for flight in flights:
        recording = flight.recording
        gaps = list(flight.gaps)
        if recording.damage:
            say(recording.damage)
        if not recording.is_complete:
            gaps.insert(0, f"incomplete, shown is the flight until {recording.until_s:z.2f} s")
        if recording.missing_minor_frames:
            gaps.append(f"{recording.missing_minor_frames:,} minor frames are missing in it")
        for gap in gaps:
            say(f"{recording.path}: {gap}")
