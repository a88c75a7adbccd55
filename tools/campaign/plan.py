"""What a campaign is: its job, its samples, and the identity that a folder is known by."""

import hashlib
import json
import math
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flight_sw.errors import AeroshellError, FlightError, MissionError
from flight_sw.runtime.jit import FLIGHT_ROOT, source_hash
from sim_harness.mission.dispersion_keys import Dispersions, Requirement
from sim_harness.mission.dispersions import Samples, draw, extremes, fixed, set_of
from sim_harness.mission.mission import Mission
from sim_harness.world.missions import mission_of
from tools.campaign.folder import FLIGHTS_MAX, SEED_MAX
from tools.campaign.job import Flyer, Job, Run, job_of, load_of, resolved
from tools.gains.design import design_of
from tools.gains.image import DESIGN_NAME
from tools.overrides import DESIGN_PREFIX, is_told, told_of, with_values

SOURCES = (FLIGHT_ROOT, FLIGHT_ROOT.parent / "sim_harness")


class Wanted(NamedTuple):
    """A campaign as it is asked for."""

    mission: str
    dispersions: str
    n: int
    seed: int = 0
    law: str | None = None
    settings: tuple[str, ...] = ()
    load: Path | None = None
    case: str | None = None


class Plan(NamedTuple):
    """Everything of a campaign but its results."""

    job: Job
    samples: Samples
    told_to_both: tuple[str, ...]
    """Varying keys that the computer is told of because the set says so."""
    identity: dict[str, Any]
    requirements: list[Requirement]
    title: str
    command: str
    fixed: Mapping[str, float | str]
    """What was set for every run, by the command or by the set."""

    @property
    def n(self) -> int:
        """How many flights."""
        return len(self.samples.seeds)

    def run(self, number: int) -> Run:
        """One of its flights, counted from 1."""
        overrides = self.samples.overrides(number)
        told = {key: overrides[key] for key in self.told_to_both}
        return Run(number, overrides, int(self.samples.seeds[number - 1]), told)


def digest_of(value: object) -> str:
    """A short hash of plain values."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:16]


def present_values(job: Job, keys: Mapping[str, object]) -> dict[str, object]:
    """What mission and design say of the keys before they are dispersed, defaults included."""
    mission = mission_of(job.mission_tree, Path(job.mission_file), Path(job.mission_file).name)
    design = design_of(job.design_tree, job.load_file) if job.design_tree else None
    found: dict[str, object] = {}
    for key in keys:
        value: Any = design if key.startswith(DESIGN_PREFIX) else mission
        for part in key.removeprefix(DESIGN_PREFIX).split("."):
            value = getattr(value, part, None)
        found[key] = value
    return found


def with_full_names(dispersions: Dispersions, job: Job, where: str) -> Dispersions:
    """The set with every key under its full name; refuses unknown and doubled ones."""
    names = {key: resolved(key, job, where) for key in dispersions.keys}
    if len(set(names.values())) < len(names):
        raise MissionError(f"{where} names a key twice, allowed one entry a key")
    groups = [
        group.model_copy(update={"keys": [names.get(key, key) for key in group.keys]})
        for group in dispersions.correlations
    ]
    spreads = {names[key]: spread for key, spread in dispersions.keys.items()}
    return dispersions.model_copy(update={"keys": spreads, "correlations": groups})


def told_to_both(dispersions: Dispersions) -> tuple[str, ...]:
    """Mission keys that the computer is told of because the set says so."""
    keys = [key for key, spread in dispersions.keys.items() if spread.told_to == "both"]
    return tuple(sorted(k for k in keys if not k.startswith(DESIGN_PREFIX) and not is_told(k)))


def with_fixed(job: Job, values: dict[str, float], both: tuple[str, ...]) -> Job:
    """The job with a set's fixed values in it, and the load that goes with them."""
    design = {k: v for k, v in values.items() if k.startswith(DESIGN_PREFIX)}
    mission = {k: v for k, v in values.items() if k not in design}
    told = told_of(mission) | {k: v for k, v in mission.items() if k in both}
    changed = job._replace(
        mission_tree=with_values(job.mission_tree, mission),
        told_tree=with_values(job.told_tree, told),
        design_tree=with_values(
            job.design_tree, {k.removeprefix(DESIGN_PREFIX): v for k, v in design.items()}
        ),
    )
    if not job.design_tree or not (told or design):
        return changed
    return changed._replace(load_image=load_of(changed, {}, {}, DESIGN_NAME))


