"""Whether flights show that a requirement is met: order statistics of binomial samples, no means.

A requirement: a metric keeps its bound with at least a probability P. Of n independent flights k do
not keep it. It is shown with confidence C if a vehicle that keeps it with P or less would have had
so few failures with a chance of at most 1 - C, the consumer's risk: the lower one-sided
Clopper-Pearson bound on the probability is then at least P.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import betaincinv
from scipy.stats import binom

from sim_harness.mission.dispersion_keys import Requirement

MET, NOT_MET, UNDECIDED = "met", "not met", "undecided"
FLIGHTS_MAX = 1 << 40  # where a search for a number of flights ends


class Verdict(NamedTuple):
    """A requirement judged by a campaign."""

    title: str
    metric: str
    bound: str
    probability: float
    confidence: float
    flights: int
    failures: int
    shown_probability: float
    """The probability of keeping the bound that the flights show with the confidence."""
    best_probability: float
    """And the one they leave possible: below the required one the requirement is not met."""
    quantile_low: float | None
    """No more than 1 - P of all flights lie below this, shown with the confidence; for a `min`."""
    quantile_high: float | None
    """No more than 1 - P lie above this; None where the flights are too few to show any."""
    flights_needed: int
    """To show it with as many failures as there were."""
    worst_run: int | None
    verdict: str


def shown_probability(flights: int, failures: int, confidence: float) -> float:
    """Lower one-sided Clopper-Pearson bound on the probability of no failure."""
    if failures >= flights:
        return 0.0
    return float(betaincinv(flights - failures, failures + 1, 1.0 - confidence))


def best_probability(flights: int, failures: int, confidence: float) -> float:
    """Upper one-sided bound."""
    if failures == 0:
        return 1.0
    return float(betaincinv(flights - failures + 1, failures, confidence))


def flights_needed(failures: int, probability: float, confidence: float) -> int:
    """The fewest flights that show a probability with this many failures."""

    def shows(flights: int) -> bool:
        return bool(binom.cdf(failures, flights, 1.0 - probability) <= 1.0 - confidence)

    high = failures + 1
    while not shows(high) and high < FLIGHTS_MAX:
        high *= 2
    low = high // 2
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if shows(middle) else (middle + 1, high)
    return high


def failures_allowed(flights: int, probability: float, confidence: float) -> int:
    """The most failures with which so many flights show a probability; -1 if none will do."""
    if flights < flights_needed(0, probability, confidence):
        return -1
    low = 0
    high = math.ceil(flights * (1.0 - probability)) + 1
    while low < high:
        middle = (low + high + 1) // 2
        shown = binom.cdf(middle, flights, 1.0 - probability) <= 1.0 - confidence
        low, high = (middle, high) if shown else (low, middle - 1)
    return low


def bound_on_quantile(
    ascending: npt.NDArray[np.float64], probability: float, confidence: float
) -> float | None:
    """The order statistic that at most 1 - P of all flights exceed, with confidence C."""
    spare = failures_allowed(len(ascending), probability, confidence)
    return float(ascending[len(ascending) - 1 - spare]) if spare >= 0 else None


def bound_text(requirement: Requirement) -> str:
    """The bound in words."""
    low, high = requirement.min, requirement.max
    if low is not None and high is not None:
        return f"{low:.12g} to {high:.12g}"
    return f">= {low:.12g}" if low is not None else f"<= {high:.12g}"


def excess(requirement: Requirement, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """How far values lie beyond the bound, negative within; not a number is infinitely far."""
    beyond = np.full(len(values), -np.inf)
    if requirement.max is not None:
        beyond = np.maximum(beyond, values - requirement.max)
    if requirement.min is not None:
        beyond = np.maximum(beyond, requirement.min - values)
    return np.where(np.isnan(values), np.inf, beyond)


def judge(requirement: Requirement, values: npt.NDArray[np.float64]) -> Verdict:
    """The verdict on the values of all flights, run by run; not a number counts as a failure."""
    p, confidence = requirement.probability, requirement.confidence
    beyond = excess(requirement, values)
    flights, failures = len(values), int(np.sum(beyond > 0.0))
    shown = shown_probability(flights, failures, confidence)
    best = best_probability(flights, failures, confidence)
    verdict = MET if shown >= p else NOT_MET if best < p else UNDECIDED
    ascending = np.sort(np.where(np.isnan(values), np.inf, values))
    descending = np.sort(np.where(np.isnan(values), np.inf, -values))
    lowest = bound_on_quantile(descending, p, confidence) if requirement.min is not None else None
    return Verdict(
        requirement.title or requirement.metric,
        requirement.metric,
        bound_text(requirement),
        p,
        confidence,
        flights,
        failures,
        shown,
        best,
        -lowest if lowest is not None else None,
        bound_on_quantile(ascending, p, confidence) if requirement.max is not None else None,
        flights_needed(failures, p, confidence),
        int(np.argmax(beyond)) + 1 if flights else None,
        verdict,
    )


def as_dict(verdict: Verdict) -> dict[str, Any]:
    """For JSON: infinite order statistics become null."""
    told = verdict._asdict()
    return {
        k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in told.items()
    }
