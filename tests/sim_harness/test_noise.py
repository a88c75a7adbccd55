"""Random numbers against the published vectors, a twin in plain integers, and their statistics."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from sim_harness.jit import kernel
from sim_harness.world import noise
from sim_harness.world.noise import gaussians, philox, uniforms
from tests.conftest import UNCOMPILED

SAMPLES = 4_000 if UNCOMPILED else 200_000
STREAMS = {
    name: value for name, value in vars(noise).items() if name.startswith(("NAV", "AIR", "WIND"))
}


def philox_twin(counter: int, key: int) -> int:
    """Philox4x32-10 on Python's integers: 128-bit counter and result, 64-bit key."""
    words = [(counter >> 32 * i) & 0xFFFFFFFF for i in range(4)]
    keys = [key & 0xFFFFFFFF, key >> 32]
    for step in range(10):
        left, right = 0xD2511F53 * words[0], 0xCD9E8D57 * words[2]
        round_keys = [
            (keys[0] + step * 0x9E3779B9) % 2**32,
            (keys[1] + step * 0xBB67AE85) % 2**32,
        ]
        words = [
            (right >> 32) ^ words[1] ^ round_keys[0],
            right % 2**32,
            (left >> 32) ^ words[3] ^ round_keys[1],
            left % 2**32,
        ]
    return sum(word << 32 * i for i, word in enumerate(words))


@kernel
def fill(seed, stream, first, out):
    """Gaussians in column 0 and 1, uniforms in 2 and 3, from index `first` on."""
    for i in range(len(out)):
        out[i, 0], out[i, 1] = gaussians(seed, stream, first + i)
        out[i, 2], out[i, 3] = uniforms(seed, stream, first + i)


def drawn(seed: int, stream: int, first: int = 0, n: int = SAMPLES) -> np.ndarray:
    """n rows of numbers."""
    out = np.zeros((n, 4))
    fill(seed, stream, first, out)
    return out


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [  # known answers published with Random123, the authors' own code
        ([0] * 4, [0] * 2, [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
        ([0xFFFFFFFF] * 4, [0xFFFFFFFF] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
        (
            [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
            [0xA4093822, 0x299F31D0],
            [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
        ),
    ],
)
def test_words_are_the_published_ones(counter: list[int], key: list[int], words: list[int]) -> None:
    given = [np.uint64(word) for word in counter + key]
    assert [int(word) for word in philox(*given)] == words


@pytest.mark.parametrize("seed", [0, 1, 20261125, 2**63 - 1])
@pytest.mark.parametrize("index", [0, 1, 44_848, 2**40 + 7])
def test_uniforms_are_the_twins(seed: int, index: int) -> None:
    for stream in STREAMS.values():
        bits = philox_twin(index | stream << 64, seed)
        first, second = (bits % 2**64) >> 11, bits >> 75
        assert uniforms(seed, stream, index) == (first / 2**53, second / 2**53)


def test_gaussians_are_the_transform_of_the_uniforms() -> None:
    rows = drawn(5, noise.NAV_AERO, n=200)
    radius = np.sqrt(-2.0 * np.log(1.0 - rows[:, 2]))
    assert rows[:, 0] == pytest.approx(radius * np.cos(2.0 * np.pi * rows[:, 3]), abs=1e-12)
    assert rows[:, 1] == pytest.approx(radius * np.sin(2.0 * np.pi * rows[:, 3]), abs=1e-12)


def test_the_stream_numbers_are_distinct() -> None:
    assert len(set(STREAMS.values())) == len(STREAMS) == 10


@pytest.mark.parametrize("column", [0, 1, 2, 3])
def test_distributions_are_normal_and_uniform(column: int) -> None:
    """Kolmogorov-Smirnov; the seed is fixed, so that a p of 1 % cannot come up by chance later."""
    x = drawn(20261125, noise.NAV_AERO)[:, column]
    law = stats.norm if column < 2 else stats.uniform
    assert stats.kstest(x, law.cdf).pvalue > 0.01
    error = law.std() / math.sqrt(SAMPLES)
    assert abs(x.mean() - law.mean()) < 3.0 * error
    assert x.std() == pytest.approx(law.std(), rel=3.0 / math.sqrt(2.0 * SAMPLES))


def test_neighbours_in_seed_stream_and_index_are_uncorrelated() -> None:
    columns = []
    for seed, stream, first in itertools.product((7, 8), (1, 2), (0, 1)):
        columns += list(drawn(seed, stream, first)[:, :2].T)
    # An index shifted by one is the same sequence: each is compared row by row
    correlation = np.corrcoef(columns)[np.triu_indices(len(columns), 1)]
    assert np.abs(correlation).max() < 4.5 / math.sqrt(SAMPLES)


def test_successive_numbers_are_uncorrelated() -> None:
    x = drawn(3, noise.NAV_HEATING)[:, 0]
    for lag in (1, 2, 3, 10, 50):
        assert abs(np.mean(x[lag:] * x[:-lag])) < 4.0 / math.sqrt(SAMPLES)


def test_numbers_do_not_depend_on_what_was_drawn_before() -> None:
    whole = drawn(11, noise.WIND_EAST, 0, 100)
    assert np.array_equal(drawn(11, noise.WIND_EAST, 60, 40), whole[60:])
    assert not np.array_equal(drawn(12, noise.WIND_EAST, 0, 100), whole)


def test_the_smallest_uniform_gives_a_finite_gaussian() -> None:
    """1 - u is at least 2**-53."""
    assert math.sqrt(-2.0 * math.log(2.0**-53)) == pytest.approx(8.57, abs=0.01)
    rows = drawn(0, noise.NAV_DROPOUT)
    assert np.isfinite(rows).all()
    assert rows[:, 2:].max() < 1.0
    assert rows[:, 2:].min() >= 0.0