def check_extremes(
    job: Job, dispersions: Dispersions, present: Mapping[str, object], where: str
) -> None:
    """Refuse a set that reaches where a key does not."""
    flyer = Flyer(job)
    for key, values in extremes(dispersions, present, where).items():
        for value in values:
            try:
                if key.startswith(DESIGN_PREFIX):
                    flyer.check_design({key.removeprefix(DESIGN_PREFIX): value})
                else:
                    flyer.mission({key: value}, Path(job.mission_file).name)
            except AeroshellError as error:
                raise MissionError(
                    f"{where}.{key} reaches {value:z.12g}, which is refused: {error}"
                ) from None


def plan_of(wanted: Wanted) -> Plan:
    """The plan of a campaign; raises AeroshellError with what is wrong."""
    if not 1 <= wanted.n <= FLIGHTS_MAX:
        raise FlightError(f"-n is {wanted.n}, allowed 1 to {FLIGHTS_MAX}")
    if not 0 <= wanted.seed <= SEED_MAX:
        raise FlightError(f"--seed is {wanted.seed}, allowed 0 to {SEED_MAX}")
    job, prepared = job_of(
        wanted.mission, wanted.law, list(wanted.settings), wanted.load, wanted.case
    )
    mission = prepared.mission
    where = f"dispersions.{wanted.dispersions}"
    found = set_of(mission.dispersions, wanted.dispersions, mission.name)
    dispersions = with_full_names(found, job, where)
    both = told_to_both(dispersions)
    if both and not job.design_tree:
        raise FlightError(f"{where} tells the computer of {', '.join(both)}: not with --load")
    always = fixed(dispersions)
    job = with_fixed(job, always, both)
    present = present_values(job, dispersions.keys)
    check_extremes(job, dispersions, present, where)
    samples = draw(dispersions, present, wanted.n, wanted.seed, where)
    varying_both = tuple(key for key in both if key in samples.keys)
    return Plan(
        job, samples, varying_both, identity_of(wanted, job, mission, samples, varying_both),
        mission.requirements, mission.titled(job.case), command_of(wanted),
        {**job.settings, **always},
    )  # fmt: skip


def command_of(wanted: Wanted) -> str:
    """The command that flies the campaign, its folder left out."""
    words = ["aeroshell", "campaign", wanted.mission, "--dispersions", wanted.dispersions]
    words += ["-n", str(wanted.n), "--seed", str(wanted.seed)]
    words += ["--case", wanted.case] if wanted.case else []
    words += ["--law", wanted.law] if wanted.law else []
    for setting in wanted.settings:
        words += ["--set", setting]
    words += ["--load", str(wanted.load)] if wanted.load else []
    return shlex.join(words)


def identity_of(
    wanted: Wanted, job: Job, mission: Mission, samples: Samples, told: tuple[str, ...]
) -> dict[str, Any]:
    """What two campaigns must share to be one."""
    drawn = hashlib.sha256(" ".join((*samples.keys, "/", *told)).encode())
    drawn.update(np.ascontiguousarray(samples.values).tobytes())
    drawn.update(samples.seeds.tobytes())
    crc32 = Flyer(job).onboard.image.crc32
    return {
        "mission": mission.name,
        "case": job.case,
        "mission_hash": digest_of(encoded(job.mission_tree)),
        "law": job.law,
        "load_crc32": f"0x{crc32:08x}",
        "design_hash": digest_of(encoded([job.design_tree, job.told_tree])),
        "dispersions": wanted.dispersions,
        "n": wanted.n,
        "seed": wanted.seed,
        "samples_hash": drawn.hexdigest()[:16],
        "sources_hash": source_hash(*SOURCES),
    }


def encoded(value: Any) -> Any:
    """Plain values for strict JSON: infinite numbers as texts."""
    if isinstance(value, dict):
        return {key: encoded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [encoded(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value
