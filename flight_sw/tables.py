"""Bracketed linear interpolation, shared by the flight software and the world.

Limits: grids ascend strictly and hold at least one value; outside its range a table holds the edge
value. A NaN argument gives NaN.
"""

from flight_sw.jit import kernel
from flight_sw.types_ import F8

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
def interp(x: float, grid: F8, column: F8, n: int) -> float:
    """Value of the first n rows of `column` at x: linear inside the grid, held outside."""
    if x <= grid[0]:
        return column[0]
    if x >= grid[n - 1]:
        return column[n - 1]
    if n < 2:
        return x  # NaN against a single row: passed on
    i = bracket(x, grid, n)
    fraction = (x - grid[i]) / (grid[i + 1] - grid[i])
    return column[i] + fraction * (column[i + 1] - column[i])
