"""`aeroshell timing`: how punctual a flight was."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flight_sw.runtime.streams import say, tell

if TYPE_CHECKING:
    from tools.flight_timing import FlightTiming

US_PER_S = 1e6


def timing(
    flight: Annotated[Path, typer.Argument(help="a run folder, its summary.json or flight.mcap")],
    png: Annotated[Path | None, typer.Option(help="draw the histograms into this file")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print one JSON object")] = False,
) -> None:
    """Tell how a flight kept time: wake-up, step, round trip, slips, late commands, pace."""
    from tools.flight_timing import read_timing

    found = read_timing(flight)
    if as_json:
        tell(json.dumps(found.as_json(), indent=1))
    else:
        tell(_text(found))
    if png is not None:
        from tools.timing_plot import plot

        plot(found, period_us(found), _headline(found), png)
        say(f"{png}")


def pace_factor(pace: str) -> float:
    """Mission seconds per second of the clock, of a summary's `pace`; 0 for lockstep."""
    if pace in ("lockstep", "realtime"):
        return float(pace == "realtime")
    return float(pace.removesuffix("x"))


def period_us(found: "FlightTiming") -> float:
    """A minor frame on the clock; 0 for lockstep, which has none."""
    factor = pace_factor(str(found.counts["pace"]))
    return float(found.flown["period_s"]) / factor * US_PER_S if factor > 0.0 else 0.0


def _headline(found: "FlightTiming") -> str:
    flown, counts = found.flown, found.counts
    what = f"{flown['minor_frames']:,} minor frames on bus {flown['bus']}"
    if found.is_lockstep:
        return f"{what}, lockstep"
    reached = f"pace {counts['pace']}, reached {counts['pace_reached']:z.3f}x"
    return (
        f"{what}, {flown['synchronisation']}-synchronised, {reached}\n"
        f"{counts['slips']} slips, {counts['ticks']} ticks, "
        f"{counts['late_commands']} late commands"
    )


def _text(found: "FlightTiming") -> str:
    from tools.flight_timing import PERCENTILES

    counts, lines = found.counts, [_headline(found).partition("\n")[0]]
    if found.is_lockstep:
        lines.append("no clock, so no deadlines: only the step was measured")
    else:
        held = "held" if counts["pace_held"] else "not held"
        lines += [
            f"period         {period_us(found):z10,.1f} us",
            f"pace           {held}",
            f"slips          {counts['slips']:8,}    frames not over when the next was due",
            f"ticks          {counts['ticks']:8,}    cycles closed without navigation",
            f"late commands  {counts['late_commands']:8,}    frames flown with the command before",
        ]
    if found.stolen_s is not None:
        lines.append(
            f"stolen         {found.stolen_s:z8.2f}    s of processor time, by a hypervisor"
        )
    width = max(len(quantity.title) for quantity in found.measured)
    lines += ["", " " * width + "".join(f"{label:>12}" for label in PERCENTILES.values()) + "  us"]
    for quantity in found.measured:
        cells = "".join(f"{quantity.percentiles_us[key]:z12,.1f}" for key in PERCENTILES)
        lines.append(f"{quantity.title:<{width}}{cells}")
    return "\n".join(lines)
