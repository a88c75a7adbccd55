"""A plan as it is flown: the bank over energy, and the flight along it as rows over the index.

Rows are the ends of the steps of a flight ahead, the index ascending; between two rows the state is
a straight line. Two of them lie side by side, so that the next is written while one is flown.
"""

import math

import numpy as np

from flight_sw.model.motion import N_STATES
from flight_sw.model.profile import PROFILE, index_of, on_line, segment_at
from flight_sw.model.tables import bracket
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel, seldom_kernel

ROWS_MAX = 1536

PLAN = np.dtype(
    [
        ("profile", PROFILE),
        ("n_rows", "i8"),
        ("ending", "u4"),  # planner.ENDINGS
        ("iterations", "u4"),
        ("flights", "u4"),  # ahead, that it took
        ("target_error", "f8"),
        ("excess", "f8"),
        ("heat_flux_peak_wpm2", "f8"),
        ("duration_s", "f8"),
        ("index", "f8", (ROWS_MAX,)),
        ("state", "f8", (ROWS_MAX, N_STATES)),  # motion.STATES, longitude without a jump
    ],
    align=True,
)
"""One plan, shape (1,)."""

REFERENCE = np.dtype(
    [
        ("state", "f8", (N_STATES,)),
        ("alpha_rad", "f8"),
        ("bank_rad", "f8"),
        ("row", "i8"),
    ],
    align=True,
)
"""A plan at one index."""


@kernel
def begin_rows(plan: Record) -> None:
    """An empty plan."""
    plan["n_rows"] = 0


@seldom_kernel
def add_row(plan: Record, planet: Record, x: F8, t_s: float) -> bool:
    """Takes one state of a flight ahead; False once there is no room.

    A state whose index does not exceed the last one's adds nothing.
    """
    n = plan["n_rows"]
    index = index_of(plan["profile"], planet, x, t_s)
    if n > 0 and not index > plan["index"][n - 1]:
        return True
    if n >= ROWS_MAX:
        return False
    plan["index"][n] = index
    for i in range(N_STATES):
        plan["state"][n, i] = x[i]
    plan["n_rows"] = n + 1
    return True


@seldom_kernel
def look_up(plan: Record, index: float, out: Record) -> None:
    """The plan's state and controls at an index; beyond its ends those of the ends."""
    profile = plan["profile"]
    n = plan["n_rows"]
    grid = plan["index"]
    row = np.int64(0)
    share = 0.0
    if n > 1:
        row = bracket(index, grid, n)
        share = (index - grid[row]) / (grid[row + 1] - grid[row])
        share = min(max(share, 0.0), 1.0)
    out["row"] = row
    for i in range(N_STATES):
        here = plan["state"][row, i]
        if n > 1:
            here += share * (plan["state"][row + 1, i] - here)
        out["state"][i] = here
    n_bank, n_alpha = np.int64(profile["n_bank"]), np.int64(profile["n_alpha"])
    at = min(max(index, profile["breaks"][0]), max(grid[n - 1], profile["breaks"][0]))
    bank, _ = on_line(
        profile["bank_index"], profile["bank_rad"], n_bank,
        segment_at(profile["bank_index"], n_bank, at), at,
    )  # fmt: skip
    alpha, _ = on_line(
        profile["alpha_index"], profile["alpha_rad"], n_alpha,
        segment_at(profile["alpha_index"], n_alpha, at), at,
    )  # fmt: skip
    out["bank_rad"], out["alpha_rad"] = bank, alpha


@kernel
def is_sound(plan: Record) -> bool:
    """Whether a plan can be flown: at least two rows, all of it finite."""
    n = plan["n_rows"]
    if n < 2:
        return False
    total = plan["target_error"] + plan["excess"]
    for i in range(N_STATES):
        total += plan["state"][0, i] + plan["state"][n - 1, i]
    for k in range(np.int64(plan["profile"]["n_bank"])):
        total += plan["profile"]["bank_rad"][k]
    return math.isfinite(total)
