"""Gains over energy: the onboard motion linearised along a plan, and regulated at each row.

[JOSHI] Eqs. 39-45 with the transpose of Eq. 43 in its place. Errors are scaled by what is allowed
of them before the Riccati equation is solved; rows are turned into errors along and across the
heading where the design asks for path axes.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.errors import DesignError
from flight_sw.guidance.planned.plan import REFERENCE, look_up
from flight_sw.guidance.planned.tracker import INTEGRALS
from flight_sw.model.motion import LAMBDA, MOTION, N_STATES, PHI, PSI, motion_partials
from flight_sw.records.types_ import Record
from tools.gains.planned.choices import Tracker
from tools.gains.rounding import rounded

Matrix = npt.NDArray[np.float64]


class Regulated(NamedTuple):
    """One row of the table."""

    place: float
    """On the index of the plan."""
    gain: Matrix
    """Shape (2, 6): of angle of attack and bank, for the errors of the design's axes."""
    bank_rad: float
    eigenvalues: list[list[float]]


def allowed(choice: Tracker) -> tuple[Matrix, Matrix]:
    """Errors of the states and controls that Bryson's rule takes for one, SI."""
    degrees = [
        choice.path_angle_max_deg, choice.heading_max_deg, choice.place_max_deg,
        choice.alpha_max_deg, choice.bank_max_error_deg,
    ]  # fmt: skip
    gamma, psi, place, alpha, bank = (math.radians(value) for value in degrees)
    states = np.array([choice.speed_max_mps, gamma, psi, choice.altitude_max_m, place, place])
    return states, np.array([alpha, bank])


def to_path_axes(heading_rad: float, lat_rad: float) -> Matrix:
    """Shape (6, 6): from errors of latitude and longitude to those along and across."""
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    turned = np.eye(N_STATES)
    turned[PHI, PHI], turned[PHI, LAMBDA] = c, s * math.cos(lat_rad)
    turned[LAMBDA, PHI], turned[LAMBDA, LAMBDA] = -s, c * math.cos(lat_rad)
    return turned


def regulated(a: Matrix, b: Matrix, choice: Tracker) -> tuple[Matrix, Matrix]:
    """Gain of shape (2, 6) and closed-loop eigenvalues."""
    import control  # slow to import

    states, controls = allowed(choice)
    scaled_a = a * states[None, :] / states[:, None]
    scaled_b = b * controls[None, :] / states[:, None]
    gain, _, poles = control.lqr(scaled_a, scaled_b, np.eye(len(states)), np.eye(2))
    return np.asarray(gain) * controls[:, None] / states[None, :], np.asarray(poles)


def row_at(body: Record, plan: Record, index: float, choice: Tracker) -> Regulated:
    """The row of the table at an index of a plan."""
    reference, motion = np.zeros(1, REFERENCE), np.zeros(1, MOTION)
    look_up(plan, index, reference[0])
    here = reference[0]
    x = np.array(here["state"])
    motion_partials(
        body["onboard"], body["atmosphere"], x, float(here["alpha_rad"]),
        float(here["bank_rad"]), motion[0],
    )  # fmt: skip
    a, b = np.array(motion["by_state"][0]), np.array(motion["by_control"][0])
    gain, poles = regulated(a, b, choice)
    if choice.axes == "path":
        gain = gain @ np.linalg.inv(to_path_axes(float(x[PSI]), float(x[PHI])))
    found = [[round(float(p.real), 6), round(float(p.imag), 6)] for p in poles]
    return Regulated(index, gain, float(here["bank_rad"]), sorted(found))


def fill_gains(record: Record, body: Record, plan: Record, choice: Tracker) -> dict[str, Any]:
    """Writes the TRACKER record; returns what the provenance tells."""
    n = int(choice.rows)
    covered = float(plan["index"][int(plan["n_rows"]) - 1])
    if not choice.index_first < covered:
        raise DesignError(
            f"tracker.index_first is {choice.index_first:g}, allowed below {covered:z.4g}, "
            "where the plan ends"
        )
    indexes = np.linspace(choice.index_first, min(choice.index_last, covered), n)
    rows = [row_at(body, plan, float(index), choice) for index in indexes]
    record["n_rows"] = n
    for i, row in enumerate(rows):
        record["index"][i] = rounded(row.place)
        record["k_alpha"][i] = [rounded(value) for value in row.gain[0]]
        record["k_bank"][i] = [rounded(value) for value in row.gain[1]]
        record["bank_rad"][i] = rounded(row.bank_rad)
        record["k_integral_1ps"][i] = choice.integral_1ps
    record["path_axes"] = choice.axes == "path"
    record["integral_of"] = INTEGRALS.index(choice.integral)
    for name in (
        "feedback_from_index",
        "integral_from_index",
        "odd_max_ratio",
        "integral_max_rads",
    ):
        record[name] = getattr(choice, name)
    for name in ("alpha_shift_max", "bank_shift_max", "alpha_low", "alpha_high", "bank_max"):
        record[f"{name}_rad"] = math.radians(getattr(choice, f"{name}_deg"))
    return {
        "gain_table": [
            {"index": round(row.place, 6), "closed_loop_eigenvalues_ps": row.eigenvalues}
            for row in rows
        ]
    }
