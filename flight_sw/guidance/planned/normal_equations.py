"""Small symmetric systems of equations, in place; rows that say nothing new are left out."""

from flight_sw.records.types_ import F8
from flight_sw.runtime.jit import kernel

PIVOT_MIN = 1e-14  # of the largest element: below, a row says nothing new


@kernel
def solve_symmetric(rows: F8) -> bool:
    """Gauss-Jordan on symmetric normal equations, the solution in the last column.

    A pivot that is nothing beside the largest is left out, and its unknown is 0.
    """
    n = len(rows)
    largest = 0.0
    for i in range(n):
        largest = max(largest, rows[i, i])
    if not largest > 0.0:
        return False
    for i in range(n):
        pivot = rows[i, i]
        if not pivot > PIVOT_MIN * largest:
            for j in range(n + 1):
                rows[i, j] = 0.0
            for j in range(n):
                rows[j, i] = 0.0
            continue
        for j in range(n + 1):
            rows[i, j] = rows[i, j] / pivot
        for m in range(n):
            if m != i:
                factor = rows[m, i]
                for j in range(n + 1):
                    rows[m, j] = rows[m, j] - factor * rows[i, j]
    return True
