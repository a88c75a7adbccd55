"""What a `design.toml` holds: every choice of the guidance engineer, with unit and range."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from flight_sw.errors import DesignError
from flight_sw.guidance import LAWS
from flight_sw.guidance.heat_flux import adaptive, lqy, nominal
from flight_sw.limits import AXIS_LIMITS
from flight_sw.load_image import DIVIDER_MAX
from flight_sw.modes import MODE_DESIGN
from flight_sw.reception.plausibility import GATES
from sim_harness.mission.documents import quoted, read_toml
from sim_harness.mission.errors import sentence
from sim_harness.mission.quantities import (
    INF,
    Quantity,
    Section,
    Series,
    Text,
    loaded,
    plain,
    refusal,
)
from tools.gains.drag_choices import DragTracking, NominalFlight, RangePredictor


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


def angle(meaning: str) -> Quantity:
    """A design angle."""
    return Quantity("deg", -180.0, 180.0, meaning)


class Nominal(Section):
    """[MOOIJ18] III.A.1; the path limits themselves are the mission's."""

    alpha_before_peak_deg: Annotated[float, angle("until the heat-flux peak")]
    alpha_after_peak_deg: Annotated[float, angle("from the peak on")]
    bank_before_tracking_deg: Annotated[float, angle("until tracking")] = 0.0
    scale_height_m: Annotated[
        float, loaded(nominal.DESIGN, "scale_height_m", "m", "of the path law")
    ]
    k_gamma_p_mps2prad: Annotated[
        float, loaded(nominal.DESIGN, "k_gamma_p_mps2prad", "m/s2/rad", "Eq. 17")
    ]
    k_gamma_i_mps3prad: Annotated[
        float, loaded(nominal.DESIGN, "k_gamma_i_mps3prad", "m/s3/rad", "Eq. 17")
    ]
    k_gamma_d_mpsprad: Annotated[
        float, loaded(nominal.DESIGN, "k_gamma_d_mpsprad", "m/s/rad", "Eq. 17")
    ]
    k_flow_p_rad: Annotated[float, loaded(nominal.DESIGN, "k_flow_p_rad", "rad", "Eq. 23")]
    k_flow_d_heat_flux_rads: Annotated[
        float, loaded(nominal.DESIGN, "k_flow_d_heat_flux_rads", "rad s", "Eq. 23")
    ]
    k_flow_d_load_rads: Annotated[
        float, loaded(nominal.DESIGN, "k_flow_d_load_rads", "rad s", "Eq. 23")
    ]
    transition_start_ratio: Annotated[
        float, loaded(nominal.DESIGN, "transition_start_ratio", "-", "of the load limit, Eq. 18")
    ]
    transition_duration_s: Annotated[
        float, loaded(nominal.DESIGN, "transition_duration_s", "s", "Eq. 21")
    ]
    release_exponent: Annotated[
        float,
        loaded(nominal.DESIGN, "release_exponent", "-", "heat-flux tracking ends below this n"),
    ]
    peak_drop_kwpm2: Annotated[
        float,
        loaded(
            nominal.DESIGN,
            "peak_drop_wpm2",
            "kW/m2",
            "a heat-flux peak is one from so far below it; noise",
        ),
    ] = 0.0
    peak_by: Literal["samples", "model"] = "model"
    """What makes a heat-flux peak: falling samples, as printed, or with the model's consent."""


class Lqy(Section):
    """Weights and operating points of the output regulator."""

    heat_flux_error_max_kwpm2: Annotated[float, Quantity("kW/m2", 1e-3, 1e6, "Bryson")]
    load_error_max_g: Annotated[float, Quantity("g", 1e-4, 1e3, "Bryson")]
    bank_error_max_deg: Annotated[float, Quantity("deg", 1e-3, 360.0, "Bryson")]
    lead_s: Annotated[float, loaded(lqy.INNER_LOOP, "lead_s", "s", "c_gamma of Eq. 30")]
    band_ratio: Annotated[
        float, loaded(lqy.INNER_LOOP, "band_ratio", "-", "of the set point: no tracking beyond")
    ]
    decay_s: Annotated[float, loaded(lqy.INNER_LOOP, "decay_s", "s", "Eq. 31")]
    speeds_mps: Annotated[
        tuple[float, ...], Series("m/s", 1.0, 1e5, "operating points", 32, 2, ascending=True)
    ]
    bank_design_low_deg: Annotated[float, Quantity("deg", 0.1, 179.0, "clip of the design")] = 20.0
    bank_design_high_deg: Annotated[float, Quantity("deg", 1.0, 179.9, "clip of the design")] = (
        160.0
    )
    speed_scale_ratio: Annotated[
        float, Quantity("-", 1e-3, 1e3, "speed over it scales the speed state")
    ] = 6.0


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


