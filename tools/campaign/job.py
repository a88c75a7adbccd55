"""What a campaign flies, in plain values, and how one run of it is flown.

A `Job` holds no path that must be read: it travels to another machine as it is.
"""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from flight_sw.errors import AeroshellError, MissionError
from flight_sw.load_image import image_bytes
from sim_harness.flight.flight import (
    FlightPlan,
    FlightRun,
    Listener,
    Onboard,
    fly_memory,
    memory_loop,
    onboard_of,
)
from sim_harness.flight.outcomes import NUMERICAL
from sim_harness.flight.summary import flight_facts
from sim_harness.mission.documents import read_toml
from sim_harness.mission.mission import Mission, apply, find, leaf_keys, resolve
from sim_harness.world.assembly import read_csv
from sim_harness.world.missions import mission_of
from tools.campaign.profiles import F8, KEY, RATE_HZ, Profiler, speeds
from tools.gains.body import fill_body
from tools.gains.design import Design, design_of, read_tree
from tools.gains.image import DESIGN_NAME
from tools.overrides import (
    DESIGN_PREFIX,
    NOT_SETTABLE,
    Prepared,
    case_values,
    is_told,
    parse,
    prepare,
    split,
    told_of,
    with_values,
)

Tree = dict[str, Any]
NOT_FLOWN_WITH = ("cases", "dispersions", "requirements", "waypoints", "no_fly_zones")
"""Tables of a mission that no flight reads."""


class Job(NamedTuple):
    """One mission, law and load, before a run's own values."""

    mission_tree: Tree
    told_tree: Tree
    """The mission as the computer is told of it: without what was set for the world alone."""
    design_tree: Tree
    """Empty where the load is a given one."""
    mission_file: str
    law: str
    load_image: bytes
    load_file: str
    settings: Mapping[str, Any] = MappingProxyType({})
    """What was set for every run, by full names; `design.` before those of the gain design."""
    case: str | None = None
    """Which of the mission's cases it is."""


class Run(NamedTuple):
    """One flight of a campaign."""

    number: int
    overrides: dict[str, float]
    seed: int
    told: dict[str, float]
    """Mission keys among the overrides that the computer is told of besides those it always is."""


class Flown(NamedTuple):
    """What a run needs to be flown, on whatever bus."""

    mission: Mission
    load_image: bytes
    onboard: Onboard
    remade: bool


def inlined(tree: Tree, file: Path) -> Tree:
    """The mission's tables with a CSV file's columns in the place of its name."""
    air = tree.get("atmosphere")
    if not isinstance(air, dict) or not isinstance(air.get("csv"), str):
        return tree
    columns = read_csv(file.parent / air["csv"])
    return {**tree, "atmosphere": {**{k: v for k, v in air.items() if k != "csv"}, **columns}}


def job_of(
    target: str,
    law: str | None,
    settings: list[str],
    load: Path | None,
    case: str | None = None,
) -> tuple[Job, Prepared]:
    """The job of a mission, law, case and settings as `fly` takes them."""
    prepared = prepare(target, law, settings, load, case)
    file = find(target)
    folder = prepared.mission.gains_folder
    given = load is not None
    design = {} if given else read_tree(folder / DESIGN_NAME)
    of_case = case_values(prepared.mission, case)
    world, changes = split(parse(settings), read_toml(file), design, of_case)
    flown, told = read_toml(file), read_toml(file)
    apply(flown, world)
    apply(told, told_of(world))
    kept = [
        inlined({k: v for k, v in tree.items() if k not in NOT_FLOWN_WITH}, file)
        for tree in (flown, told)
    ]
    job = Job(
        mission_tree=kept[0],
        told_tree=kept[1],
        design_tree=with_values(design, changes),
        mission_file=str(file),
        law=prepared.law,
        load_image=prepared.load_image,
        load_file=str(prepared.load_path),
        settings=world | {DESIGN_PREFIX + key: value for key, value in changes.items()},
        case=case,
    )
    return job, prepared


