"""Samples follow the distributions that the mission file states, and what is wrong is said."""

import math

import numpy as np
import pytest

from flight_sw.errors import MissionError
from sim_harness.mission.dispersion_keys import Dispersions, Fixed, Normal, Uniform
from sim_harness.mission.dispersions import draw, extremes, set_of
from sim_harness.mission.documents import read_toml
from sim_harness.mission.mission import find
from sim_harness.world.missions import mission_of

UNIFORM = Uniform(model="uniform", low=-20.0, high=10.0)
NORMAL = Normal(model="normal", sigma=2.0, cut_sigmas=1.0)
PRESENT = {"mass": 450.0, "speed": 7800.0, "angle": -3.0}
N = 4096


def drawn(keys, sampling="sobol", n=N, seed=1, correlations=()):
    spread = Dispersions(sampling=sampling, keys=keys, correlations=list(correlations))
    return draw(spread, PRESENT, n, seed, "dispersions.own")


@pytest.mark.parametrize("sampling", ["sobol", "latin-hypercube", "random"])
def test_uniform_values_fill_their_interval_evenly(sampling):
    values = drawn({"mass": UNIFORM}, sampling).values[:, 0]
    assert values.min() >= 430.0 and values.max() <= 460.0
    counts, _ = np.histogram(values, bins=8, range=(430.0, 460.0))
    # Six sigma of a binomial count for the plain one; the others are far more even.
    assert np.abs(counts - N / 8).max() <= (
        6.0 * math.sqrt(N * 7 / 64) if sampling[0] == "r" else 2
    )


def test_a_relative_spread_is_a_share_of_the_value():
    wide = Uniform(model="uniform", low=-0.1, high=0.1, scale="relative")
    values = drawn({"speed": wide}).values[:, 0]
    assert values.min() == pytest.approx(7020.0, abs=1.0)
    assert values.max() == pytest.approx(8580.0, abs=1.0)


def test_a_normal_spread_is_cut_where_it_says_and_has_the_moments_of_the_cut_law():
    values = drawn({"speed": NORMAL}).values[:, 0] - 7800.0
    assert np.abs(values).max() <= 2.0
    # Variance of a standard normal cut at 1: 1 - 2 phi(1) / (2 Phi(1) - 1).
    phi = math.exp(-0.5) / math.sqrt(2.0 * math.pi)
    variance = 1.0 - 2.0 * phi / math.erf(1.0 / math.sqrt(2.0))
    assert values.mean() == pytest.approx(0.0, abs=0.01)
    assert values.std() == pytest.approx(2.0 * math.sqrt(variance), rel=0.01)


@pytest.mark.parametrize("coefficient", [-0.8, 0.3])
def test_correlated_keys_have_the_rank_correlation_of_their_copula(coefficient):
    group = {"keys": ["mass", "angle"], "coefficient": coefficient}
    wide = Normal(model="normal", sigma=1.0, cut_sigmas=8.0)
    values = drawn({"mass": UNIFORM, "angle": wide, "speed": NORMAL}, correlations=[group]).values
    ranks = np.argsort(np.argsort(values, axis=0), axis=0)
    got = np.corrcoef(ranks.T)
    # Spearman's of a Gaussian copula; keys are sorted: angle, mass, speed.
    want = 6.0 / math.pi * math.asin(coefficient / 2.0)
    assert got[0, 1] == pytest.approx(want, abs=0.03)
    assert abs(got[0, 2]) < 0.03 and abs(got[1, 2]) < 0.03


def test_the_order_of_keys_and_a_fixed_one_change_nothing():
    a = drawn({"mass": UNIFORM, "speed": NORMAL})
    b = drawn({"speed": NORMAL, "angle": Fixed(model="fixed", value=-2.0), "mass": UNIFORM})
    assert a.keys == b.keys == ("mass", "speed")
    assert np.array_equal(a.values, b.values) and np.array_equal(a.seeds, b.seeds)


def test_another_seed_is_another_sample_and_every_flight_has_its_own():
    a, b = drawn({"mass": UNIFORM}), drawn({"mass": UNIFORM}, seed=2)
    assert not np.any(a.values == b.values)
    assert len(set(a.seeds.tolist())) == N and not np.any(a.seeds == b.seeds)


def test_a_shorter_sobol_campaign_flies_the_beginning_of_a_longer_one():
    long, short = drawn({"mass": UNIFORM}, n=64), drawn({"mass": UNIFORM}, n=33)
    assert np.array_equal(long.values[:33], short.values)
    assert np.array_equal(long.seeds[:33], short.seeds)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_few_flights_are_drawn_too(n):
    assert drawn({"mass": UNIFORM}, n=n).values.shape == (n, 1)


def test_extremes_are_the_ends():
    spread = Dispersions(keys={"mass": UNIFORM, "speed": NORMAL})
    assert extremes(spread, PRESENT, "x") == {"mass": (430.0, 460.0), "speed": (7798.0, 7802.0)}


def test_correlations_that_contradict_each_other_are_refused():
    pairs = [("mass", "speed", 0.9), ("speed", "angle", 0.9), ("mass", "angle", -0.9)]
    groups = [{"keys": [a, b], "coefficient": c} for a, b, c in pairs]
    with pytest.raises(MissionError, match="contradict each other"):
        drawn({"mass": UNIFORM, "speed": NORMAL, "angle": UNIFORM}, correlations=groups)


def test_a_correlation_of_a_key_that_does_not_vary_is_refused():
    group = {"keys": ["mass", "sped"], "coefficient": 0.5}
    with pytest.raises(MissionError, match="names sped, nearest is speed"):
        drawn({"mass": UNIFORM, "speed": NORMAL}, correlations=[group])


def test_a_value_beside_nothing_is_refused():
    with pytest.raises(MissionError, match="lies beside None, which is no finite number"):
        drawn({"latitude": UNIFORM})


def test_an_unknown_set_is_refused_with_the_nearest():
    sets = {"severe": Dispersions(keys={"mass": UNIFORM})}
    with pytest.raises(MissionError) as caught:
        set_of(sets, "sever", "own")
    assert str(caught.value) == (
        'dispersion set "sever" is not one of own, nearest is severe; allowed severe'
    )
    with pytest.raises(MissionError, match=r"its file has no \[dispersions\]"):
        set_of({}, "severe", "own")


MASS = "dispersions.own.vehicle.mass_kg"


@pytest.mark.parametrize(
    "entry, sentence",
    [
        ({"model": "uniform", "low": 1.0, "high": -1.0}, f"{MASS}.low is 1, allowed below high -1"),
        (
            {"model": "unifrm", "low": 1.0, "high": 2.0},
            f'{MASS}.model is "unifrm", nearest is uniform; allowed uniform, normal, fixed',
        ),
        (3.0, f"{MASS} is 3, allowed a table"),
        (
            {"model": "normal", "sigma": 0.0},
            f"{MASS}.sigma is 0, allowed 1e-12 to 1000000000",
        ),
    ],
)
def test_a_wrong_entry_is_refused_in_one_sentence(entry, sentence):
    raw = read_toml(find("hyperion-1"))
    raw["dispersions"] = {"own": {"vehicle": {"mass_kg": entry}}}
    with pytest.raises(MissionError) as caught:
        mission_of(raw, find("hyperion-1"), "own.toml")
    assert str(caught.value) == f"own.toml: {sentence}"
