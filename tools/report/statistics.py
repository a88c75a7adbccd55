"""What the report computes of the flights: order statistics, regressions, paired differences."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import binom, rankdata
from scipy.stats import t as student

F8 = npt.NDArray[np.float64]

LEVELS = (0.0, 0.05, 0.5, 0.95, 1.0)
CONFIDENCE = 0.9  # of an interval shown for a median or a coefficient
ROUND_OFF = 1e-9  # of a metric in its unit, or of its largest value
SAME = 1e-6  # standard deviations
SPARE = 3  # flights beyond the unknowns of a regression, at least
BAND = (0.0, 0.05, 0.5, 0.95, 1.0)
THERE_MIN = 0.5  # share of the flights that must have been at a speed for a band there


class Spread(NamedTuple):
    """A metric over the flights that tell it."""

    told: int
    least: float
    low: float
    median: float
    high: float
    most: float
    mean: float
    deviation: float


class Sensitivity(NamedTuple):
    """A metric regressed on the dispersed keys, all standardised."""

    keys: tuple[str, ...]
    coefficients: F8
    """Standard deviations of the metric's rank for one of the key's."""
    half_widths: F8
    r2: float
    r2_linear: float
    """The same of the values instead of their ranks."""


class Paired(NamedTuple):
    """A metric's difference flight by flight: another law less the first."""

    pairs: int
    low: float
    median: float
    high: float
    median_low: float
    median_high: float
    """What the median of all flights lies between, shown with the confidence."""
    smaller: float
    """Share of the flights in which it is smaller than with the first law."""
    larger: float


def finite(values: F8) -> F8:
    """The values that are told."""
    return values[np.isfinite(values)]


def quantiles(values: F8, levels: tuple[float, ...] = LEVELS) -> F8:
    """Order statistics, never between two flights."""
    return np.quantile(values, levels, method="inverted_cdf")


def spread_of(values: F8) -> Spread | None:
    """Order statistics, mean and standard deviation; None where nothing is told."""
    told = finite(values)
    if not len(told):
        return None
    deviation = float(np.std(told, ddof=1)) if len(told) > 1 else 0.0
    least, low, median, high, most = quantiles(told).tolist()
    return Spread(len(told), least, low, median, high, most, float(np.mean(told)), deviation)


def varies(values: F8) -> bool:
    """Whether two flights differ by more than round-off."""
    told = finite(values)
    return len(told) > 1 and float(np.ptp(told)) > ROUND_OFF * max(float(np.max(np.abs(told))), 1.0)


def says_the_same(values: F8, other: F8) -> bool:
    """Whether one metric is nothing but a scale of another, flight by flight."""
    there = np.isfinite(values)
    if not np.array_equal(there, np.isfinite(other)) or not (varies(values) and varies(other)):
        return False
    a, b = _standard(values[there]), _standard(other[there])
    return bool(np.max(np.abs(a - b)) < SAME)


def _standard(values: F8) -> F8:
    return (values - values.mean(axis=0)) / values.std(axis=0)


def _fit(x: F8, y: F8) -> tuple[F8, F8, float]:
    """Standardised least squares: coefficients, half widths of their intervals, R2."""
    x, y = _standard(x), _standard(y)
    found, _, rank, _ = np.linalg.lstsq(x, y, rcond=None)
    rest = float(np.sum((y - x @ found) ** 2))
    spare = len(y) - 1 - int(rank)
    inverse = np.diag(np.linalg.pinv(x.T @ x))
    half: F8 = student.ppf(0.5 + CONFIDENCE / 2.0, spare) * np.sqrt(rest / spare * inverse)
    return np.asarray(found, np.float64), half, 1.0 - rest / float(np.sum(y**2))


def sensitivity(values: F8, varied: Mapping[str, F8]) -> Sensitivity | None:
    """The regression on ranks; None where flights are too few or the metric does not vary."""
    there = np.isfinite(values)
    keys = tuple(key for key, column in varied.items() if varies(column[there]))
    if not keys or not varies(values) or there.sum() < len(keys) + 1 + SPARE:
        return None
    x = np.column_stack([varied[key][there] for key in keys])
    y = values[there]
    coefficients, half, r2 = _fit(rankdata(x, axis=0), rankdata(y))
    return Sensitivity(keys, coefficients, half, r2, _fit(x, y)[2])


def median_bounds(ascending: F8, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Order statistics that hold the median of all flights between them; infinite if too few."""
    n = len(ascending)
    outside = int(binom.ppf((1.0 - confidence) / 2.0, n, 0.5))
    if binom.cdf(outside, n, 0.5) > (1.0 - confidence) / 2.0:
        outside -= 1
    if outside < 0:
        return -np.inf, np.inf
    return float(ascending[outside]), float(ascending[n - 1 - outside])


def paired(first: F8, other: F8) -> Paired | None:
    """The differences of flights that both tell; None without any."""
    differences = np.sort(finite(other - first))
    if not len(differences):
        return None
    low, median, high = quantiles(differences, (0.05, 0.5, 0.95)).tolist()
    share = [float(np.mean(differences < 0.0)), float(np.mean(differences > 0.0))]
    return Paired(len(differences), low, median, high, *median_bounds(differences), *share)


def band(block: npt.NDArray[np.float32]) -> F8:
    """Order statistics of profiles at each knot, a row a level; NaN where few have been."""
    found = np.full((len(BAND), block.shape[1]), np.nan)
    for i in range(block.shape[1]):
        told = finite(block[:, i].astype(np.float64))
        if len(told) and len(told) >= THERE_MIN * len(block):
            found[:, i] = quantiles(told, BAND)
    return found


def distribution(values: F8, points_max: int = 400) -> tuple[F8, F8]:
    """Corners of the empirical distribution, thinned in the middle and whole at its ends."""
    ascending = np.sort(finite(values))
    n = len(ascending)
    places = np.arange(n)
    if n > points_max:
        ends = points_max // 8
        middle = np.linspace(ends, n - 1 - ends, points_max - 2 * ends).round().astype(int)
        places = np.unique(np.concatenate([places[:ends], middle, places[-ends:]]))
    return ascending[places], (places + 1.0) / n
