"""Motion of a vehicle over a rotating planet with J2 as the flight computer believes it.

State: speed, path angle and heading relative to the turning planet, radius, latitude, longitude.
Control: angle of attack and bank. Every planner, predictor, gain design and sensitivity uses this
motion. It is apart from the world's, and tested against it.

[JOSHI] Eqs. 1-7, with one sign of Eq. 2 corrected (the gravity's northward part turns the path
with + sin(gamma) cos(psi) of its southward one), and the mass divided out once. The partial
derivatives are derived by hand and tested against sympy and complex steps.

Limits: singular at the poles, in vertical flight and at rest; floors keep the rates finite there,
and the partial derivatives are then those without the floors. Angles outside an aerodynamic table
take its edge value, with a slope of 0. No wind.
"""

import math

import numpy as np

from flight_sw.model.angles import away_from_zero
from flight_sw.model.onboard import FORCE_SLOPES, force_slopes
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel, seldom_kernel

STATES = ("v_rel_mps", "flight_path_angle_rad", "heading_rad", "radius_m", "lat_rad", "lon_rad")
CONTROLS = ("alpha_rad", "bank_rad")
N_STATES, N_CONTROLS = len(STATES), len(CONTROLS)
V, GAMMA, PSI, RADIUS, PHI, LAMBDA = range(N_STATES)
ALPHA, BANK = range(N_CONTROLS)

Sines = tuple[float, float, float, float, float, float]
"""Sine and cosine of path angle, heading and latitude."""

V_MIN_MPS = 1.0  # floors, each with the sign of what it replaces
COS_GAMMA_MIN = 1e-4
COS_PHI_MIN = 1e-6

MOTION = np.dtype(
    [
        ("rate", "f8", (N_STATES,)),  # of STATES, per second
        ("by_state", "f8", (N_STATES, N_STATES)),  # [i, j]: of rate i by state j
        ("by_control", "f8", (N_STATES, N_CONTROLS)),
        ("forces", FORCE_SLOPES.dtype),
        ("up_mps2", "f8"),  # gravity and centrifugal acceleration together
        ("north_mps2", "f8"),
        ("up_by_radius_1ps2", "f8"),
        ("up_by_phi_mps2prad", "f8"),
        ("north_by_radius_1ps2", "f8"),
        ("north_by_phi_mps2prad", "f8"),
    ],
    align=True,
)
"""Where rates and partial derivatives are put: the caller's, so that nothing is allocated."""


@kernel
def _pull(planet: Record, radius_m: float, sin_phi: float, cos_phi: float, out: Record) -> None:
    """Gravity with J2 and the centrifugal acceleration: up and north.  [JOSHI] Eqs. 5, 6"""
    spin = planet["rotation_radps"]
    central = planet["mu_m3ps2"] / (radius_m * radius_m)
    ratio = planet["radius_m"] / radius_m
    oblate = planet["j2"] * ratio * ratio
    turning = spin * spin * radius_m * cos_phi
    out["up_mps2"] = turning * cos_phi - central * (
        1.0 - 1.5 * oblate * (3.0 * sin_phi * sin_phi - 1.0)
    )
    out["north_mps2"] = -turning * sin_phi - 3.0 * central * oblate * sin_phi * cos_phi


@seldom_kernel
def motion_rates(
    onboard: Record, atmosphere: Record, x: F8, alpha_rad: float, bank_rad: float, out: Record
) -> None:
    """Writes `rate`, forces and pull for a state of shape (6,)."""
    planet = onboard["planet"]
    v, r = x[V], x[RADIUS]
    sin_gamma, cos_gamma = math.sin(x[GAMMA]), math.cos(x[GAMMA])
    sin_psi, cos_psi = math.sin(x[PSI]), math.cos(x[PSI])
    sin_phi, cos_phi = math.sin(x[PHI]), math.cos(x[PHI])
    force_slopes(onboard, atmosphere, r - planet["radius_m"], v, alpha_rad, out["forces"])
    _pull(planet, r, sin_phi, cos_phi, out)
    up, north = out["up_mps2"], out["north_mps2"]
    lift = out["forces"]["lift_mps2"]
    spin = planet["rotation_radps"]
    v_safe = max(v, V_MIN_MPS)
    cos_gamma_safe = away_from_zero(cos_gamma, COS_GAMMA_MIN)
    cos_phi_safe = away_from_zero(cos_phi, COS_PHI_MIN)
    rate = out["rate"]
    rate[V] = up * sin_gamma + north * cos_gamma * cos_psi - out["forces"]["drag_mps2"]
    rate[GAMMA] = (
        (lift * math.cos(bank_rad) + up * cos_gamma - north * sin_gamma * cos_psi) / v_safe
        + v * cos_gamma / r
        + 2.0 * spin * cos_phi * sin_psi
    )
    rate[PSI] = (
        (lift * math.sin(bank_rad) - north * sin_psi) / (v_safe * cos_gamma_safe)
        + v * cos_gamma * sin_psi * sin_phi / (cos_phi_safe * r)
        + 2.0 * spin * (sin_phi - cos_phi * cos_psi * sin_gamma / cos_gamma_safe)
    )
    rate[RADIUS] = v * sin_gamma
    rate[PHI] = v * cos_gamma * cos_psi / r
    rate[LAMBDA] = v * cos_gamma * sin_psi / (r * cos_phi_safe)


