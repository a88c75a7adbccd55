"""`aeroshell campaign`: many flights of a mission with dispersed conditions, kept and judged."""

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flight_sw.runtime.streams import is_watched, say, tell
from tools.commands.fly import NamedCase

if TYPE_CHECKING:
    from tools.campaign.engine import Campaign

CAMPAIGNS = Path("runs")
LINE_EVERY_S = 10.0  # between two lines of progress where there is no terminal


class ProgressOfMany:
    """How many flights are done, at which rate, and when the last will be."""

    def __init__(self, quiet: bool) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
        from rich.progress import TimeRemainingColumn as Remaining

        from tools.console import progress_console

        self._bar = Progress(
            TextColumn("flights"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            Remaining(),
            console=progress_console(),
            disable=quiet or not is_watched(),
            transient=True,
        )
        self._lines = not quiet and not is_watched()
        self._task = self._bar.add_task("flights", total=None, rate="")
        self._before: int | None = None
        self._begun_s = self._told_s = time.monotonic()

    def __enter__(self) -> "ProgressOfMany":
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def __call__(self, done: int, n: int) -> None:
        """Show where the campaign stands."""
        now_s = time.monotonic()
        if self._before is None:
            self._before, self._begun_s = done, now_s
            if 0 < done < n:
                self.say(f"{done:,} of {n:,} flights are there already")
        spent_s = max(now_s - self._begun_s, 1e-9)
        rate = (done - self._before) / spent_s
        self._bar.update(self._task, completed=done, total=n, rate=f"{rate:z.1f} flights/s")
        if self._lines and now_s - self._told_s > LINE_EVERY_S and rate > 0.0:
            self._told_s = now_s
            left_s = (n - done) / rate
            self.say(f"{done:,} of {n:,} flights, {rate:z.1f} flights/s, {left_s:z.0f} s to go")

    def say(self, text: str) -> None:
        """One line on stderr, above the bar."""
        if self._lines:
            say(text)
        elif not self._bar.disable:
            self._bar.console.print(text, highlight=False, markup=False)


def _folder(out: Path | None, mission: str, law: str | None, name: str) -> Path:
    """The folder named, or the next free one below runs/."""
    if out is not None:
        return out
    stem = f"{mission}-{law or 'default'}-{name}"
    names = (f"{stem}-{number:03d}" for number in range(1, 1_000_000))
    return next(CAMPAIGNS / name for name in names if not (CAMPAIGNS / name).exists())


def campaign(
    mission: Annotated[
        str, typer.Argument(help="a shipped mission, or the path of a mission TOML")
    ],
    *,
    case: NamedCase = None,
    dispersions: Annotated[str, typer.Option(help="a dispersion set of the mission file")],
    n: Annotated[int, typer.Option("-n", "--flights", help="how many flights")],
    law: Annotated[str | None, typer.Option(help="guidance law [default: the mission's]")] = None,
    seed: Annotated[int, typer.Option(help="of samples and of the flights' noise")] = 0,
    jobs: Annotated[
        int | None, typer.Option(help="flights at a time [default: processors]")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(help="address of a Dask scheduler, such as tcp://host:8786")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="override a mission or design key"),
    ] = None,
    load: Annotated[
        Path | None, typer.Option(help="load image to fly instead of the gains'")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="folder; one of the same campaign goes on [below runs/]")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print only campaign.json")] = False,
    fail_on_verdict: Annotated[
        bool, typer.Option("--fail-on-verdict", help="exit 1 unless every requirement is met")
    ] = False,
    reported: Annotated[
        bool, typer.Option("--report/--no-report", help="write report.html when all are flown")
    ] = True,
) -> None:
    """Fly a campaign; killed and started again, it goes on where it was."""
    from tools.campaign.engine import run_campaign
    from tools.campaign.plan import Wanted

    wanted = Wanted(mission, dispersions, n, seed, law, tuple(settings or ()), load, case)
    stem = "-".join(filter(None, (Path(mission).stem, case)))
    folder = _folder(out, stem, law, dispersions)
    with ProgressOfMany(quiet=as_json) as progress:
        flown = run_campaign(wanted, folder, jobs, progress, cluster)
    if reported:
        _report(folder)
    if as_json:
        told: dict[str, Any] = {k: v for k, v in flown.manifest.items() if k != "job"}
        tell(json.dumps(told, indent=1))
    else:
        _show(flown)
    if fail_on_verdict and not flown.manifest["verdict"]["all_met"]:
        raise typer.Exit(1)


def _report(folder: Path) -> None:
    """The campaign's own report, new each time the campaign is gone on with."""
    from tools.commands.report import command_of
    from tools.report.page import REPORT, write_report
    from tools.status_line import StatusLine

    with StatusLine() as status_line:
        write_report([folder], folder / REPORT, command_of([folder], None), status_line)


def _show(flown: "Campaign") -> None:
    """Classes, distributions, verdicts, and how fast it went."""
    from tools.campaign.tables import distribution_table, limits_of, requirement_table
    from tools.console import show

    identity, verdict = flown.manifest["identity"], flown.manifest["verdict"]
    counts = {name: count for name, count in verdict["outcome_classes"].items() if count}
    told = ", ".join(f"{count:,} {name}{limits_of(flown, name)}" for name, count in counts.items())
    show(distribution_table(flown))
    if verdict["requirements"]:
        show(requirement_table(verdict["requirements"]))
    tell(f"{identity['mission']}, law {identity['law']}, {identity['n']:,} flights: {told}")
    if how := flown.manifest.get("flown"):
        tell(
            f"{how['flights']:,} flown in {how['wall_s']:z,.1f} s, "
            f"{how['flights'] / how['wall_s']:z.1f} flights/s, {how['jobs']} at a time, "
            f"{how['cpu_s'] / how['flights'] * 1e3:z.0f} ms of processor time a flight; "
            f"{flown.folder}/"
        )