def resolved(key: str, job: Job, where: str) -> str:
    """The full name of a dispersed key; `design.` before one of the gain design."""
    known = leaf_keys(Mission, job.mission_tree)
    known += [DESIGN_PREFIX + name for name in leaf_keys(Design, job.design_tree)]
    try:
        return resolve(key, [name for name in known if name not in NOT_SETTABLE])
    except MissionError as error:
        raise MissionError(f"{where}.{error}") from None


def load_of(
    job: Job, told: Mapping[str, float], of_design: Mapping[str, float], label: str
) -> bytes:
    """The load image for a computer that is told these values of mission and design."""
    file = Path(job.mission_file)
    believed = mission_of(with_values(job.told_tree, told), file, label)
    design = design_of(with_values(job.design_tree, of_design), label)
    body = fill_body(job.law, design, believed).body
    return image_bytes(job.law, believed.name, body)


class Flyer:
    """Flies runs of one job, one after the other; a thread each."""

    def __init__(self, job: Job, onboard: Onboard | None = None) -> None:
        self.job = job
        self.onboard = onboard or onboard_of(job.load_image, job.load_file)

    def mission(self, overrides: dict[str, float], label: str) -> Mission:
        """The mission that flies with these values of its keys."""
        tree = with_values(self.job.mission_tree, overrides)
        return mission_of(tree, Path(self.job.mission_file), label)

    def check_design(self, overrides: dict[str, float]) -> None:
        """Refuse values that the design does not take."""
        design_of(with_values(self.job.design_tree, overrides), DESIGN_NAME)

    def prepared(self, run: Run) -> Flown:
        """The mission and load of a run."""
        job = self.job
        label = f"{Path(job.mission_file).name}, run {run.number}"
        of_design, of_mission = {}, {}
        for key, value in run.overrides.items():
            if key.startswith(DESIGN_PREFIX):
                of_design[key.removeprefix(DESIGN_PREFIX)] = value
            else:
                of_mission[key] = value
        mission = self.mission(of_mission, label)
        told = {k: v for k, v in of_mission.items() if is_told(k)} | run.told
        if not job.design_tree or not (told or of_design):
            return Flown(mission, job.load_image, self.onboard, False)
        raw = load_of(job, told, of_design, label)
        return Flown(mission, raw, onboard_of(raw, label), True)

    def fly(self, run: Run) -> dict[str, Any]:
        """One flight in memory: its scalars, with the run's number and its profile over speed."""
        profiler = Profiler()
        try:
            flight = self._flown(run, profiler)
            facts = flight_facts(flight)
            return {"run": run.number, **facts, KEY: profiler.profile(flight, self.speed_mps)}
        except (AeroshellError, ArithmeticError, ValueError) as error:
            # One flight that cannot be flown, or not told, must not end thousands.
            told = f"not flown: {error}"
            return {
                "run": run.number, "seed": run.seed, "outcome": told, "outcome_class": NUMERICAL
            }  # fmt: skip

    def compiled(self) -> None:
        """Compile the flight loop, so that the first flight takes no longer than the others."""
        run = self._aloft(Run(0, {}, 0, {}), [])
        memory_loop(run, timed_every=0)[0](0)

    @cached_property
    def speed_mps(self) -> F8:
        """The speeds at which profiles are kept."""
        return speeds(self.mission({}, Path(self.job.mission_file).name))

    def _aloft(self, run: Run, listeners: list[Listener]) -> FlightRun:
        what = self.prepared(run)
        plan = FlightPlan(
            mission=what.mission,
            law=self.job.law,
            load_image=what.load_image,
            load_path=Path(self.job.load_file),
            bus="memory",
            seed=run.seed,
            recorded=False,
            case=self.job.case,
            truth_kept=bool(listeners),
            truth_rate_hz=RATE_HZ,
        )
        return FlightRun(plan, listeners, what.onboard)

    def _flown(self, run: Run, profiler: Profiler) -> FlightRun:
        flight = self._aloft(run, [profiler])
        fly_memory(flight, timed_every=0)
        return flight
