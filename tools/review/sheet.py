"""The sheet of facts: what was flown, how it ended, extremes beside limits, what is missing."""

import math

from tools.display_units import DISPLAY
from tools.flight_facts import extremes
from tools.review.columns import minor_frames, missing_frames
from tools.review.signals import shown
from tools.review.source import FlightData

LIMITED = {
    "heat_flux_wpm2": "heat_flux_wpm2",
    "load_factor_g": "load_factor_g",
    "dynamic_pressure_pa": "dynamic_pressure_pa",
}
KEPT = ("mission", "case", "law", "bus", "seed", "load_crc32", "version", "command_line")


def state_of(flight: FlightData) -> str:
    """Whether the recording is whole, in a sentence."""
    recording = flight.recording
    if recording.is_complete:
        ended = recording.outcome.get("outcome", "with no word of its outcome")
        return f"complete, {recording.until_s:z.2f} s of flight, {ended}"
    return (
        f"**incomplete: its recorder was cut off. It holds the flight until "
        f"{recording.until_s:z.2f} s.**"
    )


def sheet(flights: list[FlightData]) -> str:
    """All flights, as Markdown."""
    return "\n\n".join(_flight(flight) for flight in flights)


def _flight(flight: FlightData) -> str:
    manifest = flight.recording.manifest
    lines = [f"## {flight.label}", "", state_of(flight), ""]
    lines += [f"- {key.replace('_', ' ')}: `{manifest[key]}`" for key in KEPT if key in manifest]
    lines.append(
        f"- {len(flight.recording.bus):,} CAN frames in {minor_frames(flight):,} minor frames, "
        f"{missing_frames(flight)} missing"
    )
    lines += [f"- **{gap}**" for gap in flight.gaps]
    for track in flight.planned.tracks:
        lines += ["", f"| {track.name} | |", "| --- | ---: |"]
        lines += [f"| {title} | {value} |" for title, value in track.facts]
    lines += [
        "",
        "| extreme | value | unit | limit | at, s |",
        "| --- | ---: | --- | ---: | ---: |",
    ]
    for extreme in extremes(flight.recording):
        factor, unit = DISPLAY[extreme["name"].rsplit("_", 1)[-1]]
        limit = ""
        if extreme["name"] in LIMITED:
            allowed = getattr(flight.limits, LIMITED[extreme["name"]])
            factor_shown = shown(extreme["name"]).factor
            limit = f"{allowed * factor_shown:z,.4g}" if math.isfinite(allowed) else "none"
        lines.append(
            f"| {extreme['title']} | {extreme['value'] * factor:z,.3f} | {unit} | {limit} "
            f"| {extreme['t_s']:z,.1f} |"
        )
    return "\n".join(lines)
