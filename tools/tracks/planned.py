"""The plan that `planned-lqr` flew: of its load, or made onboard.

A plan made onboard is on no bus. The recorded frames are therefore fed to the flight software once
more until it has its plan, which is taken out of its memory. It is the one that was flown if all
that the computer told of its plan agrees: how the planner ended, after how many iterations and
flights ahead, the errors left, and at every report the bank planned at the index told. A plan that
fails in any of these is named and not shown.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw import modes
from flight_sw.errors import AeroshellError
from flight_sw.guidance.planned import plan_job
from flight_sw.guidance.planned.plan import REFERENCE, look_up
from flight_sw.guidance.planned.planned_lqr import FAILED, FROM_JOB, FROM_LOAD, SOURCES, TOLD_MAX
from flight_sw.load_image import activate
from flight_sw.model.motion import MOTION, N_STATES, STATES, motion_rates
from flight_sw.model.onboard import heat_flux
from flight_sw.model.profile import KNOTS_MAX
from flight_sw.records.types_ import Record
from sim_harness.replay.replayer import Replayer, warm_up
from sim_harness.replay.script import attached_load
from sim_harness.telemetry.reader import Recording
from tools.replaying import say_compiling
from tools.tracks import Track, Tracks

F8 = npt.NDArray[np.float64]
Telemetry = Mapping[str, npt.NDArray[Any]]

MESSAGES = ("TM_PLAN_A", "TM_PLAN_D", "TM_PLAN_E")
NAMES = {FROM_LOAD: "planned, of the load", FROM_JOB: "planned"}
OF_ANY = ("iterations",)
EXACT = ("ending", *OF_ANY, "flights")
ERRORS = ("target_error", "excess")
ERROR_STEP = 0.1  # of TM_PLAN_E
ERROR_RATIO = 1e-3  # of an error left: the last digits of a converged plan are another processor's
INDEX_STEP, BANK_STEP_RAD = 1e-6, 2e-7  # of TM_PLAN_A
BEHIND_S = 0.5  # a report of a plan in force comes within this of its being swapped in


class Reports(NamedTuple):
    """What the computer told of its plan while it was in ENTRY, a row a report."""

    t_s: F8
    columns: Telemetry

    def of(self, source: int) -> "Reports":
        """Those of one source."""
        kept = self.columns["plan_source"] == source
        return Reports(self.t_s[kept], {n: v[kept] for n, v in self.columns.items()})


def states_of(plan: Record) -> dict[str, F8]:
    """Columns of a plan by name, and its index."""
    n = int(plan["n_rows"])
    columns = {name: np.array(plan["state"][:n, i]) for i, name in enumerate(STATES)}
    return {"index": np.array(plan["index"][:n]), **columns}


def columns_of(load: Record, plan: Record) -> dict[str, F8]:
    """The plan's states with controls, drag, heat flux and altitude, a row each."""
    found = states_of(plan)
    n = len(found["index"])
    names = ("alpha_rad", "bank_rad", "drag_mps2", "heat_flux_wpm2", "alt_m")
    extra = {name: np.zeros(n) for name in names}
    reference, motion = np.zeros(1, REFERENCE), np.zeros(1, MOTION)
    for i in range(n):
        look_up(plan, float(found["index"][i]), reference[0])
        alpha, bank = float(reference["alpha_rad"][0]), float(reference["bank_rad"][0])
        x = np.array(plan["state"][i][:N_STATES])
        motion_rates(load["onboard"], load["atmosphere"], x, alpha, bank, motion[0])
        rho = float(motion["forces"]["rho_kgpm3"][0])
        extra["alpha_rad"][i], extra["bank_rad"][i] = alpha, bank
        extra["drag_mps2"][i] = motion["forces"]["drag_mps2"][0]
        extra["heat_flux_wpm2"][i] = heat_flux(load["onboard"], rho, float(x[0]))
        extra["alt_m"][i] = x[3] - float(load["onboard"]["planet"]["radius_m"])
    return {**found, **extra}


def reports_of(recording: Recording) -> Reports:
    """All reports of the plan in ENTRY; without rows where the plan's messages are not recorded."""
    known = {message.name for message in recording.decoder.messages}
    nothing = Reports(np.zeros(0), {"plan_source": np.zeros(0)})
    if not {*MESSAGES, "FSW_STATUS"} <= known:
        return nothing
    columns: dict[str, npt.NDArray[Any]] = {}
    times, told = zip(*(recording.message(name) for name in MESSAGES), strict=True)
    common = times[0]
    for t_s in times[1:]:
        common = np.intersect1d(common, t_s)
    for t_s, signals in zip(times, told, strict=True):
        at = np.searchsorted(t_s, common)
        columns |= {name: values[at] for name, values in signals.items()}
    status_s, status = recording.message("FSW_STATUS")
    if not len(status_s) or "plan_source" not in columns or "mode" not in status:
        return nothing
    mode = status["mode"][np.clip(np.searchsorted(status_s, common), 0, len(status_s) - 1)]
    kept = mode == modes.ENTRY
    return Reports(common[kept], {name: values[kept] for name, values in columns.items()})


