"""The class of a finished flight: one word for how it went, the gravest that applies."""

import math
from collections.abc import Mapping
from typing import Any

from sim_harness.mission.dispersion_keys import Judgement
from sim_harness.world.records import OUTCOMES, SKIPPED_OUT

NOMINAL = "nominal"
LIMIT_EXCEEDED = "limit exceeded"
SKIP_OUT = "skip-out"
OUT_OF_REACH = "out of reach"
SHORT = "short"
SATURATED = "saturated"
NUMERICAL = "numerical"
BUS = "bus"
CLASSES = (
    NOMINAL, LIMIT_EXCEEDED, SKIP_OUT, SHORT, SATURATED, NUMERICAL, BUS, OUT_OF_REACH,
)  # fmt: skip
NOT_FLOWN = (NUMERICAL, BUS)
"""Classes whose other numbers mean nothing."""

BY_OUTCOME = {
    "bus lost": BUS,
    "flight computer silent": BUS,
    "numerical": NUMERICAL,
    OUTCOMES[SKIPPED_OUT]: SKIP_OUT,
    "ground": SHORT,
    "time out": SHORT,
}
RATIOS = {
    "heat flux": ("heat_flux_max_ratio", "heat_flux_ratio_max"),
    "load factor": ("load_factor_max_ratio", "load_factor_ratio_max"),
    "dynamic pressure": ("dynamic_pressure_max_ratio", "dynamic_pressure_ratio_max"),
}
"""Each limit's ratio among a flight's scalars, and the key of the judgement that bounds it."""
TOGETHER = ", "  # between the limits that one flight exceeded


def _is_beyond(value: Any, bound: float) -> bool:
    return value is not None and not value <= bound


def limits_exceeded(facts: Mapping[str, Any], judgement: Judgement) -> str:
    """The limits that a flight exceeded by more than is allowed; empty if none."""
    names = [
        name
        for name, (ratio, bound) in RATIOS.items()
        if _is_beyond(facts.get(ratio), getattr(judgement, bound))
    ]
    return TOGETHER.join(names)


def outcome_class(facts: Mapping[str, Any], judgement: Judgement) -> str:
    """The class of a flight from its scalars."""
    if any(isinstance(v, float) and not math.isfinite(v) for v in facts.values()):
        return NUMERICAL
    ended = BY_OUTCOME.get(facts["outcome"])
    if ended not in (None, SHORT):
        return ended
    saturated_s = facts["bank_saturated_s"] + facts["alpha_saturated_s"]
    missing_km, plan = facts.get("downrange_error_km"), facts.get("plan_target_error")
    found = {
        OUT_OF_REACH: _is_beyond(plan, judgement.plan_target_error_max),
        SHORT: ended == SHORT or _is_beyond(missing_km, judgement.short_of_target_km),
        LIMIT_EXCEEDED: bool(limits_exceeded(facts, judgement)),
        SATURATED: saturated_s > judgement.saturated_share_max * facts["flight_time_s"],
    }
    return next((name for name, applies in found.items() if applies), NOMINAL)
