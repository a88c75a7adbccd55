"""Verdicts by order statistics, against published numbers and the binomial law itself."""

import math

import numpy as np
import pytest

from sim_harness.mission.dispersion_keys import Requirement
from sim_harness.mission.requirements import (
    as_dict,
    best_probability,
    failures_allowed,
    flights_needed,
    judge,
    shown_probability,
)


@pytest.mark.parametrize("failures, flights", [(0, 1705), (1, 2880)])
def test_three_sigma_at_ten_percent_risk_needs_the_published_number_of_flights(failures, flights):
    # 99.865 % at 10 % consumer risk: 1,705 with no failure, 2,880 with one.
    assert flights_needed(failures, 0.99865, 0.9) == flights
    assert failures_allowed(flights, 0.99865, 0.9) == failures
    assert failures_allowed(flights - 1, 0.99865, 0.9) == failures - 1


def test_no_failure_shows_the_root_of_the_risk():
    # Closed form: P^n = 1 - C.
    assert shown_probability(1705, 0, 0.9) == pytest.approx(0.1 ** (1 / 1705), rel=1e-12)
    assert shown_probability(59, 0, 0.95) > 0.95 > shown_probability(58, 0, 0.95)  # Wilks


def binomial_tail(failures, flights, p):
    return sum(
        math.comb(flights, k) * (1.0 - p) ** k * p ** (flights - k) for k in range(failures + 1)
    )


@pytest.mark.parametrize("failures", [0, 1, 3, 10])
def test_the_shown_probability_puts_the_consumers_risk_on_the_binomial_tail(failures):
    shown = shown_probability(200, failures, 0.9)
    assert binomial_tail(failures, 200, shown) == pytest.approx(0.1, rel=1e-9)


@pytest.mark.parametrize("failures", [1, 3, 10])
def test_the_best_probability_puts_it_on_the_other_tail(failures):
    best = best_probability(200, failures, 0.9)
    assert 1.0 - binomial_tail(failures - 1, 200, best) == pytest.approx(0.1, rel=1e-9)


def below(maximum, probability=0.9):
    return Requirement(metric="x", max=maximum, probability=probability, confidence=0.9)


def test_enough_flights_within_the_bound_meet_it():
    verdict = judge(below(1.0), np.linspace(0.0, 1.0, 22))
    assert (verdict.verdict, verdict.failures, verdict.flights_needed) == ("met", 0, 22)
    assert verdict.quantile_high == 1.0 and verdict.worst_run == 22


def test_too_few_flights_leave_it_open_and_say_how_many_it_takes():
    verdict = judge(below(1.0), np.linspace(0.0, 1.0, 21))
    assert (verdict.verdict, verdict.flights_needed) == ("undecided", 22)
    assert verdict.quantile_high is None


def test_many_failures_refute_it():
    verdict = judge(below(0.5), np.linspace(0.0, 1.0, 100))
    assert verdict.verdict == "not met" and verdict.best_probability < 0.9


def test_a_good_mean_does_not_help():
    values = np.zeros(100)
    values[:20] = 1e-9
    assert judge(below(0.0), values).verdict == "not met"


def test_a_flight_without_the_metric_counts_as_a_failure():
    values = np.zeros(100)
    values[3] = math.nan
    verdict = judge(below(1.0, 0.999), values)
    assert (verdict.failures, verdict.worst_run) == (1, 4)
    assert as_dict(verdict)["quantile_high"] is None


def test_the_order_statistic_covers_its_quantile_with_the_confidence():
    # 93 flights at P = 0.95: k failures may be spared; coverage by simulation with known law.
    random = np.random.default_rng(5)
    exact = 0.95  # quantile of the uniform distribution
    requirement = Requirement(metric="x", max=0.0, probability=0.95, confidence=0.9)
    hits = [
        judge(requirement, random.random(93)).quantile_high >= exact for _ in range(1000)
    ]  # fmt: skip
    assert np.mean(hits) >= 0.9 - 0.03
    assert np.mean(hits) <= 0.99


def test_a_lower_bound_is_the_mirror_of_an_upper_one():
    low = Requirement(metric="x", min=-1.0, probability=0.9, confidence=0.9)
    values = np.linspace(0.0, 1.0, 60)
    mirrored = judge(low, -values)
    upper = judge(below(1.0), values)
    assert mirrored.verdict == upper.verdict == "met"
    assert mirrored.quantile_low == -upper.quantile_high
