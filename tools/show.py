"""How a flight is shown on a terminal: a progress line while it flies, a table when it is over."""

from threading import Timer
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

from flight_sw.modes import MODES
from flight_sw.runtime.streams import is_watched, say
from sim_harness.flight.flight import FlightRun
from sim_harness.flight.pacing import pace_so_far
from sim_harness.flight.slip_watch import slips_so_far
from sim_harness.mission.mission import Mission
from tools.console import progress_console
from tools.published import published

LONG_S = 2.0  # a wait that takes longer is spoken of

RowDefinition = tuple[str, str, str]

ROWS: tuple[RowDefinition, ...] = (
    ("heat load", "heat_load_mjpm2", "MJ/m2"),
    ("ground range", "ground_range_km", "km"),
    ("downrange error", "downrange_error_km", "km"),
    ("crossrange error", "crossrange_error_km", "km"),
    ("altitude error", "altitude_error_km", "km"),
    ("speed error", "speed_error_mps", "m/s"),
    ("peak heat flux", "heat_flux_max_kwpm2", "kW/m2"),
    ("  after activation", "heat_flux_max_after_activation_kwpm2", "kW/m2"),
    ("peak load factor", "load_factor_max_g", "g"),
    ("heat-flux error", "heat_flux_error_mjpm2", "MJ/m2"),
    ("bank effort", "bank_effort_degs", "deg s"),
    ("flight time", "flight_time_s", "s"),
)


class ProgressLine:
    """A progress bar over the energy to be lost; shown only where stderr is a terminal."""

    def __init__(self, mission: Mission, quiet: bool) -> None:
        self.console = progress_console()
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[state]}"),
            console=self.console,
            disable=quiet or not is_watched(),
            transient=True,
        )
        self._quiet = quiet
        self._waits_for = ""
        self._notice = Timer(0.0, lambda: None)
        self._from_mps = mission.entry.speed_mps
        self._to_mps = mission.end.speed_mps
        self._has_heating = mission.heating is not None
        self._task = self._progress.add_task(mission.name, total=1.0, state="")

    def __enter__(self) -> "ProgressLine":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._notice.cancel()
        self._progress.stop()

    def rows(self, bus: npt.NDArray[np.void], truth: npt.NDArray[np.void]) -> None:
        """Nothing to show of single frames."""

    def progress(self, run: FlightRun) -> None:
        """Mission time, mode, speed, heat flux, bank; against the clock, pace and slips too."""
        truth, port = run.harness["truth"][0], run.harness["port"][0]
        lost = (self._from_mps - truth["v_rel_mps"]) / max(self._from_mps - self._to_mps, 1.0)
        state = (
            f"{truth['t_s']:z7.1f} s  {MODES[int(port['mode'])]:<8} "
            f"{truth['v_rel_mps']:z6.0f} m/s  {self._heat_flux(truth)}"
            f"bank {np.degrees(truth['bank_rad']):z6.1f} deg"
        )
        if run.plan.pace > 0.0:
            reached = pace_so_far(run.pacer[0], float(truth["t_s"]))
            late = slips_so_far(run.pacer[0], port)
            state += f"  {reached:z5.2f}x  {late.harness + late.computer} slips"
        self._progress.update(self._task, completed=float(np.clip(lost, 0.0, 1.0)), state=state)

    def _heat_flux(self, truth: np.void) -> str:
        """The heat flux, where the mission has any."""
        return f"{truth['heat_flux_wpm2'] / 1e3:z7.1f} kW/m2  " if self._has_heating else ""

    def warn(self, t_s: float, text: str) -> None:
        """One line on stderr, above the bar."""
        if self._progress.disable:
            say(f"{t_s:z.1f} s: {text}")
        else:
            self._progress.console.print(f"{t_s:z.1f} s: {text}", highlight=False, markup=False)

    def waiting(self, text: str) -> None:
        """Say what is waited for: on the bar, or where there is none a line once it gets long."""
        self._progress.update(self._task, state=text)
        kind = text.partition("(")[0].strip()
        if kind == self._waits_for:
            return
        self._waits_for = kind
        self._notice.cancel()
        if kind and self._progress.disable and not self._quiet:
            self._notice = Timer(LONG_S, lambda: say(f"{kind}"))
            self._notice.daemon = True
            self._notice.start()


def result_table(summary: dict[str, Any], mission: Mission, comparable: bool) -> Table:
    """The result, beside the published numbers where there are any."""
    row = None
    if comparable:
        row = published(mission.name, summary["law"], mission.limits.heat_flux_max_kwpm2)
    source = row.source if row else ""
    trigger = f" ({summary['end_trigger']})" if summary["end_trigger"] else ""
    title = mission.titled(summary["case"])
    table = Table(title=f"{title}: law {summary['law']}, {summary['outcome']}{trigger}")
    table.add_column("")
    table.add_column("flown", justify="right")
    if row:
        table.add_column(source, justify="right")
        table.add_column("deviation", justify="right")
    table.add_column("unit")
    for label, key, unit in ROWS:
        if summary[key] is None:
            continue  # the mission has no target, no heating or no such limit
        cells = [label, f"{summary[key]:z,.2f}"]
        if row:
            reference = getattr(row, key, None)
            cells += (
                [f"{reference:z,.1f}", f"{summary[key] / reference - 1.0:+z.2%}"]
                if reference is not None
                else ["", ""]
            )
        table.add_row(*cells, unit)
    return table


def _others(summary: dict[str, Any]) -> str:
    """Who else spoke on the bus, for the last line."""
    said = [
        f"{kind} {summary[key]} on the bus as well; "
        for kind, key in (("harness", "other_harness"), ("flight computer", "other_computer"))
        if summary[key]
    ]
    if foreign := summary["rejected_by_harness"]["FOREIGN"]:
        said.append(f"{foreign} frames under the harness's identifiers from another sender; ")
    return "".join(said)


def footnote(summary: dict[str, Any], folder: str) -> str:
    """One line on how it was flown and where it lies."""
    step = summary["step_time_us"]
    timing = f"step p50 {step['p50']:z.1f} us, p99.9 {step['p999']:z.1f} us; " if step else ""
    pace = ""
    if not summary["pace_held"]:
        pace = f"pace {summary['pace']} not held, {summary['pace_reached']:z,.2f}x reached; "
    held = "".join(
        f"{name} beyond the bus and held {count:,} times; "
        for name, count in summary["navigation_held"].items()
    )
    doubted = ""
    if believed := summary["candidates_believed"]:
        doubted = f"doubted navigation believed {believed:,} times; "
    return (
        f"{held}{doubted}{summary['minor_frames']:,} minor frames on bus {summary['bus']}, "
        f"{summary['frames_rejected']} frames rejected; {_others(summary)}{timing}{pace}"
        f"{summary['speedup']:z,.0f} times real time; commands {summary['command_sha256'][:16]}; "
        f"{folder}"
    )
