"""The report's statistics against closed forms, its words against names."""

import math

import numpy as np
import pytest
from scipy.stats import binom

from tools.report.statistics import (
    band,
    distribution,
    median_bounds,
    paired,
    says_the_same,
    sensitivity,
    spread_of,
    varies,
)
from tools.report.words import column_numbers, name_of, number, percent, unit_text

GRID = np.arange(9.0)
A, B = (axis.ravel() for axis in np.meshgrid(GRID, GRID))


def test_a_sum_of_two_keys_is_shared_out_as_its_factors():
    found = sensitivity(2.0 * A - 1.0 * B, {"a": A, "b": B, "same": np.ones(81)})
    assert found.keys == ("a", "b")
    assert found.coefficients == pytest.approx([2 / math.sqrt(5), -1 / math.sqrt(5)], abs=0.03)
    assert found.r2_linear == pytest.approx(1.0)


def test_a_monotone_curve_is_explained_by_ranks_and_not_by_values():
    found = sensitivity(np.exp(2.0 * A), {"a": A})
    assert found.r2 == pytest.approx(1.0)
    assert found.coefficients == pytest.approx([1.0])
    assert found.r2_linear < 0.5


def test_chance_alone_explains_little_and_its_interval_holds_zero():
    noise = np.random.default_rng(20260101).normal(size=81)
    found = sensitivity(noise, {"a": A})
    assert found.r2 < 0.1
    assert abs(found.coefficients[0]) < found.half_widths[0]


def test_too_few_flights_are_no_regression():
    assert sensitivity(A[:4], {"a": A[:4], "b": B[:4]}) is None
    assert sensitivity(np.full(81, 3.0), {"a": A}) is None
    assert sensitivity(np.full(81, np.nan), {"a": A}) is None


def test_the_median_lies_between_its_bounds_as_often_as_they_say():
    n = 100
    low, high = median_bounds(np.arange(float(n)))
    inside = binom.cdf(high - 1 + 1, n, 0.5) - binom.cdf(low, n, 0.5)  # order statistics from 0
    assert inside >= 0.9
    tighter = binom.cdf(high - 1, n, 0.5) - binom.cdf(low + 1, n, 0.5)
    assert tighter < 0.9
    assert median_bounds(np.arange(3.0)) == (-np.inf, np.inf)


def test_pairs_are_those_that_both_tell():
    found = paired(np.array([1.0, 2.0, np.nan, 4.0]), np.array([2.0, 1.0, 5.0, np.nan]))
    assert (found.pairs, found.smaller, found.larger) == (2, 0.5, 0.5)
    assert paired(np.array([np.nan]), np.array([1.0])) is None


def test_a_band_ends_where_less_than_half_the_flights_have_been():
    block = np.full((10, 2), np.nan, np.float32)
    block[:, 0] = np.arange(10)
    block[:4, 1] = 1.0
    found = band(block)
    assert found[:, 0].tolist() == [0.0, 0.0, 4.0, 9.0, 9.0]
    assert np.isnan(found[:, 1]).all()


def test_a_thinned_distribution_keeps_its_ends_and_its_shares():
    values = np.random.default_rng(1).permutation(5000.0 * np.arange(5000))
    x, share = distribution(values, 400)
    assert len(x) <= 400
    assert x[:50].tolist() == (5000.0 * np.arange(50)).tolist()
    assert x[-1] == values.max()
    assert share == pytest.approx((x / 5000.0 + 1.0) / 5000.0)


def test_round_off_is_no_variation_and_a_scale_no_metric_of_its_own():
    assert not varies(np.array([1e-14, 2e-14, np.nan]))
    assert not varies(1e6 + np.array([0.0, 1e-6]))
    assert varies(np.array([1.0, 1.001]))
    assert says_the_same(A, 9.81 * A)
    assert not says_the_same(A, A + 0.01 * B)
    assert spread_of(np.array([np.nan])) is None


@pytest.mark.parametrize(
    ("ending", "text"),
    [("kwpm2", "kW/m²"), ("mps", "m/s"), ("mjpm2", "MJ/m²"), ("degs", "deg s"), ("gs", "g s"),
     ("kpa", "kPa"), ("kgpm3", "kg/m³"), ("1ps", "1/s"), ("km", "km"), ("ms", "ms"),
     ("radps2", "rad/s²"), ("reversals", ""), ("coefficient", "")],
)  # fmt: skip
def test_units_are_read_from_names(ending, text):
    assert unit_text(ending) == text


@pytest.mark.parametrize(
    ("key", "label"),
    [
        ("heat_flux_max_after_activation_kwpm2", "peak heat flux after activation, kW/m²"),
        ("load_factor_max_ratio", "peak load factor / limit"),
        ("heat_flux_over_s", "heat flux over limit, s"),
        ("bank_reversals", "bank reversals"),
    ],
)
def test_names_become_words(key, label):
    assert name_of(key).label == label


def test_numbers_have_the_digits_that_matter():
    assert [number(v) for v in (12345.6, 5.0, 0.012345, -3.14159, float("nan"))] == [
        "12,346", "5", "0.01235", "-3.142", "\N{EN DASH}",
    ]  # fmt: skip
    assert column_numbers([1250.123, 0.5]) == ["1,250", "0"]
    assert column_numbers([1.0, 2.0]) == ["1", "2"]
    assert [percent(v) for v in (0.0, 0.5, 0.99865, 1.0, 0.00013)] == [
        "0.0 %", "50.0 %", "99.87 %", "100.0 %", "0.013 %",
    ]  # fmt: skip
