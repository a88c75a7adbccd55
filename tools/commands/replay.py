"""`aeroshell replay`: a recording's frames through the flight software once more."""

import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flight_sw.runtime.echo import echoed
from flight_sw.runtime.streams import say, tell

if TYPE_CHECKING:
    from sim_harness.replay.open_loop import Compared
    from sim_harness.replay.replayer import Difference, Replay
    from sim_harness.telemetry.reader import Recording

DIFFERS = 1
COUNT_DIGITS_MAX = 18


def replay(
    flight: Annotated[Path, typer.Argument(help="a recording: flight.mcap, or its folder")],
    load: Annotated[
        Path | None,
        typer.Option(help="another load: what it would have commanded, open loop"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="with --load: both loads' commands, .csv or .parquet")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="replace --out")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="print one JSON object")] = False,
) -> None:
    """Feed a recording to the flight software and compare its commands bit for bit."""
    from flight_sw.errors import RecordingError
    from tools.replaying import check_out, replayed

    if out is not None and load is None:
        raise RecordingError(f"--out {out}: goes with --load, a replay alone writes nothing")
    if out is not None:
        check_out(out, force=force)
    if load is not None:
        _open_loop(flight, load, out, as_json)
        return
    recording, found, wall_s = replayed(flight)
    speed = found.until_s / wall_s
    if as_json:
        tell(json.dumps(_object(recording, found, wall_s, speed), indent=1))
    else:
        tell("\n".join(_lines(flight, recording, found, f"{wall_s:z.2f} s, {speed:z,.0f} times")))
    recording.check_whole()
    if not found.is_identical:
        sys.exit(DIFFERS)


def _object(recording: "Recording", found: "Replay", wall_s: float, speed: float) -> dict[str, Any]:
    difference = found.difference._asdict() if found.difference else None
    return {
        "path": str(recording.path),
        "is_identical": found.is_identical,
        "is_complete": recording.is_complete,
        "minor_frames": found.cycles,
        "frames": found.frames,
        "until_s": found.until_s,
        "ticks": len(found.ticks),
        "false_frames": found.false_frames,
        "reports_that_count_otherwise": found.reports,
        "unanswered_minor_frames": found.unanswered,
        "gap_s": found.gap_s,
        "difference": difference,
        "wall_s": wall_s,
        "speedup": speed,
    }


def _lines(flight: Path, recording: "Recording", found: "Replay", speed: str) -> list[str]:
    from sim_harness.flight.summary import LOST_KEY

    if found.difference is not None:
        lines = [f"{flight}: {_told(found.difference)}"]
        lines.append(f"{found.cycles:,} frames before it are identical")
    else:
        lines = [f"{flight}: identical, {found.cycles:,} frames"]
    if len(found.ticks):
        lines.append(
            f"{len(found.ticks):,} of the cycles closed by a tick of the flight computer's clock"
        )
    if found.false_frames:
        lines.append(f"{found.false_frames:,} frames on the bus posed as the flight computer's")
    if found.reports:
        lines.append(
            f"{found.reports:,} reports of the computer count other frames than are here: it heard "
            "some that the recording lacks, or missed some"
        )
    told = recording.outcome.get(LOST_KEY, "0")[:COUNT_DIGITS_MAX]
    lost = int(told) if told.isdecimal() and told.isascii() else 0
    if lost and (found.reports or found.difference):
        lines.append(f"{lost:,} frames of the bus are not in the recording, its log was full")
    if found.unanswered:
        lines.append(f"the flight computer did not answer the last {found.unanswered:,} frames")
    if found.gap_s is not None:
        lines.append(
            f"replayed until {found.gap_s:z.2f} s: minor frames are missing after it, "
            f"{recording.missing_minor_frames:,} in all"
        )
    elif not recording.is_complete:
        lines.append(f"the recording is incomplete, replayed until {found.until_s:z.2f} s")
    lines.append(f"{found.until_s:z.2f} s of flight in {speed} real time")
    return lines


def _told(difference: "Difference") -> str:
    where = f"differs at {difference.t_s:z.2f} s, frame {difference.minor_frame:,}"
    what = difference.message + (f".{difference.signal}" if difference.signal else "")
    return f"{where}: {what} recorded {difference.recorded}, replayed {difference.replayed}"


def _open_loop(flight: Path, load: Path, out: Path | None, as_json: bool) -> None:
    from sim_harness.replay.open_loop import spreads
    from tools.replaying import compared_with, write_compared

    recording, image, compared = compared_with(flight, load)
    told = {
        name.removesuffix("_cmd_rad").replace("alpha", "angle of attack"): spread
        for spread in spreads(compared)
        for name in (spread.name,)
    }
    if as_json:
        tell(json.dumps(_open_loop_object(flight, load, compared, told), indent=1))
    else:
        crc32 = echoed(recording.manifest.get("load_crc32", "?"))
        tell(
            f"{flight}: open loop, what {load} (law {image.law}, 0x{image.crc32:08x}) would have "
            f"commanded of what the computer with load {crc32} heard\n"
            f"the vehicle flew on as recorded; {len(compared.t_s):,} frames compared"
        )
        for name, spread in told.items():
            tell(
                f"{name:<16} largest difference {math.degrees(spread.largest):+z9.4f} deg "
                f"at {spread.at_s:z9.2f} s, rms {math.degrees(spread.rms):z9.4f} deg"
            )
        if compared.missing:
            tell(f"{compared.missing:,} frames have an answer of one load alone")
        if not recording.is_complete:
            tell(f"the recording is incomplete, it ends at {recording.until_s:z.2f} s")
    if out is not None:
        write_compared(compared, out)
        say(f"{out}")
    recording.check_whole()


def _open_loop_object(
    flight: Path, load: Path, compared: "Compared", told: dict[str, Any]
) -> dict[str, Any]:
    return {
        "path": str(flight),
        "load": str(load),
        "is_open_loop": True,
        "minor_frames": len(compared.t_s),
        "missing": compared.missing,
        "differences": {
            name: {
                "largest_deg": math.degrees(spread.largest),
                "at_s": spread.at_s,
                "rms_deg": math.degrees(spread.rms),
            }
            for name, spread in told.items()
        },
    }
