"""Missions as files state them: a shipped one or a file of one's own, with overrides."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

from pydantic import Field, PrivateAttr, ValidationError, model_validator

from flight_sw.errors import MissionError
from sim_harness.mission.air_keys import AerodynamicDeviation, DensityDeviation, Wind
from sim_harness.mission.dispersion_keys import Dispersions, Judgement, Requirement, grouped
from sim_harness.mission.documents import quoted, read_toml, short
from sim_harness.mission.errors import (
    TAG,
    annotation_at,
    chosen,
    item_of,
    nearest,
    sections_of,
    sentences,
)
from sim_harness.mission.keys import (
    Actuators,
    End,
    Entry,
    ExponentialAtmosphere,
    Guidance,
    Heating,
    Limits,
    Planet,
    TableAtmosphere,
    Target,
    Us76Atmosphere,
    Vehicle,
)
from sim_harness.mission.navigation_keys import Navigation
from sim_harness.mission.quantities import Section, Text, is_name, plain, refusal
from sim_harness.mission.site_keys import NoFlyZone, Waypoint

SHIPPED = Path(__file__).parents[1] / "missions"
GAINS = Path(__file__).parents[2] / "gains"
SUFFIX = ".toml"


class Mission(Section):
    """A mission as its file states it, in the file's units; its world is made in SI from it."""

    name: Annotated[
        str, Text("short name, used for folders", "lower-case letters, digits, . _ -", is_name)
    ]
    title: Annotated[str, Text("one line that `aeroshell missions` shows", "a text")]
    source: Annotated[str, Text("where the numbers come from")] = ""
    planet: Planet
    atmosphere: Annotated[
        ExponentialAtmosphere | Us76Atmosphere | TableAtmosphere, Field(discriminator="model")
    ]
    wind: Wind = Wind()
    vehicle: Vehicle
    heating: Heating | None = None
    entry: Entry
    target: Target | None = None
    waypoints: list[Waypoint] = Field(default=[])
    no_fly_zones: list[NoFlyZone] = Field(default=[])
    limits: Limits = Limits()
    end: End = End()
    actuators: Actuators = Actuators()
    navigation: Navigation = Navigation()
    guidance: Guidance
    dispersions: dict[str, Dispersions] = Field(default={})
    judgement: Judgement = Judgement()
    requirements: list[Requirement] = Field(default=[])

    _path: Path = PrivateAttr(default=Path("mission.toml"))

    @model_validator(mode="after")
    def starts_in_flight(self) -> Self:
        """The entry state does not meet the end condition, and lies within the stops."""
        if not self.entry.altitude_km > self.end.altitude_km:
            raise refusal(
                f"end.altitude_km is {self.end.altitude_km}, "
                f"allowed below entry.altitude_km {self.entry.altitude_km}"
            )
        for key in ("at_target", "at_target_energy"):
            if getattr(self.end, key) == "yes" and self.target is None:
                raise refusal(f"end.{key} is yes, allowed with a table [target] alone")
        for axis, angle in (("bank", "bank_deg"), ("alpha", "angle_of_attack_deg")):
            stops = getattr(self.actuators, axis)
            value = getattr(self.entry, angle)
            if not stops.low_deg <= value <= stops.high_deg:
                raise refusal(
                    f"entry.{angle} is {value}, allowed {stops.low_deg} to {stops.high_deg} deg "
                    f"by actuators.{axis}"
                )
        return self

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self._path

    @property
    def dt_s(self) -> float:
        """A minor frame."""
        return 1.0 / self.guidance.rate_hz

    @property
    def gains_folder(self) -> Path:
        """Folder of design and load images: named in the file, or the shipped one of its name."""
        if self.guidance.gains is not None:
            return self._path.parent / self.guidance.gains
        return GAINS / self.name

    def as_modelled(self) -> Self:
        """The mission as the ground models it: without factors, random profiles and winds."""
        density, forces = DensityDeviation().model_dump(), AerodynamicDeviation().model_dump()
        aerodynamics = self.vehicle.aerodynamics.model_copy(update=forces)
        changes = {
            "atmosphere": self.atmosphere.model_copy(update=density),
            "vehicle": self.vehicle.model_copy(update={"aerodynamics": aerodynamics}),
            "wind": Wind(),
        }
        return self.model_copy(update=changes)


class Shipped(NamedTuple):
    """A mission that comes with the package."""

    name: str
    title: str
    path: Path


def list_missions() -> list[Shipped]:
    """The shipped missions by name."""
    found = []
    for path in sorted(SHIPPED.glob(f"*{SUFFIX}")):
        found.append(Shipped(path.stem, str(read_toml(path).get("title", "")), path))
    return found


