"""How the drag acceleration moves: its rate and second derivative, as the load knows the motion.

Source: [YANHE] Eqs. 8-11 with the sign of one term of f corrected, written for any atmosphere and a
rotating planet: docs/laws/drag.md, section 20. For exponential air over a planet at rest f and g0
are the source's term by term.

Limits: the drag coefficient is taken as constant (no rate of its Mach number or angle of attack);
the northward centrifugal part enters the speed rate, not its derivative; no J2.
"""

import math

from flight_sw.model.atmosphere import log_density_slopes
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

V_MIN_MPS = 1.0  # floor of the speed in divisions, no effect above it

DYNAMICS = RecordSpec(
    "drag_dynamics",
    Field("log_rate_1ps", why="rate of ln(drag)"),
    Field("speed_rate_mps2"),
    Field("speed_accel_mps3", why="second derivative of the speed without lift"),
    Field("speed_lift_mps3", why="and what full lift up adds to it"),
    Field("free_mps4", why="f: second derivative without lift in the vertical plane"),
    Field("authority_mps4", why="g0: and what full lift up adds to it, negative"),
)


@kernel
def jacobi_energy(planet: Record, alt_m: float, lat_rad: float, v_rel_mps: float) -> float:
    """Energy in the rotating frame, J/kg, that drag alone takes away: its rate is -V D.

    Zero at rest on the sphere at the pole.
    """
    radius_m = planet["radius_m"]
    around_mps = planet["rotation_radps"] * (radius_m + alt_m) * math.cos(lat_rad)
    height_jpkg = planet["mu_m3ps2"] * alt_m / (radius_m * (radius_m + alt_m))
    return 0.5 * (v_rel_mps * v_rel_mps - around_mps * around_mps) + height_jpkg


@kernel
def drag_dynamics(
    planet: Record, atmosphere: Record, nav: Record, drag_mps2: float, lift_mps2: float, out: Record
) -> None:
    """Fills `out` (DYNAMICS) at a fix, for this drag and lift."""
    v = max(nav["v_rel_mps"], V_MIN_MPS)
    sin_gamma = math.sin(nav["flight_path_angle_rad"])
    cos_gamma = math.cos(nav["flight_path_angle_rad"])
    cos_lat = math.cos(nav["lat_rad"])
    spin = planet["rotation_radps"]
    r = planet["radius_m"] + nav["alt_m"]
    slope_1pm, bend_1pm2 = log_density_slopes(atmosphere, nav["alt_m"])
    gravity = planet["mu_m3ps2"] / (r * r)
    # Gravity less the centrifugal part, down; the rest of that part, north.
    down = gravity - spin * spin * r * cos_lat * cos_lat
    north = -spin * spin * r * cos_lat * math.sin(nav["lat_rad"])
    climb = v * sin_gamma
    down_rate = -2.0 * gravity / r * climb
    v_rate = -drag_mps2 - down * sin_gamma + north * cos_gamma * math.cos(nav["heading_rad"])
    turn_free = (v / r - down / v) * cos_gamma + 2.0 * spin * cos_lat * math.sin(nav["heading_rad"])
    # [YANHE] Eq. 8, C = 0
    log_rate = slope_1pm * climb + 2.0 * v_rate / v
    drag_rate = drag_mps2 * log_rate
    v_accel_free = -drag_rate - down_rate * sin_gamma - down * cos_gamma * turn_free
    log_accel_free = (
        bend_1pm2 * climb * climb
        + slope_1pm * (v_rate * sin_gamma + v * cos_gamma * turn_free)
        + 2.0 * v_accel_free / v
        - 2.0 * v_rate * v_rate / (v * v)
    )
    out["log_rate_1ps"] = log_rate
    out["speed_rate_mps2"] = v_rate
    out["speed_accel_mps3"] = v_accel_free
    out["speed_lift_mps3"] = -down * cos_gamma * lift_mps2 / v
    # [YANHE] Eq. 11 gathered as D ((ln D)'^2 + (ln D)''); its v^2 cos^2/(r hs) term comes out minus
    out["free_mps4"] = drag_mps2 * (log_rate * log_rate + log_accel_free)
    out["authority_mps4"] = drag_mps2 * (slope_1pm * v - 2.0 * down / v) * cos_gamma * lift_mps2 / v
