"""The histogram of durations against numpy's percentiles."""

import numpy as np
import pytest

from flight_sw.runtime.histogram import (
    BINS,
    FRACTIONS,
    HISTOGRAM,
    LONGEST_NS,
    SUB,
    add,
    bin_of,
    percentiles_us,
    upper_edge_ns,
)

RELATIVE_WIDTH = 1.0 / SUB  # of a bin: what the docstring promises


def filled(durations_ns: np.ndarray) -> np.ndarray:
    """A histogram with these durations."""
    histogram = np.zeros(1, HISTOGRAM)
    for duration_ns in durations_ns:
        add(histogram[0], int(duration_ns))
    return histogram


@pytest.mark.parametrize("spread", [0.1, 1.0, 2.0])
def test_percentiles_are_numpys_to_the_width_of_a_bin(spread: float) -> None:
    rng = np.random.default_rng(20260306)
    durations = np.exp(rng.normal(np.log(5000.0), spread, 4000)).astype(np.int64)
    found = percentiles_us(filled(durations)[0])
    for name, fraction in FRACTIONS.items():
        exact = np.quantile(durations, fraction, method="inverted_cdf") / 1e3
        assert exact <= found[name] <= exact * (1.0 + RELATIVE_WIDTH), name
    assert found["max"] == durations.max() / 1e3


def test_sum_and_count_are_exact() -> None:
    durations = np.array([1, 5, 100, 12_345, 5_000_000_000])
    histogram = filled(durations)[0]
    assert (histogram["n"], histogram["sum_ns"]) == (5, durations.sum())
    assert histogram["max_ns"] == 5_000_000_000


def test_bins_follow_each_other_without_gap_or_overlap() -> None:
    edges = [upper_edge_ns(i) for i in range(BINS)]
    assert edges == sorted(set(edges))
    assert edges[-1] == LONGEST_NS
    for i, edge in enumerate(edges):
        assert bin_of(edge) == i
        if i + 1 < BINS:
            assert bin_of(edge + 1) == i + 1


@pytest.mark.parametrize("duration_ns", range(2 * SUB))
def test_short_durations_are_exact(duration_ns: int) -> None:
    assert upper_edge_ns(bin_of(duration_ns)) == duration_ns


@pytest.mark.parametrize(("duration_ns", "index"), [(-5, 0), (0, 0), (1 << 40, BINS - 1)])
def test_what_lies_outside_is_counted_in_the_nearest_bin(duration_ns: int, index: int) -> None:
    assert bin_of(duration_ns) == index


def test_an_empty_histogram_has_zeros() -> None:
    empty = percentiles_us(np.zeros(1, HISTOGRAM)[0])
    assert empty == {"p50": 0.0, "p99": 0.0, "p999": 0.0, "max": 0.0}


def test_one_duration_is_all_percentiles() -> None:
    found = percentiles_us(filled(np.array([777]))[0])
    assert set(found.values()) == {0.777}  # no percentile lies above the exact maximum
