"""What a design chooses for the laws that track heat flux and load factor on their limits."""

from typing import Annotated, Literal

from flight_sw.guidance.heat_flux import adaptive, lqy, nominal
from sim_harness.mission.quantities import INF, Quantity, Section, Series, loaded
from tools.gains.schema import Observer


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
