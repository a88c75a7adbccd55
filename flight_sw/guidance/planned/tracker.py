"""Tracker of a plan: gains over energy, an integral of the error along the track.  [JOSHI]

Eqs. 46-49 with -K throughout. The index is that of the Jacobi energy, which drag alone changes.
Differences from the source, each by a key of the design:

- errors of position are turned into along and across the planned heading, and gains that are odd in
  the bank's sign follow it: one table then serves plans to either side (`path_axes`; the source has
  the table's own axes);
- the integral is that of the error along the track; the source's is of latitude, whose sign hangs
  on the final heading (`integral_of`);
- the integral waits while the command is limited, and is bounded.

Until drag tells where on the axis of energy the vehicle is, the plan is flown open loop.
"""

import math

import numpy as np

from flight_sw.guidance.planned.plan import REFERENCE, look_up
from flight_sw.model.angles import wrapped
from flight_sw.model.motion import GAMMA, LAMBDA, N_STATES, PHI, PSI, RADIUS, V
from flight_sw.model.profile import index_of
from flight_sw.model.sphere import offset, turned_by
from flight_sw.model.tables import between, locate
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel, seldom_kernel

GAIN_ROWS = 96
ALONG, ACROSS = 4, 5  # places of the position errors in path axes
LONGITUDINAL = (V, GAMMA, RADIUS, ALONG)
INTEGRALS = ("along-track", "latitude")
OF_TRACK, OF_LATITUDE = range(len(INTEGRALS))
SIN_BANK_MIN = 1e-3  # of a table's bank: its odd gains are not scaled by less

TRACKER = RecordSpec(
    "tracker",
    Field("n_rows", 2, GAIN_ROWS, "of the gain table", kind="u4"),
    Field("index", -1e3, 1e3, "of the profile", shape=(GAIN_ROWS,), rows="n_rows"),
    Field("k_alpha", -1e9, 1e9, "rad per m/s, rad, rad, m, rad, rad", shape=(GAIN_ROWS, N_STATES)),
    Field("k_bank", -1e9, 1e9, "the same", shape=(GAIN_ROWS, N_STATES)),
    Field("k_integral_1ps", -1e3, 1e3, "of alpha, per rad s", shape=(GAIN_ROWS,)),
    Field("bank_rad", -math.pi, math.pi, "that the table was made for", shape=(GAIN_ROWS,)),
    Field("path_axes", 0, 1, "1: errors along and across, odd gains by sign", kind="u4"),
    Field("odd_max_ratio", 0.0, 100.0, "bound on the scale of the odd gains"),
    Field("integral_of", 0, len(INTEGRALS) - 1, "INTEGRALS", kind="u4"),
    Field("feedback_from_index", -1e3, 1e3, "index from which errors are fed back"),
    Field("integral_from_index", -1e3, 1e3, "index from which they are integrated"),
    Field("integral_max_rads", 0.0, 1e6, "bound on the integral"),
    Field("alpha_shift_max_rad", 0.0, math.pi, "largest correction"),
    Field("bank_shift_max_rad", 0.0, math.pi, "largest correction"),
    Field("alpha_low_rad", -math.pi, math.pi, "commanded"),
    Field("alpha_high_rad", -math.pi, math.pi, "commanded"),
    Field("bank_max_rad", 0.0, math.pi, "commanded, either side"),
)

TRACKING = np.dtype(
    [
        ("x", "f8", (N_STATES,)),
        ("error", "f8", (N_STATES,)),  # less the plan; positions in the table's axes
        ("index", "f8"),
        ("along_rad", "f8"),
        ("across_rad", "f8"),
        ("integral_rads", "f8"),
        ("alpha_shift_rad", "f8"),
        ("bank_shift_rad", "f8"),
        ("is_limited", "u4"),
        ("feeds_back", "u4"),
        ("reference", REFERENCE),
    ],
    align=True,
)
"""What the tracker remembers."""


@kernel
def take_state(planet: Record, nav: Record, x: Record) -> None:
    """A navigation fix as a state of shape (6,)."""
    x[V] = nav["v_rel_mps"]
    x[GAMMA] = nav["flight_path_angle_rad"]
    x[PSI] = nav["heading_rad"]
    x[RADIUS] = planet["radius_m"] + nav["alt_m"]
    x[PHI] = nav["lat_rad"]
    x[LAMBDA] = nav["lon_rad"]


