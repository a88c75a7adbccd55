"""`--set KEY=VALUE`: which key of the mission or of the gain design is meant, and what it changes.

A mission key changes the world. Those that the flight computer is told of (the path limits and the
rate) change its load too; a design key changes only the load, which is then made anew.
"""

import math
import shlex
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from flight_sw.errors import DesignError, FlightError, MissionError
from flight_sw.load_image import LoadImage, read_image
from flight_sw.model.onboard import ONBOARD
from sim_harness.mission.case_keys import case_of
from sim_harness.mission.documents import read_toml, short
from sim_harness.mission.errors import nearest
from sim_harness.mission.mission import (
    NOT_IN_A_CASE,
    SHIPPED,
    Mission,
    apply,
    find,
    full_names,
    leaf_keys,
    models_first,
    resolve,
    value_of,
)
from sim_harness.mission.quantities import plain
from sim_harness.world.assembly import world_of
from sim_harness.world.missions import load_mission
from tools.gains.body import fill_onboard
from tools.gains.design import Design, laws_of, read_tree
from tools.gains.image import DESIGN_NAME, checked_design, image_path, make

Value = TypeVar("Value")

DESIGN_PREFIX = "design."
TOLD_TO_THE_COMPUTER = ("limits.", "target.", "guidance.rate_hz")
MADE_FOR = (
    ("planet", "radius_m"),
    ("planet", "mu_m3ps2"),
    ("planet", "rotation_radps"),
    ("vehicle", "mass_kg"),
    ("vehicle", "reference_area_m2"),
)
"""Fields of a load's `onboard` that tell one planet and vehicle from another."""
SET_POINT = "limits.heat_flux_max_kwpm2"
NOT_SETTABLE = (*NOT_IN_A_CASE, "design.mission", "design.laws")


class Prepared(NamedTuple):
    """What a flight needs, overrides applied."""

    mission: Mission
    law: str
    load_image: bytes
    load_path: Path
    remade: bool
    """The load was made for this flight, it is not the stored one."""
    comparable: bool
    """Nothing but the heat-flux set point differs from the mission as shipped."""
    case: str | None = None
    """Which of the mission's cases it is."""


def parse(settings: list[str]) -> dict[str, str]:
    """KEY=VALUE texts as a mapping."""
    pairs = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not equals or not key or not value:
            raise MissionError(f"--set {short(setting)}: allowed is KEY=VALUE")
        pairs[key.strip()] = value.strip()
    return pairs


def split(
    pairs: dict[str, str], raw: dict[str, Any], tree: dict[str, Any], case: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, str]]:
    """Overrides of the mission and of the design, under their full names: those of a case, and in
    their place or beside them what is set."""
    raw = deepcopy(raw)
    mission: dict[str, Any] = full_names(case, raw)
    design: dict[str, str] = {}
    apply(raw, mission)
    for key in models_first(pairs):
        if key.rsplit(".", 1)[-1] == "law":
            raise MissionError(f"--set {short(key)}: the law is chosen with --law")
        here, elsewhere = design_keys(tree)
        known = [name for name in (*leaf_keys(Mission, raw), *here) if name not in NOT_SETTABLE]
        if not any(name == key or name.endswith(f".{key}") for name in known):
            refuse_elsewhere(key, elsewhere, tree)
        full = resolve(key, known)
        if full.startswith(DESIGN_PREFIX):
            design[full.removeprefix(DESIGN_PREFIX)] = pairs[key]
        else:
            mission[full] = pairs[key]
            apply(raw, {full: pairs[key]})
    there = leaf_keys(Mission, raw, lists=True)  # a model that is set takes the case's keys away
    return {key: value for key, value in mission.items() if key in there}, design


