"""What a mission file may say of navigation: the errors of its sensors and of its state."""

from typing import Annotated, Any, Literal, Self

from pydantic import model_validator

from sim_harness.mission.quantities import Meaning, Quantity, Section, plain, refusal


def noise(unit: str, high: float, what: str) -> Quantity:
    """Standard deviation of a noise."""
    return Quantity(unit, 0.0, high, f"noise of {what}, one standard deviation")


def bias(unit: str, high: float, what: str) -> Quantity:
    """A constant error."""
    return Quantity(unit, -high, high, f"constant error of {what}")


def correlation(what: str) -> Quantity:
    """Time constant of a Gauss-Markov noise."""
    return Quantity("s", 0.0, 1e6, f"time constant of the noise of {what}; 0: white")


def lag(what: str) -> Quantity:
    """Time constant of a sensor."""
    return Quantity("s", 0.0, 1e3, f"first-order lag of {what}; 0: none")


def scale(what: str) -> Quantity:
    """A sensor's slope."""
    return Quantity("-", 0.0, 10.0, f"reported over true {what}")


class Navigation(Section):
    """What navigation reports: the truth, as far as no error is set. A report is the truth of
    `latency_s` ago, through lag and scale, with constant error and noise, held inside the range of
    its CAN signal. The noise depends on the flight's seed and the report's number alone."""

    model: Annotated[
        Literal["exact", "errors"], Meaning("exact: none of the keys below may set an error")
    ] = "errors"

    position_noise_m: Annotated[float, noise("m", 1e6, "position, north and east")] = 0.0
    north_bias_m: Annotated[float, bias("m", 1e6, "position")] = 0.0
    east_bias_m: Annotated[float, bias("m", 1e6, "position")] = 0.0
    altitude_noise_m: Annotated[float, noise("m", 1e6, "altitude")] = 0.0
    altitude_bias_m: Annotated[float, bias("m", 1e6, "altitude")] = 0.0
    speed_noise_mps: Annotated[float, noise("m/s", 1e4, "speed")] = 0.0
    speed_bias_mps: Annotated[float, bias("m/s", 1e4, "speed")] = 0.0
    path_angle_noise_deg: Annotated[float, noise("deg", 90.0, "the flight-path angle")] = 0.0
    path_angle_bias_deg: Annotated[float, bias("deg", 90.0, "the flight-path angle")] = 0.0
    heading_noise_deg: Annotated[float, noise("deg", 180.0, "the heading")] = 0.0
    heading_bias_deg: Annotated[float, bias("deg", 180.0, "the heading")] = 0.0
    state_correlation_s: Annotated[float, correlation("the six above")] = 0.0

    accel_noise_mps2: Annotated[float, noise("m/s2", 1e3, "drag and lift")] = 0.0
    drag_bias_mps2: Annotated[float, bias("m/s2", 1e3, "sensed drag")] = 0.0
    lift_bias_mps2: Annotated[float, bias("m/s2", 1e3, "sensed lift")] = 0.0
    accel_scale_factor: Annotated[float, scale("drag and lift")] = 1.0
    accel_lag_s: Annotated[float, lag("the accelerometers")] = 0.0
    accel_correlation_s: Annotated[float, correlation("drag and lift")] = 0.0

    attitude_noise_deg: Annotated[float, noise("deg", 180.0, "bank and angle of attack")] = 0.0
    bank_bias_deg: Annotated[float, bias("deg", 180.0, "bank")] = 0.0
    alpha_bias_deg: Annotated[float, bias("deg", 180.0, "the angle of attack")] = 0.0
    attitude_correlation_s: Annotated[float, correlation("bank and angle of attack")] = 0.0

    heat_flux_noise_kwpm2: Annotated[float, noise("kW/m2", 1e4, "the heat flux")] = 0.0
    heat_flux_bias_kwpm2: Annotated[float, bias("kW/m2", 1e4, "the heat flux")] = 0.0
    heat_flux_scale_factor: Annotated[float, scale("heat flux")] = 1.0
    heat_flux_lag_s: Annotated[float, lag("the heat-flux sensor")] = 0.0
    heat_flux_correlation_s: Annotated[float, correlation("the heat flux")] = 0.0

    latency_s: Annotated[
        float, Quantity("s", 0.0, 1e3, "age of what is reported, to the nearest whole report")
    ] = 0.0
    dropout_ratio: Annotated[
        float, Quantity("-", 0.0, 1.0, "probability that a drop-out begins at a report")
    ] = 0.0
    dropout_s: Annotated[
        float, Quantity("s", 0.0, 1e6, "length of a drop-out, at least one report")
    ] = 0.0
    dropout_of: Annotated[
        Literal["set", "message"], Meaning("what is missing: all but the time message, or one")
    ] = "set"

    @model_validator(mode="after")
    def is_exact_where_it_says_so(self) -> Self:
        """A model without errors has none."""
        if self.model == "exact":
            for key, value in self.errors().items():
                raise refusal(
                    f".{key} is {plain(value)}, "
                    f"allowed {plain(type(self).model_fields[key].default)} with model exact"
                )
        return self

    def errors(self) -> dict[str, Any]:
        """The keys that differ from an exact navigation."""
        fields = type(self).model_fields
        return {k: v for k, v in self if k != "model" and v != fields[k].default}
