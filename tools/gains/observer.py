"""Discrete form of the high-gain observer over a guidance period, exact for its inputs."""

import cmath
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from flight_sw.records.types_ import Record
from tools.gains.schema import Observer

ROWS, COLUMNS = ("value", "rate"), ("value", "rate", "measured", "newest", "accel")


def continuous(choice: Observer) -> npt.NDArray[np.float64]:
    """Rates of (value, rate) from value, rate, measurement and model.  [YANHE] Eq. 25"""
    first, second = choice.l1 / choice.eps_s, choice.l2 / choice.eps_s**2
    return np.array([[-first, 1.0, first, 0.0], [-second, 0.0, second, 1.0]])


def discrete(choice: Observer, period_s: float) -> npt.NDArray[np.float64]:
    """(value, rate) after a period, from them before it, the measurement at its beginning and its
    end, and the model: states and inputs in one matrix exponential."""
    whole = np.zeros((5, 5))  # value, rate, measurement, its change over the period, model
    whole[:2, [0, 1, 2, 4]] = continuous(choice) * period_s
    if choice.hold == "first":
        whole[2, 3] = 1.0
    from scipy.linalg import expm  # slow to import, and a flight does not need it

    of_input = np.asarray(expm(whole)[:2], dtype=np.float64)
    change = of_input[:, 3].copy()
    of_input[:, 2] -= change
    return of_input


def _noise(matrix: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Covariance of (value, rate) for white noise of 1 on the measurement."""
    transition, before, now = matrix[:, :2], matrix[:, 2:3], matrix[:, 3:4]
    # A measurement enters twice: at the end of one period, at the beginning of the next.
    drive = before @ before.T + now @ now.T
    cross = transition @ now @ before.T
    from scipy.linalg import solve_discrete_lyapunov

    return np.asarray(solve_discrete_lyapunov(transition, drive + cross + cross.T))


def poles_radps(choice: Observer) -> tuple[complex, complex]:
    """Roots of (eps s)^2 + l1 eps s + l2, the lower first.

    In closed form: the eigenvalues of a double root are 1e-8 apart on one processor and equal on
    another.
    """
    spread = cmath.sqrt(choice.l1**2 - 4.0 * choice.l2)
    low, high = -choice.l1 - spread, -choice.l1 + spread
    return low / (2.0 * choice.eps_s), high / (2.0 * choice.eps_s)


def fill_observer(record: Record, choice: Observer, period_s: float) -> dict[str, Any]:
    """Writes the observer's design record; returns what the provenance tells of it.

    `rate_noise_1ps`: standard deviation of the rate for white noise of 1 on the measurement.
    """
    matrix = discrete(choice, period_s)
    names = list(record.dtype.names)
    for i, to in enumerate(ROWS):
        for j, source in enumerate(COLUMNS):
            (name,) = (n for n in names if n.startswith(f"{to}_from_{source}"))
            record[name] = matrix[i, j]
    record["period_s"] = period_s
    record["coast_max_cycles"] = math.floor(choice.coast_max_s / period_s + 0.5)
    noise = _noise(matrix)
    return {
        "poles_radps": [[pole.real, pole.imag] for pole in poles_radps(choice)],
        "rate_noise_1ps": float(math.sqrt(noise[1, 1])),
    }