def design_keys(tree: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Full names of the design's keys, and of those in tables that it does not have: of laws that
    are not designed, whose tables one key would not fill."""
    here: list[str] = []
    elsewhere: list[str] = []
    for name in leaf_keys(Design, tree):
        section = name.partition(".")[0]
        field = Design.model_fields[section]
        is_absent = section not in tree and not field.is_required() and field.default is None
        (elsewhere if is_absent else here).append(DESIGN_PREFIX + name)
    return here, elsewhere


def refuse_elsewhere(key: str, elsewhere: list[str], tree: Mapping[str, Any]) -> None:
    """Refuse a key that only tables have which this design does not."""
    for name in elsewhere:
        if name == key or name.endswith(f".{key}"):
            section = name.removeprefix(DESIGN_PREFIX).partition(".")[0]
            raise DesignError(
                f"--set {key}: no table [{section}] in this design, "
                f"whose laws are {', '.join(tree.get('laws', []))}"
            )


def is_told(key: str) -> bool:
    """Whether the computer is told of a mission key."""
    return key.startswith(TOLD_TO_THE_COMPUTER)


def told_of(world: Mapping[str, Value]) -> dict[str, Value]:
    """The mission keys that a load is made anew for.

    With a target comes the entry from which the ground plans to it; an entry alone is one that the
    load does not expect.
    """
    has_target = any(key.startswith("target.") for key in world)
    return {
        key: value
        for key, value in world.items()
        if is_told(key) or (has_target and key.startswith("entry."))
    }


def with_values(tree: dict[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Tables with values put in by their full dotted keys; the tables given stay as they are."""
    changed = dict(tree)
    for key, value in values.items():
        first, dot, rest = key.partition(".")
        if dot:
            below = changed.get(first, {})
            if not isinstance(below, dict):
                raise MissionError(f"{key}: {first} is {plain(below)}, allowed a table")
            changed[first] = with_values(below, {rest: value})
        else:
            changed[first] = value_of(value)
    return changed


def gains_command(folder: Path) -> str:
    """What makes the load images of a folder."""
    return shlex.join(["aeroshell", "gains", str(folder / DESIGN_NAME)])


def _remade(
    folder: Path, law: str, mission_file: Path, told: dict[str, Any], changes: dict[str, str]
) -> bytes:
    """The image of a law for a mission and design with overrides."""
    path = folder / DESIGN_NAME
    tree = with_values(read_tree(path), changes)
    design = checked_design(path, tree)
    return make(law, design, load_mission(mission_file, told), path).raw


def _check_made_for(image: LoadImage, mission: Mission, load: Path) -> None:
    """Refuse a load of another mission whose planet or vehicle is not this mission's."""
    if image.mission == mission.name:
        return
    own = np.zeros(1, ONBOARD.dtype)
    fill_onboard(own[0], world_of(mission)[0])
    given = image.body["onboard"]
    for part, name in MADE_FOR:
        theirs, ours = float(given[part][name][0]), float(own[part][name][0])
        if not math.isclose(theirs, ours, rel_tol=1e-9):
            raise FlightError(
                f"--load {load}: is made for mission {short(image.mission)}, its "
                f"onboard.{part}.{name} is {theirs:z.10g}, allowed {ours:z.10g} as in "
                f"{mission.name}"
            )


def case_values(mission: Mission, case: str | None) -> dict[str, Any]:
    """What a case of the mission changes; nothing without a case."""
    return {} if case is None else case_of(mission.cases, case, mission.name).keys


def prepare(
    target: str, law: str | None, settings: list[str], load: Path | None, case: str | None = None
) -> Prepared:
    """Mission, law and load image of a flight; raises AeroshellError with what is wrong."""
    file = find(target)
    plain = load_mission(file)
    folder = plain.gains_folder
    has_design = (folder / DESIGN_NAME).is_file()
    tree = read_tree(folder / DESIGN_NAME) if has_design else {}
    of_case = case_values(plain, case)
    world, changes = split(parse(settings), read_toml(file), tree, of_case)
    mission = load_mission(file, world) if world else plain
    if load is not None:
        if changes:
            raise FlightError(f"--load {load}: a given load takes no design key ({list(changes)})")
        image = read_image(load)
        if law is not None and image.law != law:
            raise FlightError(f"--load {load}: is for law '{image.law}', --law says '{law}'")
        _check_made_for(image, plain, load)
        return Prepared(mission, image.law, load.read_bytes(), load, False, False, case)
    chosen = law or mission.guidance.law
    if not has_design:
        raise DesignError(
            f"{folder / DESIGN_NAME} does not exist: mission {plain.name} has no gains"
        )
    designed = laws_of(tree, folder / DESIGN_NAME)
    if chosen not in designed:
        raise FlightError(
            f"law '{short(chosen)}' is not designed for {plain.name}{nearest(chosen, designed)}; "
            f"allowed {', '.join(designed)}"
        )
    told = told_of(world)
    path = image_path(folder, chosen)
    comparable = file.parent == SHIPPED and not changes and set(world) <= {SET_POINT}
    if told or changes:
        return Prepared(
            mission, chosen, _remade(folder, chosen, file, told, changes), path, True, comparable,
            case,
        )  # fmt: skip
    if not path.is_file():
        raise DesignError(f"{path} does not exist, `{gains_command(folder)}` makes it")
    return Prepared(mission, chosen, path.read_bytes(), path, False, comparable, case)
