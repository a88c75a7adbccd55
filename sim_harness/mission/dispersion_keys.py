"""What a mission file says of campaigns: dispersion sets, classes of outcome, requirements.

A set has one entry for each key it disperses, under the key's own dotted name. In the file the
entries stand beside the set's options; `grouped` gathers them under `keys` before they are checked.
"""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from sim_harness.mission.quantities import INF, Quantity, Section, Text, is_number, refusal

OPTIONS = ("sampling", "correlations", "keys")


class Uniform(Section):
    """Evenly between two bounds beside the nominal value."""

    model: Literal["uniform"]
    low: Annotated[float, Quantity("-", -1e9, 1e9, "lower bound, as an offset or a share")]
    high: Annotated[float, Quantity("-", -1e9, 1e9, "upper bound, likewise")]
    scale: Literal["absolute", "relative"] = "absolute"
    beside: Annotated[
        float | None, Quantity("-", -1e12, 1e12, "value it is beside, if not the file's")
    ] = None
    told_to: Literal["world", "both"] = "world"

    @model_validator(mode="after")
    def is_ordered(self) -> Self:
        """The lower bound lies below the upper one."""
        if not self.low < self.high:
            raise refusal(f".low is {self.low:.12g}, allowed below high {self.high:.12g}")
        return self

    @property
    def ends(self) -> tuple[float, float]:
        """The outermost offsets."""
        return self.low, self.high


class Normal(Section):
    """Normal about the nominal value, cut off."""

    model: Literal["normal"]
    sigma: Annotated[float, Quantity("-", 1e-12, 1e9, "before the cut, as an offset or a share")]
    cut_sigmas: Annotated[float, Quantity("-", 0.1, 8.0, "no value lies farther out")] = 3.0
    scale: Literal["absolute", "relative"] = "absolute"
    beside: Annotated[
        float | None, Quantity("-", -1e12, 1e12, "value it is about, if not the file's")
    ] = None
    told_to: Literal["world", "both"] = "world"

    @property
    def ends(self) -> tuple[float, float]:
        """The outermost offsets."""
        return -self.sigma * self.cut_sigmas, self.sigma * self.cut_sigmas


class Fixed(Section):
    """The same value in every flight of the set, other than the file's."""

    model: Literal["fixed"]
    value: Annotated[float, Quantity("-", -INF, INF, "in the key's unit")]
    told_to: Literal["world", "both"] = "world"


Spread = Annotated[Uniform | Normal | Fixed, Field(discriminator="model")]


WORDS = {word for spread in (Uniform, Normal, Fixed) for word in spread.model_fields}


class Correlation(Section):
    """Keys that vary together: a Gaussian copula with this coefficient between each two."""

    keys: list[str] = Field(min_length=2)
    coefficient: Annotated[float, Quantity("-", -0.999, 0.999, "of the normal scores")]


class Dispersions(Section):
    """What varies from flight to flight of a campaign, and how."""

    sampling: Literal["sobol", "latin-hypercube", "random"] = "sobol"
    correlations: list[Correlation] = Field(default=[])
    keys: dict[str, Spread] = Field(min_length=1)


class Judgement(Section):
    """From where on a flight of a campaign counts as limit exceeded, saturated or short."""

    heat_flux_ratio_max: Annotated[
        float, Quantity("-", 0.0, INF, "peak over limit: beyond it, limit exceeded")
    ] = 1.0
    load_factor_ratio_max: Annotated[float, Quantity("-", 0.0, INF, "likewise")] = 1.0
    dynamic_pressure_ratio_max: Annotated[float, Quantity("-", 0.0, INF, "likewise")] = 1.0
    saturated_share_max: Annotated[
        float, Quantity("-", 0.0, 1.0, "of the flight time on a command limit: saturated")
    ] = 0.5
    plan_target_error_max: Annotated[
        float, Quantity("-", 0.0, INF, "e_t of the plan that was flown: beyond it, out of reach")
    ] = 1.0
    short_of_target_km: Annotated[
        float, Quantity("km", 0.0, INF, "range missing to the target: short")
    ] = INF


class Requirement(Section):
    """A bound that a metric must keep with a probability, shown with a confidence."""

    metric: Annotated[str, Text("a scalar of summary.json", "a name")]
    max: Annotated[float | None, Quantity("-", -INF, INF, "kept at or below")] = None
    min: Annotated[float | None, Quantity("-", -INF, INF, "kept at or above")] = None
    probability: Annotated[float, Quantity("-", 1e-6, 1.0 - 1e-9, "of keeping it")]
    confidence: Annotated[float, Quantity("-", 0.5, 1.0 - 1e-9, "1 less the consumer's risk")] = 0.9
    title: Annotated[str, Text("what it is about")] = ""

    @model_validator(mode="after")
    def has_a_bound(self) -> Self:
        """At least one bound, in order."""
        if self.max is None and self.min is None:
            raise refusal("has no bound, allowed max, min or both")
        if self.max is not None and self.min is not None and not self.min <= self.max:
            raise refusal(f".min is {self.min:.12g}, allowed to max {self.max:.12g}")
        return self


def is_entry(table: dict[str, Any]) -> bool:
    """Whether a table says how a key varies, rather than naming a part of a key's path."""
    return any(word in WORDS and not isinstance(value, dict) for word, value in table.items())


def _entries(table: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Entries by dotted key: a table without any word of an entry is a part of a key's path."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict) and not is_entry(value):
            found.update(_entries(value, f"{prefix}{key}."))
        else:
            found[prefix + key] = value
    return found


def grouped(raw: Any) -> Any:
    """The file's `[dispersions]` with each set's entries under `keys`, by their dotted names."""
    if not isinstance(raw, dict):
        return raw
    sets = {}
    for name, table in raw.items():
        if not isinstance(table, dict):
            sets[name] = table
            continue
        options = {k: v for k, v in table.items() if k in OPTIONS}
        spreads = _entries({k: v for k, v in table.items() if k not in OPTIONS})
        own = options.get("keys", {})
        # what is no table stays as it is, and is refused where the keys are checked
        sets[name] = {**options, "keys": {**own, **spreads} if isinstance(own, dict) else own}
    return sets


def nominal_of(spread: Uniform | Normal, value: object) -> float | None:
    """What an entry is beside: its own value, or the mission's value if that is a number."""
    if spread.beside is not None:
        return spread.beside
    return float(value) if is_number(value) else None  # type: ignore[arg-type]
