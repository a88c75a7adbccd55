"""Fills what the adaptive laws add to the inner loop: weights, and how they track and hand over."""

import math
from typing import Any

from flight_sw.guidance.heat_flux.adaptive import HUGE, RATES
from flight_sw.guidance.heat_flux.peak import PEAK_BY
from flight_sw.records.types_ import Record
from tools.gains.heat_flux.choices import Sag, Tracking
from tools.gains.observer import fill_observer

NOT_NOMINAL_S = 1e-9  # a filter faster than this takes the newest value whole


def _share(filter_s: float, period_s: float) -> float:
    """Share of the error that a first-order filter takes in a period."""
    return -math.expm1(-period_s / max(filter_s, NOT_NOMINAL_S))


def fill_weights(record: Record, choice: Sag) -> None:
    """Table 3 into the two trackers of a TRACKING record."""
    for name in ("heat_flux", "load"):
        tracker = record[name]
        tracker["t_p_1prad2"] = getattr(choice, f"t_p_{name}_1prad2")
        tracker["t_i_1prad2ps"] = getattr(choice, f"t_i_{name}_1prad2ps")
        tracker["k_initial_ratio"] = getattr(choice, f"k_initial_{name}_ratio")
        tracker["leak_1ps"] = getattr(choice, f"leak_{name}_1ps")
        tracker["rate_s"] = getattr(choice, f"rate_{name}_s")
        tracker["error_max_rad"] = min(math.radians(choice.error_max_deg), HUGE)
        tracker["gain_max_ratio"] = min(choice.gain_max_ratio, HUGE)


def fill_tracking(law: Record, choice: Tracking, period_s: float) -> dict[str, Any]:
    """The choices beside the source, into the parts of a law's record that they change.

    Returns what the provenance tells of the observer.
    """
    tracking, nominal, loop = law["tracking"], law["nominal"], law["inner_loop"]
    tracking["rate_source"] = RATES.index(choice.rate)
    tracking["holds_integral"] = choice.integral == "held"
    tracking["hands_over"] = choice.hand_over == "bumpless"
    loop["guard_ratio"] = choice.guard_ratio
    if choice.rate == "observer":
        nominal["peak_by"] = PEAK_BY.index("samples")  # of the observer, which no few frames move
    nominal["peak_floor_ratio"] = choice.peak_floor_ratio
    nominal["peak_scale_exponent"] = choice.peak_scale_exponent
    if choice.path_loop == "designed":
        for name in ("k_gamma_p_mps2prad", "k_gamma_i_mps3prad", "k_gamma_d_mpsprad"):
            nominal[name] = 0.0
        # V gamma'' + k_p V gamma' + k_i V gamma: of second order, its frequency that of the design
        nominal["k_gamma_p_1ps"] = 2.0 * choice.path_loop_damping * choice.path_loop_radps
        nominal["k_gamma_i_1ps2"] = choice.path_loop_radps**2
    if choice.adaptation_s > 0.0:
        nominal["adaptation_share_ratio"] = _share(choice.adaptation_s, period_s)
    nominal["adaptation_load_min_g"] = choice.adaptation_load_min_g
    nominal["adaptation_max_ratio"] = choice.adaptation_max_ratio
    return {"observer": fill_observer(tracking["observer"], choice.observer, period_s)}
