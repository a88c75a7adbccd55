"""`aeroshell plan`: what the computer would plan onboard, iteration by iteration."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flight_sw.runtime.streams import say, tell
from tools.commands.fly import NamedCase

if TYPE_CHECKING:
    from tools.planning import Told


def plan(
    mission: Annotated[str, typer.Argument(help="a shipped mission, or a mission.toml")],
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="another entry, target or design; repeat"),
    ] = None,
    case: NamedCase = None,
    load: Annotated[
        Path | None, typer.Option("--load", help="the load image whose planner is run")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE.png", help="draw the plan")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print one JSON object")] = False,
) -> None:
    """Plan an entry with the computer's own kernels, and show how the plan converges.

    Exit status 1 where the plan does not end at the target within the design's bars.
    """
    from tools.planning import plan_of, to_json

    told = plan_of(mission, settings or [], load, case)
    if plot is not None:
        if not told.columns:
            say(f"aeroshell: {told.mission.name}: nothing was planned, {plot} is not drawn")
        else:
            from tools.planning_plot import plot as draw

            draw(told, plot)
    if as_json:
        tell(json.dumps(to_json(told), indent=1))
    else:
        _show(told)
    if not told.is_good:
        raise typer.Exit(1)


def _show(told: "Told") -> None:
    from rich import box
    from rich.table import Table

    from tools.console import print_whole, result_console
    from tools.gains.planned.offline import iterations_of
    from tools.planning import HEADINGS, to_json

    console = result_console()
    found = to_json(told)
    spent = (
        f"{found['flights_ahead']} flights ahead in {found['minor_frames']} minor frames, "
        f"{found['coast_s']:z.2f} s of coast"
    )
    if not told.columns:
        console.print(f"{told.mission.name}: nothing can be planned from this entry; {spent}")
        return
    title = told.mission.titled(told.case) if told.case else None
    table = Table(title=title, box=box.SIMPLE_HEAD)
    for title, _, _ in HEADINGS:
        table.add_column(title, justify="right", no_wrap=True)
    for row in iterations_of(told.planned.job[0]):
        table.add_row(*(form.format(row[key]) for _, key, form in HEADINGS))
    print_whole(console, table)
    banks = ", ".join(
        f"{bank:z.1f} at {at:g}"
        for at, bank in zip(found["bank_index"], found["bank_deg"], strict=True)
    )
    console.print(f"bank deg over the index: {banks}", highlight=False, soft_wrap=True)
    ends = f"ends {found['distance_km']:z.2f} km from the target"
    console.print(f"{told.ending}; {ends}; {spent}", highlight=False, soft_wrap=True)