@kernel
def _pull_partials(planet: Record, x: F8, sines: Sines, out: Record) -> None:
    """What gravity and centrifugal acceleration change by over radius and latitude."""
    _, _, _, _, sin_phi, cos_phi = sines
    r = x[RADIUS]
    spin_sq = planet["rotation_radps"] * planet["rotation_radps"]
    central = planet["mu_m3ps2"] / (r * r)
    ratio = planet["radius_m"] / r
    oblate = planet["j2"] * ratio * ratio
    bulge = 3.0 * sin_phi * sin_phi - 1.0
    both = sin_phi * cos_phi
    out["up_by_radius_1ps2"] = spin_sq * cos_phi * cos_phi + central / r * (
        2.0 - 6.0 * oblate * bulge
    )
    out["north_by_radius_1ps2"] = (12.0 * central / r * oblate - spin_sq) * both
    out["up_by_phi_mps2prad"] = (9.0 * central * oblate - 2.0 * spin_sq * r) * both
    cos_twice = cos_phi * cos_phi - sin_phi * sin_phi
    out["north_by_phi_mps2prad"] = -(spin_sq * r + 3.0 * central * oblate) * cos_twice


@kernel
def _speed_partials(sines: Sines, out: Record) -> None:
    """Row of the speed's rate."""
    sin_gamma, cos_gamma, sin_psi, cos_psi, _, _ = sines
    forces = out["forces"]
    a = out["by_state"]
    ahead = cos_gamma * cos_psi
    a[V, V] = -forces["drag_by_v_1ps"]
    a[V, GAMMA] = out["up_mps2"] * cos_gamma - out["north_mps2"] * sin_gamma * cos_psi
    a[V, PSI] = -out["north_mps2"] * cos_gamma * sin_psi
    a[V, RADIUS] = (
        out["up_by_radius_1ps2"] * sin_gamma
        + out["north_by_radius_1ps2"] * ahead
        - forces["drag_by_alt_1ps2"]
    )
    a[V, PHI] = out["up_by_phi_mps2prad"] * sin_gamma + out["north_by_phi_mps2prad"] * ahead


@kernel
def _path_partials(planet: Record, x: F8, sines: Sines, cos_bank: float, out: Record) -> None:
    """Row of the path angle's rate."""
    sin_gamma, cos_gamma, sin_psi, cos_psi, sin_phi, cos_phi = sines
    v, r = x[V], x[RADIUS]
    spin_twice = 2.0 * planet["rotation_radps"]
    up, north = out["up_mps2"], out["north_mps2"]
    forces = out["forces"]
    a = out["by_state"]
    back = sin_gamma * cos_psi
    normal = forces["lift_mps2"] * cos_bank + up * cos_gamma - north * back
    a[GAMMA, V] = (forces["lift_by_v_1ps"] * cos_bank - normal / v) / v + cos_gamma / r
    a[GAMMA, GAMMA] = -(up * sin_gamma + north * cos_gamma * cos_psi) / v - v * sin_gamma / r
    a[GAMMA, PSI] = north * sin_gamma * sin_psi / v + spin_twice * cos_phi * cos_psi
    a[GAMMA, RADIUS] = (
        forces["lift_by_alt_1ps2"] * cos_bank
        + out["up_by_radius_1ps2"] * cos_gamma
        - out["north_by_radius_1ps2"] * back
    ) / v - v * cos_gamma / (r * r)
    a[GAMMA, PHI] = (
        out["up_by_phi_mps2prad"] * cos_gamma - out["north_by_phi_mps2prad"] * back
    ) / v - spin_twice * sin_phi * sin_psi


