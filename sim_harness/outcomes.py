"""The class of a finished flight: one word for how it went, the gravest that applies."""

import math
from collections.abc import Mapping
from typing import Any

from sim_harness.dispersion_keys import Judgement
from sim_harness.world.records import OUTCOMES, SKIPPED_OUT

NOMINAL = "nominal"
LIMIT_EXCEEDED = "limit exceeded"
SKIP_OUT = "skip-out"
SHORT = "short"
SATURATED = "saturated"
NUMERICAL = "numerical"
BUS = "bus"
CLASSES = (NOMINAL, LIMIT_EXCEEDED, SKIP_OUT, SHORT, SATURATED, NUMERICAL, BUS)
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
RATIOS = (
    ("heat_flux_max_ratio", "heat_flux_ratio_max"),
    ("load_factor_max_ratio", "load_factor_ratio_max"),
    ("dynamic_pressure_max_ratio", "dynamic_pressure_ratio_max"),
)


def _is_beyond(value: Any, bound: float) -> bool:
    return value is not None and not value <= bound


def outcome_class(facts: Mapping[str, Any], judgement: Judgement) -> str:
    """The class of a flight from its scalars."""
    if any(isinstance(v, float) and not math.isfinite(v) for v in facts.values()):
        return NUMERICAL
    if (ended := BY_OUTCOME.get(facts["outcome"])) is not None:
        return ended
    if _is_beyond(facts.get("downrange_error_km"), judgement.short_of_target_km):
        return SHORT
    if any(_is_beyond(facts.get(ratio), getattr(judgement, bound)) for ratio, bound in RATIOS):
        return LIMIT_EXCEEDED
    saturated_s = facts["bank_saturated_s"] + facts["alpha_saturated_s"]
    if saturated_s > judgement.saturated_share_max * facts["flight_time_s"]:
        return SATURATED
    return NOMINAL