def plan_made_again(recording: Recording, until_s: float) -> Record:
    """The plan that the flight software has in force when it has heard what was recorded until a
    time; raises AeroshellError where it has made none by then."""
    image = attached_load(recording)
    with say_compiling(f"law '{image.law}'"):
        warm_up(image)
    replayer = Replayer(recording, image)
    law = replayer.state_at(until_s)["law"][0]
    if int(law["source"]) != FROM_JOB:
        raise AeroshellError("the flight software has no plan of its own after the same frames")
    return law["plans"][int(law["in_force"])]


def _bank_slack(plan: Record) -> float:
    """By how much a bank may differ that was looked up at an index told in steps."""
    n = min(int(plan["profile"]["n_bank"]), KNOTS_MAX)
    knots, banks = (plan["profile"][name][:n] for name in ("bank_index", "bank_rad"))
    steepest = float(np.abs(np.diff(banks) / np.diff(knots)).max()) if n > 1 else 0.0
    return steepest * INDEX_STEP + BANK_STEP_RAD


def difference(plan: Record, reports: Reports) -> str:
    """The first in which a plan is not the one that was told of; empty where it is."""
    last = {name: values[-1].item() for name, values in reports.columns.items()}
    is_of_failed = last["plan_stage"] == FAILED  # then the job's ending is told, not the plan's
    for name in OF_ANY if is_of_failed else EXACT:
        if int(plan[name]) != last[f"plan_{name}"]:
            return f"its {name} {int(plan[name])}, telemetry's {last[f'plan_{name}']:g}"
    for name in ERRORS:
        own, told = min(float(plan[name]), TOLD_MAX), last[f"plan_{name}"]
        if not abs(own - told) <= ERROR_STEP + ERROR_RATIO * told:
            return f"its {name.replace('_', ' ')} {own:z.4g}, telemetry's {told:z.4g}"
    reference = np.zeros(1, REFERENCE)
    slack = _bank_slack(plan)
    end = float(plan["index"][int(plan["n_rows"]) - 1]) - INDEX_STEP
    for i, index in enumerate(reports.columns["plan_index"].tolist()):
        if index > end:  # beyond its end the tracker compares no more
            continue
        look_up(plan, index, reference[0])
        apart = float(reference["bank_rad"][0]) - float(reports.columns["plan_bank_rad"][i])
        if not abs(apart) <= slack:
            at_s = reports.t_s[i]
            return f"its bank {np.degrees(apart):z.3g} deg off telemetry's at {at_s:z.2f} s"
    return ""


def _facts(plan: Record, source: int) -> tuple[tuple[str, str], ...]:
    return (
        ("source", SOURCES[source]),
        ("planner ended", plan_job.ENDINGS[int(plan["ending"])]),
        ("iterations", str(int(plan["iterations"]))),
        ("flights ahead", str(int(plan["flights"]))),
        ("error at the target e_t", f"{float(plan['target_error']):z.4g}"),
        ("excess of heat flux e_c", f"{float(plan['excess']):z.4g} (W/cm²)² s"),
        ("peak heat flux", f"{float(plan['heat_flux_peak_wpm2']) / 1e3:z,.1f} kW/m²"),
        ("duration", f"{float(plan['duration_s']):z,.1f} s"),
    )


def _track(load: Record, plan: Record, source: int, reports: Reports) -> Track:
    """What was planned, and what of it was to be held when the computer told where it stood."""
    path = columns_of(load, plan)
    path["heading_rad"] = np.unwrap(path["heading_rad"])
    index = reports.columns["plan_index"]
    reference = {name: np.interp(index, path["index"], path[name]) for name in path}
    return Track(NAMES[source], path, {"t_s": reports.t_s, **reference}, _facts(plan, source))


def tracks_of(recording: Recording) -> Tracks:
    """The plans that the tracker followed."""
    try:
        reports = reports_of(recording)
        if not len(reports.t_s):
            return Tracks()
        load = activate(attached_load(recording))[0]
    except AeroshellError as error:
        return Tracks(gaps=(f"its plan is not shown: {error}",))
    tracks, gaps = [], []
    for source in (FROM_LOAD, FROM_JOB):
        told = reports.of(source)
        if not len(told.t_s):
            continue
        try:
            plan = load["law"]["stored"]
            if source == FROM_JOB:
                plan = plan_made_again(recording, float(told.t_s[0]) + BEHIND_S)
            apart = difference(plan, told)
        except AeroshellError as error:
            apart = str(error)
        if apart:
            gaps.append(f"its plan, made again, is not the one flown and not shown: {apart}")
        else:
            tracks.append(_track(load, plan, source, told))
    return Tracks(tuple(tracks), tuple(gaps))
