"""How finely a quantity is shown: the least span of an axis, by the unit on it.

Below it lie round-off and the steps of a signal, nothing that a person should look at. Review and
report ask here, whatever draws their axes.
"""

import math

LEAST_SPAN = {
    "km": 0.01, "m": 1.0, "deg": 0.1, "rad": 0.001, "deg/s": 0.01, "deg s": 1.0,
    "kW/m²": 1.0, "kW/m²/s": 0.1, "MJ/m²": 0.1, "MJ/kg": 0.01, "kPa": 0.01, "Pa": 1.0,
    "m/s": 0.1, "m/s²": 0.01, "m/s³": 0.001, "g": 0.01, "g s": 0.01, "s": 0.1, "ms": 0.1,
    "µs": 1.0, "Hz": 1.0,
}  # fmt: skip
LEAST_OF_OTHERS = 0.01  # pure numbers and ratios
ROUND_OFF = 1e-6  # of the largest value, for what has another unit


def least_span(unit: str, largest: float = 1.0) -> float:
    """The least that an axis spans in this unit, with values up to `largest`."""
    if unit in LEAST_SPAN:
        return LEAST_SPAN[unit]
    return LEAST_OF_OTHERS if unit in ("", "-") else ROUND_OFF * (abs(largest) or 1.0)


def widened(low: float, high: float, unit: str) -> tuple[float, float] | None:
    """The ends of an axis for values that lie closer than can be told apart; else None."""
    least = least_span(unit, max(abs(low), abs(high)))
    if not math.isfinite(high - low) or high - low >= least:
        return None
    middle = round((low + high) / 2.0 / least) * least
    return middle - least, middle + least
