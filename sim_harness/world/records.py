"""The records of the world: what it is made of (WORLD, read-only) and how it stands (TRUTH)."""

import numpy as np

from flight_sw.model.atmosphere import ATMOSPHERE
from flight_sw.model.great_circle import GROUND_TRACK
from flight_sw.model.onboard import POWERS_ALPHA, POWERS_MACH
from sim_harness.mission.table_sizes import AERO_TABLE_MAX

# Aerodynamic models; never renumbered.
AERO_CONSTANT = 0
AERO_NEWTONIAN = 1
AERO_TABLE = 2
AERO_POLYNOMIAL = 3

# Outcomes of a flight; never renumbered.
FLYING = 0
END_CONDITION = 1
TIME_OUT = 2
SKIPPED_OUT = 3
GROUND = 4
NUMERICAL = 5

PHYSICAL_ENDS = (END_CONDITION, TIME_OUT, SKIPPED_OUT, GROUND)
"""Outcomes of a flight that was flown to where its mission lets it end."""

OUTCOMES = ("flying", "end condition", "time out", "skipped out", "ground", "numerical")
"""Text of the outcomes, in order of their codes."""

PLANET = np.dtype(
    [
        ("radius_m", "f8"),  # of the sphere altitudes and ground range refer to; also J2's
        ("mu_m3ps2", "f8"),
        ("rotation_radps", "f8"),
        ("j2", "f8"),  # 0 switches the oblateness off
        ("g0_mps2", "f8"),  # unit of the load factor, not the local gravity
    ],
    align=True,
)

AERODYNAMICS = np.dtype(
    [
        ("model", "i8"),  # AERO_*
        ("mass_kg", "f8"),
        ("area_m2", "f8"),  # that the coefficients refer to
        ("side_lift_ratio", "f8"),  # share of the lift's sideways part that acts
        ("lift_ratio", "f8"),  # true lift over the model's
        ("drag_ratio", "f8"),
        ("lift_coefficient", "f8"),  # AERO_CONSTANT
        ("drag_coefficient", "f8"),
        ("n1", "f8"),  # AERO_NEWTONIAN: C_N = n1 s^2 + n2 s c, C_A = a1 c^2 + a2 s^2
        ("n2", "f8"),
        ("a1", "f8"),
        ("a2", "f8"),
        ("n_alpha", "i8"),  # AERO_TABLE
        ("n_mach", "i8"),
        ("alpha_rad", "f8", (AERO_TABLE_MAX,)),
        ("mach", "f8", (AERO_TABLE_MAX,)),
        ("lift_table", "f8", (AERO_TABLE_MAX, AERO_TABLE_MAX)),  # coefficients [alpha, Mach]
        ("drag_table", "f8", (AERO_TABLE_MAX, AERO_TABLE_MAX)),
        ("lift_powers", "f8", (POWERS_ALPHA, POWERS_MACH)),  # AERO_POLYNOMIAL: alpha^i Mach^j
        ("drag_powers", "f8", (POWERS_ALPHA, POWERS_MACH)),
    ],
    align=True,
)

HEATING = np.dtype(
    [
        ("factor_si", "f8"),  # heat flux = factor rho^a V^b in W/m2; its unit depends on a and b
        ("density_exponent", "f8"),
        ("velocity_exponent", "f8"),
    ],
    align=True,
)

ACTUATOR = np.dtype(
    [
        ("lag_gain", "f8"),  # share of the error taken in a frame: 1 - exp(-dt/lag); 1 without lag
        ("rate_max_radps", "f8"),  # inf: no limit
        ("accel_max_radps2", "f8"),  # inf: no limit
        ("low_rad", "f8"),
        ("high_rad", "f8"),
        ("turns_freely", "i8"),  # 1: the axis has no stop, and takes the shorter way round
    ],
    align=True,
)

END = np.dtype(
    [
        ("entry_alt_m", "f8"),  # above it and climbing: skipped out
        ("speed_mps", "f8"),  # ends at or below; 0: never
        ("alt_m", "f8"),  # ends at or below; -inf: never
        ("time_max_s", "f8"),
        ("energy_jpkg", "f8"),  # Jacobi's
        ("at_target", "i8"),  # 1: ends at the target's range as well
        (
            "ground_track",
            GROUND_TRACK.dtype,
        ),  # from the entry to the target; not filled without one
    ],
    align=True,
)

AIR_CELLS = 256

