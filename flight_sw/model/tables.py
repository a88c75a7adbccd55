"""Bracketed linear interpolation, shared by the flight software and the world.

Limits: grids ascend strictly and hold at least one value; outside its range a table holds the edge
value. A NaN argument gives NaN.
"""

import math

from flight_sw.records.types_ import F8
from flight_sw.runtime.jit import kernel

BISECTIONS_MAX = 32  # halves a grid of up to 2**32 values down to one interval


@kernel
def bracket(x: float, grid: F8, n: int) -> int:
    """Index i of the interval grid[i] <= x < grid[i + 1]; outside the grid its first or last."""
    low = 0
    high = n - 1
    for _ in range(BISECTIONS_MAX):
        if high - low <= 1:
            break
        middle = (low + high) >> 1
        if x < grid[middle]:
            high = middle
        else:
            low = middle
    return low


@kernel
def locate(x: float, grid: F8, n: int) -> tuple[int, float]:
    """Row of x in the first n of a grid, and its share of the way to the next: 0 outside."""
    if x <= grid[0]:
        return 0, 0.0
    if x >= grid[n - 1]:
        return n - 1, 0.0
    if n < 2:
        return 0, x  # NaN against a single row
    i = bracket(x, grid, n)
    return i, (x - grid[i]) / (grid[i + 1] - grid[i])


@kernel
def between(column: F8, row: int, share: float) -> float:
    """Value of a column at a place; a share of 0 does not touch the next row, NaN is passed on."""
    if share == 0.0:
        return column[row]
    if math.isnan(share):
        return share
    return column[row] + share * (column[row + 1] - column[row])