@kernel
def _heading_partials(planet: Record, x: F8, sines: Sines, sin_bank: float, out: Record) -> None:
    """Row of the heading's rate."""
    sin_gamma, cos_gamma, sin_psi, cos_psi, sin_phi, cos_phi = sines
    v, r = x[V], x[RADIUS]
    spin_twice = 2.0 * planet["rotation_radps"]
    north = out["north_mps2"]
    forces = out["forces"]
    a = out["by_state"]
    across = v * cos_gamma
    sideways = forces["lift_mps2"] * sin_bank - north * sin_psi
    tan_gamma, tan_phi = sin_gamma / cos_gamma, sin_phi / cos_phi
    turn = v * cos_gamma * sin_psi * tan_phi / r
    a[PSI, V] = (forces["lift_by_v_1ps"] * sin_bank - sideways / v) / across + turn / v
    a[PSI, GAMMA] = (
        sideways * tan_gamma / across
        - turn * tan_gamma
        - spin_twice * cos_phi * cos_psi / (cos_gamma * cos_gamma)
    )
    a[PSI, PSI] = (
        -north * cos_psi / across
        + v * cos_gamma * cos_psi * tan_phi / r
        + spin_twice * cos_phi * sin_psi * tan_gamma
    )
    a[PSI, RADIUS] = (
        forces["lift_by_alt_1ps2"] * sin_bank - out["north_by_radius_1ps2"] * sin_psi
    ) / across - turn / r
    a[PSI, PHI] = (
        -out["north_by_phi_mps2prad"] * sin_psi / across
        + v * cos_gamma * sin_psi / (r * cos_phi * cos_phi)
        + spin_twice * (cos_phi + sin_phi * cos_psi * tan_gamma)
    )


@kernel
def _place_partials(x: F8, sines: Sines, out: Record) -> None:
    """Rows of radius, latitude and longitude."""
    sin_gamma, cos_gamma, sin_psi, cos_psi, _, cos_phi = sines
    v, r = x[V], x[RADIUS]
    a = out["by_state"]
    a[RADIUS, V], a[RADIUS, GAMMA] = sin_gamma, v * cos_gamma
    a[PHI, V] = cos_gamma * cos_psi / r
    a[PHI, GAMMA] = -v * sin_gamma * cos_psi / r
    a[PHI, PSI] = -v * cos_gamma * sin_psi / r
    a[PHI, RADIUS] = -v * cos_gamma * cos_psi / (r * r)
    over = 1.0 / (r * cos_phi)
    a[LAMBDA, V] = cos_gamma * sin_psi * over
    a[LAMBDA, GAMMA] = -v * sin_gamma * sin_psi * over
    a[LAMBDA, PSI] = v * cos_gamma * cos_psi * over
    a[LAMBDA, RADIUS] = -v * cos_gamma * sin_psi * over / r
    a[LAMBDA, PHI] = v * cos_gamma * sin_psi * over * math.tan(x[PHI])


@seldom_kernel
def motion_partials(
    onboard: Record, atmosphere: Record, x: F8, alpha_rad: float, bank_rad: float, out: Record
) -> None:
    """Writes what `motion_rates` does, and the partial derivatives of the rates.

    `by_state` has shape (6, 6), `by_control` (6, 2). Columns that no rate depends on, longitude's
    own, stay as they are found: the record begins as zeros.
    """
    motion_rates(onboard, atmosphere, x, alpha_rad, bank_rad, out)
    planet = onboard["planet"]
    cos_gamma = math.cos(x[GAMMA])
    sines = (
        math.sin(x[GAMMA]), cos_gamma, math.sin(x[PSI]), math.cos(x[PSI]), math.sin(x[PHI]),
        math.cos(x[PHI]),
    )  # fmt: skip
    sin_bank, cos_bank = math.sin(bank_rad), math.cos(bank_rad)
    _pull_partials(planet, x, sines, out)
    _speed_partials(sines, out)
    _path_partials(planet, x, sines, cos_bank, out)
    _heading_partials(planet, x, sines, sin_bank, out)
    _place_partials(x, sines, out)
    forces = out["forces"]
    v, across = x[V], x[V] * cos_gamma
    b = out["by_control"]
    b[V, ALPHA] = -forces["drag_by_alpha_mps2prad"]
    b[GAMMA, ALPHA] = forces["lift_by_alpha_mps2prad"] * cos_bank / v
    b[GAMMA, BANK] = -forces["lift_mps2"] * sin_bank / v
    b[PSI, ALPHA] = forces["lift_by_alpha_mps2prad"] * sin_bank / across
    b[PSI, BANK] = forces["lift_mps2"] * cos_bank / across


@kernel
def jacobi_energy(planet: Record, x: F8) -> float:
    """V^2/2 and the potential of gravity and rotation, J/kg: its rate is -V D exactly."""
    r = x[RADIUS]
    sin_phi, cos_phi = math.sin(x[PHI]), math.cos(x[PHI])
    ratio = planet["radius_m"] / r
    oblate = planet["j2"] * ratio * ratio
    turning = planet["rotation_radps"] * r * cos_phi
    potential = planet["mu_m3ps2"] / r * (1.0 - 0.5 * oblate * (3.0 * sin_phi * sin_phi - 1.0))
    return 0.5 * x[V] * x[V] - potential - 0.5 * turning * turning