AIR = np.dtype(
    [
        ("is_disturbed", "i8"),  # 0: density is the atmosphere's
        ("has_wind", "i8"),  # 0: none
        ("low_m", "f8"),  # of the first cell
        ("cells_pm", "f8"),  # cells per metre
        ("ln_rho", "f8", (AIR_CELLS, 4)),  # of true over atmosphere's; powers 0..3 of the share
        ("wind_east_mps", "f8", (AIR_CELLS, 4)),  # likewise; towards the east
        ("wind_north_mps", "f8", (AIR_CELLS, 4)),
    ],
    align=True,
)
"""How the air differs from the atmosphere at rest."""

NAV_CHANNELS = 11  # of navigation.CHANNELS
NAV_PAIRS = 6  # of channels that share a stream of noise; the last has one alone

NAVIGATION = np.dtype(
    [
        ("has_errors", "i8"),  # 0: of what follows, only drop-outs
        ("bias", "f8", (NAV_CHANNELS,)),  # in the channels' units, SI; metres for the position
        ("sigma", "f8", (NAV_CHANNELS,)),
        ("slope", "f8", (NAV_CHANNELS,)),  # reported over true; not used for the position
        ("lag_gain", "f8", (NAV_CHANNELS,)),  # share of a change seen within a report
        ("noisy", "i8", (NAV_PAIRS,)),  # 1: a sigma of the pair is not zero
        ("memory", "f8", (NAV_PAIRS,)),  # of the noise, from report to report: exp(-dt/time)
        ("latency_reports", "i8"),
        ("dropout_ratio", "f8"),  # probability that one begins at a report
        ("dropout_reports", "i8"),
        ("dropout_of_message", "i8"),  # 1: one message of the set is missing, 0: all of them
    ],
    align=True,
)
"""The errors of what navigation reports."""

WORLD = np.dtype(
    [
        ("dt_s", "f8"),  # a minor frame, and the integration step
        ("planet", PLANET),
        ("aerodynamics", AERODYNAMICS),
        ("heating", HEATING),
        ("bank", ACTUATOR),
        ("alpha", ACTUATOR),
        ("end", END),
        ("navigation", NAVIGATION),
        ("atmosphere", ATMOSPHERE),
        ("air", AIR),
    ],
    align=True,
)
"""All that stays as it is during a flight."""

HELD = np.dtype(
    [
        ("cos_bank", "f8"),
        ("sin_bank", "f8"),
        ("alpha_rad", "f8"),
        ("lift_area_m2", "f8"),  # C_L S; a table in Mach is looked up at every stage instead
        ("drag_area_m2", "f8"),
    ],
    align=True,
)
"""What the attitude of a frame means for the forces: held over the frame's four stages."""

TRUTH = np.dtype(
    [
        ("minor_frames", "i8"),  # since entry
        ("t_s", "f8"),  # minor_frames times dt_s
        ("lon_rad", "f8"),  # -pi to pi
        ("lat_rad", "f8"),  # geocentric
        ("alt_m", "f8"),  # above the sphere of the planet's radius
        ("v_rel_mps", "f8"),  # relative to the rotating planet
        ("v_air_mps", "f8"),  # relative to the air: v_rel without wind
        ("flight_path_angle_rad", "f8"),  # of v_rel, positive up
        ("heading_rad", "f8"),  # of v_rel, from north, positive to the east, -pi to pi
        ("bank_rad", "f8"),  # positive: lift to the right of the motion through the air; -pi to pi
        ("alpha_rad", "f8"),
        ("bank_rate_radps", "f8"),
        ("alpha_rate_radps", "f8"),
        ("drag_mps2", "f8"),  # positive against the motion through the air
        ("lift_mps2", "f8"),  # signed as the lift coefficient
        ("rho_kgpm3", "f8"),
        ("mach", "f8"),
        ("dynamic_pressure_pa", "f8"),
        ("heat_flux_wpm2", "f8"),  # stagnation point, cold wall
        ("heat_load_jpm2", "f8"),
        ("load_factor_g", "f8"),  # in units of the planet's g0
        ("ground_range_m", "f8"),  # along the track, on the sphere of the planet's radius
        ("energy_jpkg", "f8"),  # v_rel^2/2 + mu (1/Re - 1/R): 0 at rest at zero altitude
        ("jacobi_energy_jpkg", "f8"),  # v_rel^2/2 + potential with J2 and rotation: 0 at infinity
        ("heat_flux_max_wpm2", "f8"),  # the largest at a minor frame so far
        ("load_factor_max_g", "f8"),
        ("dynamic_pressure_max_pa", "f8"),
        ("held", HELD),
    ],
    align=True,
)
"""The state of the vehicle and what follows from it at this instant."""
