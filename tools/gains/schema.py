"""What every `design.toml` holds: choices of the guidance engineer, each with unit and range."""

from typing import Annotated, Literal, Self, TypeVar

from pydantic import Field, model_validator

from flight_sw.errors import DesignError
from flight_sw.guidance import LAWS
from flight_sw.limits import AXIS_LIMITS
from flight_sw.load_image import DIVIDER_MAX
from flight_sw.modes import MODE_DESIGN
from flight_sw.reception.plausibility import GATES
from sim_harness.mission.documents import quoted
from sim_harness.mission.quantities import (
    INF,
    Quantity,
    Section,
    Text,
    loaded,
    refusal,
)

S = TypeVar("S", bound=Section)


class Timing(Section):
    """Rates inside the flight computer."""

    guidance_divider: Annotated[
        int, Quantity("minor frames", 1, DIVIDER_MAX, "per guidance step, a whole number")
    ] = 1

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if self.guidance_divider != int(self.guidance_divider):
            raise refusal(f"guidance_divider is {self.guidance_divider:g}, allowed a whole number")
        return self


class Modes(Section):
    """Thresholds of the mode table, and what is held before entry."""

    entry_load_g: Annotated[float, Quantity("g", 0.0, 10.0, "sensed; guidance runs from here")]
    terminal_speed_mps: Annotated[
        float, loaded(MODE_DESIGN, "terminal_speed_mps", "m/s", "the last command is held below it")
    ]
    nav_timeout_s: Annotated[float, Quantity("s", 1e-3, 100.0, "without a fix: SAFE")] = 0.5
    nav_return_s: Annotated[float, Quantity("s", 1e-3, 100.0, "of fixes ends SAFE")] = 0.2
    coast_bank_deg: Annotated[
        float, loaded(MODE_DESIGN, "coast_bank_rad", "deg", "held before entry")
    ] = 0.0
    coast_alpha_deg: Annotated[
        float, loaded(MODE_DESIGN, "coast_alpha_rad", "deg", "held before entry")
    ] = 0.0


class Axis(Section):
    """Command limits of one axis."""

    low_deg: Annotated[float, loaded(AXIS_LIMITS, "low_rad", "deg", "smallest command")]
    high_deg: Annotated[float, loaded(AXIS_LIMITS, "high_rad", "deg", "largest command")]
    rate_max_degps: Annotated[
        float, loaded(AXIS_LIMITS, "rate_max_radps", "deg/s", "inf: none", or_inf=True)
    ] = INF
    accel_max_degps2: Annotated[
        float, loaded(AXIS_LIMITS, "accel_max_radps2", "deg/s2", "inf: none", or_inf=True)
    ] = INF

    @model_validator(mode="after")
    def _is_ordered(self) -> Self:
        if not self.low_deg < self.high_deg:
            raise refusal(f"low_deg is {self.low_deg:g}, allowed below high_deg {self.high_deg:g}")
        return self


class Limits(Section):
    """Command limits."""

    bank: Axis
    alpha: Axis


class Gates(Section):
    """How far navigation may move from one fix to the next before it is disbelieved."""

    distance_margin_m: Annotated[
        float, loaded(GATES, "distance_margin_m", "m", "beyond speed times time")
    ] = 200.0
    accel_max_mps2: Annotated[float, loaded(GATES, "accel_max_mps2", "m/s2", "change of speed")] = (
        400.0
    )
    turn_rate_max_degps: Annotated[
        float, loaded(GATES, "turn_rate_max_radps", "deg/s", "change of path angle and heading")
    ] = 60.0
    sensed_ratio: Annotated[
        float,
        loaded(
            GATES, "sensed_ratio", "-", "change of a sensed acceleration in a frame, of its value"
        ),
    ] = 1.5
    sensed_margin_mps2: Annotated[
        float, loaded(GATES, "sensed_margin_mps2", "m/s2", "and beyond that")
    ] = 0.5
    heat_flux_ratio_ps: Annotated[
        float, loaded(GATES, "heat_flux_ratio_ps", "1/s", "change of heat flux, of its value")
    ] = 2.0
    heat_flux_margin_kwpm2: Annotated[
        float, loaded(GATES, "heat_flux_margin_wpm2", "kW/m2", "and beyond that")
    ] = 2.0
    attitude_margin_deg: Annotated[
        float,
        loaded(GATES, "attitude_margin_rad", "deg", "beyond what lies between flown and commanded"),
    ] = 3.0
    agreement_s: Annotated[
        float, Quantity("s", 1e-3, 100.0, "refused sets that agree for so long are believed")
    ] = 0.5


class Observer(Section):
    """A high-gain observer: the rate of a measured quantity. Laws that need one embed this."""

    eps_s: Annotated[float, Quantity("s", 1e-3, 1e3, "smaller: faster, and more of the noise")]
    l1: Annotated[float, Quantity("-", 1e-3, 1e3, "on the value; poles s^2 + l1 s + l2, over eps")]
    l2: Annotated[float, Quantity("-", 1e-3, 1e3, "on the rate")]
    coast_max_s: Annotated[
        float, Quantity("s", 0.0, 1e3, "bridged by the model without a measurement")
    ] = 1.0
    hold: Literal["zero", "first"] = "zero"
    """The measurement between two steps: held, or straight from one to the next."""


class CommonDesign(Section):
    """What every design has; the families add tables of their own, see tools/gains/design.py."""

    mission: Annotated[str, Text("a shipped mission, or a path relative to this file", "a name")]
    laws: list[str] = Field(min_length=1)
    timing: Timing = Timing()
    modes: Modes
    limits: Limits
    gates: Gates = Gates()

    @model_validator(mode="after")
    def _has_known_laws(self) -> Self:
        for law in self.laws:
            if law not in LAWS:
                raise refusal(f"laws names {quoted(law)}, allowed {', '.join(LAWS)}")
        return self

    def table(self, kind: type[S], name: str, law: str) -> S:
        """A family's table by its name; raises DesignError where it is missing."""
        found = getattr(self, name, None)
        if not isinstance(found, kind):
            raise DesignError(f"laws: {law} needs a table [{name}], which is missing")
        return found
