"""What a planner's job is told, and what it remembers: its bytes are part of a checkpoint."""

import math

import numpy as np

from flight_sw.model.motion import MOTION, N_STATES
from flight_sw.model.profile import KNOTS_MAX, PROFILE
from flight_sw.model.propagation import CONDITIONS, PATH, WORK
from flight_sw.records.fields import Field, RecordSpec

ROWS = 4  # north and east of the target, bank at the end, root of the excess
AT_NORTH, AT_EAST, AT_BANK, AT_EXCESS = range(ROWS)
STEPS_MAX = 1500  # of one flight ahead: fewer than a plan has rows
ITERATIONS_MAX = 40
TRIALS_MAX = 6  # of step lengths in an iteration
FULL_STEP_RATIO = 0.5  # of the squared error: a full step that leaves less is not searched further

GUESSES = 3  # the bank of the plan in force, the design's guess, and its mirror image

STEEPER_MAX = 4  # times that guesses are banked more where none of them comes down
STEEPER_RATIO = 0.2  # of what lacks to a quarter turn, each time

IDLE, WORKING, DONE = 0, 1, 2
NOT_ENDED, CONVERGED, SMALL_STEP, OUT_OF_ITERATIONS, STUCK = 0, 1, 2, 3, 4
ENDINGS = ("none", "converged", "small step", "out of iterations", "stuck")

PLANNER = RecordSpec(
    "planner",
    Field("target_lat_rad", -math.pi / 2, math.pi / 2, "where the flight is to end"),
    Field("target_lon_rad", -math.pi, math.pi),
    Field("end_alt_m", -5e4, 1e7, "at which it ends"),
    Field("end_bank_rad", -math.pi, math.pi, "wanted there"),
    Field("heat_flux_limit_wpm2", 0.0, 1e12, "kept by the plan"),
    Field("heat_flux_unit_wpm2", 1e-3, 1e12, "in which the excess is squared"),
    Field("target_weight_1prad", 0.0, 1e12, "root of H of the distance north and east"),
    Field("bank_weight_1prad", 0.0, 1e12, "root of H of the bank"),
    Field("excess_weight_ratio", 0.0, 1e12, "on the root of e_c"),
    Field("target_error_max", 0.0, 1e30, "e_t below which a plan is good"),
    Field("excess_max", 0.0, 1e30, "e_c below which it is"),
    Field("step_min_ratio", 0.0, 1.0, "shortest step length"),
    Field("step_s", 0.01, 100.0, "of the flight ahead"),
    Field("steps_a_frame_count", 1, STEPS_MAX, "in one minor frame", kind="u4"),
    Field("iterations_max", 1, ITERATIONS_MAX, "of Newton's", kind="u4"),
    Field("literal", 0, 1, "1: on e_t and e_c alone, as in the source", kind="u4"),
    Field("bank_max_rad", 0.0, math.pi, "planned, either side"),
    Field("first_free_knot", 0, KNOTS_MAX - 1, "of the bank; those before are given", kind="u4"),
)

TRACE = np.dtype(
    [
        ("target_error", "f8"),  # e_t
        ("excess", "f8"),  # e_c
        ("step_ratio", "f8"),  # length of the step that led here
        ("lat_rad", "f8"),
        ("lon_rad", "f8"),
        ("bank_rad", "f8"),
        ("heat_flux_peak_wpm2", "f8"),
        ("t_s", "f8"),
    ],
    align=True,
)
"""What an iteration ended with."""

JOB = np.dtype(
    [
        ("stage", "u4"),  # IDLE, WORKING, DONE
        ("ending", "u4"),  # ENDINGS
        ("iteration", "u4"),
        ("guess", "u4"),  # which is flown; GUESSES once the best is improved
        ("steeper", "u4"),  # times that the guesses were banked more
        ("trials", "u4"),  # in this iteration
        ("best", "u4"),  # iteration whose end is the best
        ("flights", "u4"),  # ahead, altogether
        ("failed_flights", "u4"),
        ("start", "f8", (N_STATES,)),
        ("start_s", "f8"),
        ("guess_rad", "f8", (GUESSES, KNOTS_MAX)),  # of the bank
        ("profile", PROFILE),  # of the trial
        ("path", PATH),
        ("work", WORK),
        ("conditions", CONDITIONS),
        ("best_bank_rad", "f8", (KNOTS_MAX,)),
        ("step_rad", "f8", (KNOTS_MAX,)),  # Newton's
        ("step_ratio", "f8"),
        ("merit", "f8"),  # squared error of the best
        ("best_error", "f8", (ROWS,)),
        ("best_jacobian", "f8", (ROWS, KNOTS_MAX)),
        ("error", "f8", (ROWS,)),
        ("jacobian", "f8", (ROWS, KNOTS_MAX)),
        ("rows", "f8", (ROWS, ROWS + 1)),  # normal equations
        ("slopes", "f8", (N_STATES,)),
        ("motion", MOTION),
        ("trace", TRACE, (ITERATIONS_MAX + 1,)),
    ],
    align=True,
)
"""A plan in the making."""