class Sag(Section):
    """[MOOIJ18] Table 3 and Eq. 40, and the limits that it lacks."""

    t_p_heat_flux_1prad2: Annotated[
        float, loaded(adaptive.TRACKER, "t_p_1prad2", "1/rad2", "Eq. 36")
    ]
    t_i_heat_flux_1prad2ps: Annotated[
        float, loaded(adaptive.TRACKER, "t_i_1prad2ps", "1/(rad2 s)", "Eq. 35")
    ]
    k_initial_heat_flux_ratio: Annotated[
        float, loaded(adaptive.TRACKER, "k_initial_ratio", "-", "Eq. 37")
    ]
    leak_heat_flux_1ps: Annotated[float, loaded(adaptive.TRACKER, "leak_1ps", "1/s", "Eq. 41")]
    rate_heat_flux_s: Annotated[float, loaded(adaptive.TRACKER, "rate_s", "s", "Eq. 40")]
    t_p_load_1prad2: Annotated[float, loaded(adaptive.TRACKER, "t_p_1prad2", "1/rad2", "Eq. 36")]
    t_i_load_1prad2ps: Annotated[
        float, loaded(adaptive.TRACKER, "t_i_1prad2ps", "1/(rad2 s)", "Eq. 35")
    ]
    k_initial_load_ratio: Annotated[
        float, loaded(adaptive.TRACKER, "k_initial_ratio", "-", "Eq. 37")
    ]
    leak_load_1ps: Annotated[float, loaded(adaptive.TRACKER, "leak_1ps", "1/s", "Eq. 41")]
    rate_load_s: Annotated[float, loaded(adaptive.TRACKER, "rate_s", "s", "Eq. 40")]
    error_max_deg: Annotated[
        float,
        loaded(
            adaptive.TRACKER, "error_max_rad", "deg", "inf: none, as in the source", or_inf=True
        ),
    ] = INF
    gain_max_ratio: Annotated[
        float,
        loaded(adaptive.TRACKER, "gain_max_ratio", "-", "inf: none, as in the source", or_inf=True),
    ] = INF


class Tracking(Section):
    """How `sag` and `integrated` sense, track and hand over: the source's way, or a better one."""

    rate: Literal["difference", "analytic", "observer"]
    """Of the heat-flux error: backward difference (the source); from path angle and drag; observed,
    and then the heat flux itself too."""
    integral: Literal["runs", "held"]
    """The path-angle integral while a tracker is active; it runs in the source."""
    hand_over: Literal["fade", "bumpless"]
    """At the release the error fades (Eq. 31), or the correction goes into the integral."""
    path_loop: Literal["printed", "designed"]
    """Gains of Eq. 17 as [nominal] has them, or those of a loop with a frequency of its own."""
    path_loop_radps: Annotated[float, Quantity("rad/s", 1e-4, 10.0, "of the designed one")] = 0.05
    path_loop_damping: Annotated[float, Quantity("-", 0.0, 10.0, "of the designed one")] = 0.7
    guard_ratio: Annotated[
        float,
        loaded(
            lqy.INNER_LOOP,
            "guard_ratio",
            "-",
            "of the set point: too hot is fed back after the release",
        ),
    ] = 0.0
    adaptation_s: Annotated[
        float, Quantity("s", 0.0, 1e4, "filter on sensed over modelled forces; 0: the model alone")
    ] = 0.0
    adaptation_load_min_g: Annotated[
        float, loaded(nominal.DESIGN, "adaptation_load_min_g", "g", "nothing learnt below")
    ] = 0.05
    adaptation_max_ratio: Annotated[
        float, loaded(nominal.DESIGN, "adaptation_max_ratio", "-", "largest departure")
    ] = 0.5
    peak_floor_ratio: Annotated[
        float,
        loaded(
            nominal.DESIGN, "peak_floor_ratio", "-", "of the set point: no heat-flux peak below it"
        ),
    ] = 0.0
    peak_scale_exponent: Annotated[
        float,
        loaded(
            nominal.DESIGN,
            "peak_scale_exponent",
            "-",
            "of set point over a lower peak, on the constant",
        ),
    ] = 1.0
    observer: Observer


class Design(Section):
    """The whole file."""

    mission: Annotated[str, Text("a shipped mission, or a path relative to this file", "a name")]
    laws: list[str] = Field(min_length=1)
    timing: Timing = Timing()
    modes: Modes
    limits: Limits
    gates: Gates = Gates()
    nominal: Nominal | None = None
    lqy: Lqy | None = None
    sag: Sag | None = None
    tracking: Tracking | None = None
    nominal_flight: NominalFlight = NominalFlight()
    drag: DragTracking | None = None
    drag_observer: Observer | None = None
    range_predictor: RangePredictor | None = None

    @model_validator(mode="after")
    def _has_known_laws(self) -> Self:
        for law in self.laws:
            if law not in LAWS:
                raise refusal(f"laws names {quoted(law)}, allowed {', '.join(LAWS)}")
        return self


def read_tree(path: Path) -> dict[str, Any]:
    """The file as nested tables; raises DesignError if it cannot be read as TOML."""
    return read_toml(path, DesignError, str(path))


def design_of(tree: dict[str, Any], where: str) -> Design:
    """The checked design; raises DesignError with file, key, value and what is allowed."""
    try:
        return Design.model_validate(tree)
    except ValidationError as error:
        problems = "; ".join(sentence(Design, tree, e) for e in error.errors()[:3])
        raise DesignError(f"{where}: {problems}") from error


def laws_of(tree: dict[str, Any], path: Path) -> list[str]:
    """The laws that a design names; raises DesignError where its list is none."""
    laws = tree.get("laws", [])
    if not isinstance(laws, list) or not all(isinstance(law, str) for law in laws):
        raise DesignError(f"{path}: laws is {plain(laws)}, allowed a list of names of laws")
    return laws