def read_mission(
    name_or_path: str | Path, overrides: Mapping[str, float | str] | None = None
) -> Mission:
    """A shipped mission by name, or one's own by the path of its TOML file, not yet tried out.

    `world.missions.load_mission` also refuses what cannot be flown.
    """
    path = find(name_or_path)
    raw = read_toml(path)
    label = path.name
    if overrides:
        apply(raw, overrides)
        label = f"{path.name} with overrides"
    return stated_mission(raw, path, label)


def stated_mission(raw: dict[str, Any], path: Path, label: str) -> Mission:
    """The mission that a file's tables state; `label` is what a refusal calls them."""
    if "dispersions" in raw:
        raw = {**raw, "dispersions": grouped(raw["dispersions"])}
    try:
        mission = Mission.model_validate(raw)
    except ValidationError as error:
        raise MissionError("\n".join(sentences(Mission, raw, error, label))) from None
    mission._path = path
    return mission


def find(name_or_path: str | Path) -> Path:
    """The file of a shipped mission or of a path."""
    text = str(name_or_path)
    if text.endswith(SUFFIX) or "/" in text:
        path = Path(text)
        if not os.path.isfile(path):
            raise MissionError(f"mission file {short(text)} does not exist or is not a file")
        return path
    path = SHIPPED / f"{text}{SUFFIX}"
    if not is_name(text) or not os.path.isfile(path):
        names = [p.stem for p in sorted(SHIPPED.glob(f"*{SUFFIX}"))]
        raise MissionError(
            f"mission {quoted(text)} is not shipped{nearest(text, names)}; "
            f"allowed {', '.join(names)} or the path of a {SUFFIX} file"
        )
    return path


def leaf_keys(section: type[Section], raw: Any, prefix: str = "") -> list[str]:
    """Dotted names of all keys that take one value, given the models the file selects."""
    keys: list[str] = []
    for key, field in section.model_fields.items():
        dotted = prefix + key
        below = raw.get(key) if isinstance(raw, dict) else None
        if sections_of(item_of(field.annotation)):
            continue
        if not sections_of(field.annotation):
            keys.append(dotted)
        elif (inner := chosen(field.annotation, below)) is not None:
            keys.extend(leaf_keys(inner, below, f"{dotted}."))
    return keys


def differences(mission: Mission) -> dict[str, float | str]:
    """The keys in which a mission differs from its file, with its values: as overrides."""
    found: dict[str, float | str] = {}
    own, plain = mission.model_dump(), read_mission(mission.path).model_dump()
    for key in leaf_keys(Mission, own):
        value, stated = _value_at(own, key), _value_at(plain, key)
        if value != stated and isinstance(value, float | int | str):
            found[key] = value
    return found


def _value_at(tree: Any, key: str) -> Any:
    """The value of a dotted key; None where there is none."""
    for name in key.split("."):
        tree = tree.get(name) if isinstance(tree, dict) else None
    return tree


def value_of(text: float | str) -> float | str:
    """An override's number where it reads as one, else its text."""
    try:
        return float(text)
    except ValueError:
        return text


def resolve(key: str, known: list[str]) -> str:
    """The dotted key an override means."""
    if key in known:
        return key
    matches = [name for name in known if name.endswith(f".{key}")]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise MissionError(f"{key} is ambiguous, allowed {', '.join(matches)}")
    raise MissionError(
        f"{short(key)} is not a known key{nearest(key, known)}; "
        f"allowed are {len(known)} keys, docs/missions.md lists those of a mission"
    )


def models_first(keys: Iterable[str]) -> list[str]:
    """Dotted keys in the order in which to write them: models decide which others exist."""
    return sorted(keys, key=lambda key: key.rsplit(".", 1)[-1] != TAG)


def apply(raw: dict[str, Any], overrides: Mapping[str, float | str]) -> None:
    """Writes overrides into what the file said; another model takes over only what it shares."""
    for key in models_first(overrides):
        *parents, leaf = resolve(key, leaf_keys(Mission, raw)).split(".")
        before = annotation_at(Mission, raw, tuple(parents))
        table = raw
        for parent in parents:
            table = table.setdefault(parent, {})
            if not isinstance(table, dict):
                raise MissionError(f"{key}: {parent} is {plain(table)}, allowed a table")
        table[leaf] = value_of(overrides[key])
        after = annotation_at(Mission, raw, tuple(parents))
        if leaf == TAG and after is not before and isinstance(after, type):
            for name in [name for name in table if not _is_shared(name, before, after)]:
                del table[name]


def _is_shared(name: str, before: Any, after: type[Section]) -> bool:
    """Whether two sections mean the same by a key."""
    if name == TAG:
        return True
    known, wanted = (getattr(section, "model_fields", {}).get(name) for section in (before, after))
    return known is not None and wanted is not None and known.annotation == wanted.annotation