@seldom_kernel
def compare(planet: Record, plan: Record, design: Record, own: Record, t_s: float) -> bool:
    """Where the vehicle stands on the plan, and how far from it.

    False beyond the end of the plan, with which nothing can be compared: errors and corrections
    stay what they were.
    """
    x, planned = own["x"], own["reference"]["state"]
    own["index"] = index_of(plan["profile"], planet, x, t_s)
    if own["index"] > plan["index"][plan["n_rows"] - 1]:
        return False
    look_up(plan, own["index"], own["reference"])
    error = own["error"]
    error[V] = x[V] - planned[V]
    error[GAMMA] = x[GAMMA] - planned[GAMMA]
    error[RADIUS] = x[RADIUS] - planned[RADIUS]
    north, east = offset(x[PHI], x[LAMBDA], planned[PHI], planned[LAMBDA])
    turn = turned_by(x[PHI], x[LAMBDA], planned[PHI], planned[LAMBDA])
    cos_psi, sin_psi = math.cos(planned[PSI]), math.sin(planned[PSI])
    own["along_rad"] = north * cos_psi + east * sin_psi
    own["across_rad"] = east * cos_psi - north * sin_psi
    if design["path_axes"] == 1:
        error[PSI] = wrapped(x[PSI] + turn - planned[PSI])
        error[ALONG], error[ACROSS] = own["along_rad"], own["across_rad"]
    else:
        error[PSI] = wrapped(x[PSI] - planned[PSI])
        error[PHI] = x[PHI] - planned[PHI]
        error[LAMBDA] = wrapped(x[LAMBDA] - planned[LAMBDA])
    return True


@kernel
def _odd_ratio(design: Record, own: Record, row: int, share: float) -> float:
    """By what the gains that are odd in the bank's sign are scaled to the plan's bank."""
    if design["path_axes"] == 0:
        return 1.0
    made_for = math.sin(between(design["bank_rad"], row, share))
    planned = math.sin(own["reference"]["bank_rad"])
    if abs(made_for) < SIN_BANK_MIN:
        made_for = math.copysign(SIN_BANK_MIN, made_for)
    most = design["odd_max_ratio"]
    return min(max(planned / made_for, -most), most)


@seldom_kernel
def correct(design: Record, own: Record, step_s: float) -> None:
    """Corrections of angle of attack and bank, limited; the integral goes on where they are not."""
    own["alpha_shift_rad"] = 0.0
    own["bank_shift_rad"] = 0.0
    own["is_limited"] = 0
    own["feeds_back"] = 0
    if own["index"] < design["feedback_from_index"]:
        return
    own["feeds_back"] = 1
    n = np.int64(design["n_rows"])
    row, share = locate(own["index"], design["index"], n)
    odd = _odd_ratio(design, own, row, share)
    error = own["error"]
    alpha = 0.0
    bank = 0.0
    for i in range(N_STATES):
        is_lateral = i in (PSI, ACROSS)
        k_alpha = between(design["k_alpha"][:, i], row, share)
        k_bank = between(design["k_bank"][:, i], row, share)
        if is_lateral:
            alpha -= odd * k_alpha * error[i]
            bank -= k_bank * error[i]
        else:
            alpha -= k_alpha * error[i]
            bank -= odd * k_bank * error[i]
    alpha -= between(design["k_integral_1ps"], row, share) * own["integral_rads"]
    alpha_most, bank_most = design["alpha_shift_max_rad"], design["bank_shift_max_rad"]
    own["alpha_shift_rad"] = min(max(alpha, -alpha_most), alpha_most)
    own["bank_shift_rad"] = min(max(bank, -bank_most), bank_most)
    wanted = own["reference"]["alpha_rad"] + own["alpha_shift_rad"]
    within = design["alpha_low_rad"] <= wanted <= design["alpha_high_rad"]
    if own["alpha_shift_rad"] != alpha or not within:
        own["is_limited"] = 1
    elif own["index"] >= design["integral_from_index"]:
        of = -own["along_rad"]  # short of the plan: a smaller angle of attack flies farther
        if design["integral_of"] == OF_LATITUDE:
            of = own["x"][PHI] - own["reference"]["state"][PHI]
        most = design["integral_max_rads"]
        own["integral_rads"] = min(max(own["integral_rads"] + of * step_s, -most), most)
