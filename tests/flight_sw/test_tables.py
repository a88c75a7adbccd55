"""Bracketed interpolation against numpy, at and beyond every edge."""

import math

import numpy as np
import pytest

from flight_sw.model.tables import between, bracket, locate

GRID = np.array([-2.0, 0.0, 0.5, 3.0, 10.0])
COLUMN = np.array([4.0, -1.0, 7.0, 7.5, -3.0])


def interp(x: float, grid: np.ndarray, column: np.ndarray, n: int) -> float:
    return between(column, *locate(x, grid, n))


@pytest.mark.parametrize(
    "x, i",
    [(-9.0, 0), (-2.0, 0), (-0.1, 0), (0.0, 1), (0.4, 1), (0.5, 2), (2.9, 2), (3.0, 3), (10.0, 3),
     (99.0, 3)],
)  # fmt: skip
def test_bracket_finds_the_interval_and_stays_inside(x, i):
    assert bracket(x, GRID, 5) == i


def test_interp_agrees_with_numpy():
    rng = np.random.default_rng(20260101)
    for x in np.concatenate([rng.uniform(-4.0, 12.0, 500), GRID]):
        want = np.interp(x, GRID, COLUMN)
        assert interp(x, GRID, COLUMN, 5) == pytest.approx(want, rel=1e-14, abs=1e-14)


def test_only_the_first_n_rows_count():
    assert interp(9.0, GRID, COLUMN, 3) == 7.0
    assert interp(0.25, GRID, COLUMN, 3) == 3.0


def test_single_row_is_constant():
    for x in (-5.0, -2.0, 5.0):
        assert interp(x, GRID, COLUMN, 1) == 4.0


@pytest.mark.parametrize("n", [1, 2, 5])
def test_nan_gives_nan(n):
    assert math.isnan(interp(math.nan, GRID, COLUMN, n))


def test_long_grid_is_searched_in_full():
    grid = np.arange(100_000.0)
    for x in (0.0, 1.5, 49_999.0, 99_998.5):
        assert bracket(x, grid, 100_000) == int(x)
