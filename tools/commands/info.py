"""`aeroshell info`: what is in a recording."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from flight_sw.runtime.echo import echoed
from flight_sw.runtime.streams import tell
from tools.display_units import DISPLAY

TIMING_KEY = "timing"  # told by `aeroshell timing`
VALUE_MAX, KEY_MAX = 2000, 40  # characters of the manifest that are shown
SHOWN_S = 0.005  # what two decimals of a second show at least


def info(
    flight: Annotated[Path, typer.Argument(help="a recording: flight.mcap, or its folder")],
    as_json: Annotated[bool, typer.Option("--json", help="print one JSON object")] = False,
) -> None:
    """Tell what a recording holds: manifest, modes, events, extremes, and whether it is whole."""
    from sim_harness.telemetry.reader import open_recording
    from tools.flight_facts import facts

    recording = open_recording(flight)
    found = facts(recording)
    tell(json.dumps(found, indent=1) if as_json else _text(found))
    recording.check_whole()


def _text(found: dict[str, Any]) -> str:
    sections = [
        ("", [_state(found), _contents(found)]),
        ("manifest", _pairs(found["manifest"])),
        ("outcome", _pairs({k: v for k, v in found["outcome"].items() if k != TIMING_KEY})),
        ("modes", [f"{m['t_s']:z9.2f} s  {m['mode']}" for m in found["modes"]]),
        ("events", [_event(event) for event in found["events"]]),
        ("extremes", [_extreme(extreme) for extreme in found["extremes"]]),
    ]
    lines = []
    for title, content in sections:
        if content:
            lines += ["", title] if title else []
            lines += [f"  {line}" if title else line for line in content]
    return "\n".join(lines)


def _state(found: dict[str, Any]) -> str:
    flown = f"{found['until_s']:z.2f} s of flight"
    if found["is_complete"]:
        return f"{found['path']}: complete, {flown}"
    cut_off = f"{found['path']}: incomplete, its recorder was cut off; it holds {flown}"
    if found["from_journal_s"] >= SHOWN_S:
        cut_off += f", the last {found['from_journal_s']:z.2f} s in its journal"
    return cut_off


def _contents(found: dict[str, Any]) -> str:
    parts = [
        f"{found['frames']:,} CAN frames in {found['minor_frames']:,} minor frames",
        f"{found['truth_rows']:,} samples of the truth",
        f"{found['bytes'] / 1e6:z.1f} MB",
        "attached " + (echoed(", ".join(found["attachments"])) or "nothing"),
    ]
    if found["missing_minor_frames"]:
        parts.append(f"{found['missing_minor_frames']:,} minor frames missing")
    if found["frames_not_decoded"]:
        parts.append(f"{found['frames_not_decoded']:,} frames of no known form")
    if found["dbc_failure"] and found["is_of_this_dbc"] is not None:
        parts.append("its DBC cannot be read, its frames are not decoded")
    elif found["is_of_this_dbc"] is None:
        parts.append("no DBC is attached, its frames are not decoded")
    elif not found["is_of_this_dbc"]:
        parts.append("read through its own DBC, which is not this version's")
    return "; ".join(parts)


def _pairs(items: dict[str, str]) -> list[str]:
    width = min(max((len(key) for key in items), default=0), KEY_MAX)
    return [f"{echoed(key):<{width}}  {echoed(value, VALUE_MAX)}" for key, value in items.items()]


def _event(event: dict[str, Any]) -> str:
    return f"{event['t_s']:z9.2f} s  {event['level']:<7}  {echoed(event['text'])}"


def _extreme(extreme: dict[str, Any]) -> str:
    factor, unit = DISPLAY[extreme["name"].rsplit("_", 1)[-1]]
    value = extreme["value"] * factor
    return f"{extreme['title']:<22} {value:z12,.3f} {unit:<6} at {extreme['t_s']:z9.2f} s"
