"""Translational motion of a point mass over a rotating planet, spherical coordinates.

[MOOIJ18] Eqs 1-6, with the northward component of gravity added for J2. Speed and directions are
relative to the rotating planet, and the air turns with it. In a wind the aerodynamic forces act
along and across the motion through the air, and are resolved here. One RK4 step per minor frame;
the heat load is integrated with the motion.

Limits: spherical coordinates are singular at the poles and in vertical flight. Three floors keep
the rates finite there; they have no effect further than 6 m from a pole of the Earth, 0.006 deg
from the vertical, and above 1 m/s. Vertical entry over the turning Earth is 2 m off at 28 km. A
frame's step cannot follow the heading past a pole it misses by less than about 100 m: 13 m off at
60 m, 600 m off at 6 m, nothing when it goes right over it.
"""

import math

from flight_sw.model.angles import away_from_zero, wrapped
from flight_sw.records.types_ import Record
from sim_harness.jit import kernel
from sim_harness.world.air import air_loads
from sim_harness.world.planet.gravity import gravity

COS_LAT_MIN = 1e-6  # floor on cos(lat): acts within 6 m of a pole of the Earth
COS_FPA_MIN = 1e-4  # floor on cos(flight-path angle): acts within 0.006 deg of the vertical
V_MIN_MPS = 1.0  # floor on the speed that divides the turn rates

Rates = tuple[float, float, float, float, float, float, float]


@kernel
def rates(
    world: Record,
    held: Record,
    lat_rad: float,
    alt_m: float,
    v: float,
    fpa_rad: float,
    heading_rad: float,
) -> Rates:
    """Time derivatives of longitude, latitude, altitude, speed, angle, heading and heat load."""
    planet = world["planet"]
    spin = planet["rotation_radps"]
    r = planet["radius_m"] + alt_m
    s_lat = math.sin(lat_rad)
    c_lat = math.cos(lat_rad)
    s_fpa = math.sin(fpa_rad)
    c_fpa = math.cos(fpa_rad)
    s_head = math.sin(heading_rad)
    c_head = math.cos(heading_rad)
    c_lat_safe = away_from_zero(c_lat, COS_LAT_MIN)
    c_fpa_safe = away_from_zero(c_fpa, COS_FPA_MIN)
    v_safe = max(v, V_MIN_MPS)

    along, across, right, flux = air_loads(world, held, alt_m, v, s_fpa, c_fpa, s_head, c_head)
    g_down, g_north = gravity(planet, r, s_lat, c_lat)
    # Gravity and centrifugal acceleration together: up and north, in the meridian plane.
    up = spin * spin * r * c_lat * c_lat - g_down
    north = g_north - spin * spin * r * c_lat * s_lat

    # [MOOIJ18] Eqs 4-6
    lon_rate = v * c_fpa * s_head / (r * c_lat_safe)
    lat_rate = v * c_fpa * c_head / r
    alt_rate = v * s_fpa
    # [MOOIJ18] Eqs 1-3
    v_rate = up * s_fpa + north * c_fpa * c_head + along
    fpa_rate = (
        (across + up * c_fpa - north * s_fpa * c_head) / v_safe
        + 2.0 * spin * c_lat * s_head
        + v * c_fpa / r
    )
    heading_rate = (
        (right - north * s_head) / (v_safe * c_fpa_safe)
        + 2.0 * spin * (s_lat - c_lat * s_fpa / c_fpa_safe * c_head)
        + v * c_fpa * s_lat / c_lat_safe * s_head / r
    )
    return lon_rate, lat_rate, alt_rate, v_rate, fpa_rate, heading_rate, flux


@kernel
def folded(lat_rad: float, fpa_rad: float) -> tuple[float, float, float, float]:
    """Latitude and angle folded back after passing a pole or the vertical, with the half turns of
    longitude and heading that keep place and direction the same."""
    lon_turn = 0.0
    heading_turn = 0.0
    if abs(lat_rad) > 0.5 * math.pi:
        lat_rad = math.copysign(math.pi, lat_rad) - lat_rad
        lon_turn = math.pi
        heading_turn = math.pi
    if abs(fpa_rad) > 0.5 * math.pi:
        fpa_rad = math.copysign(math.pi, fpa_rad) - fpa_rad
        heading_turn = math.pi - heading_turn
    return lat_rad, fpa_rad, lon_turn, heading_turn


@kernel
def step(world: Record, truth: Record) -> None:
    """Moves the truth by one frame: classical RK4, attitude held as in truth["held"]."""
    held = truth["held"]
    dt = world["dt_s"]
    half = 0.5 * dt
    lon = truth["lon_rad"]
    lat = truth["lat_rad"]
    alt = truth["alt_m"]
    v = truth["v_rel_mps"]
    fpa = truth["flight_path_angle_rad"]
    head = truth["heading_rad"]

    a = rates(world, held, lat, alt, v, fpa, head)
    b = rates(
        world,
        held,
        lat + half * a[1],
        alt + half * a[2],
        v + half * a[3],
        fpa + half * a[4],
        head + half * a[5],
    )
    c = rates(
        world,
        held,
        lat + half * b[1],
        alt + half * b[2],
        v + half * b[3],
        fpa + half * b[4],
        head + half * b[5],
    )
    d = rates(
        world,
        held,
        lat + dt * c[1],
        alt + dt * c[2],
        v + dt * c[3],
        fpa + dt * c[4],
        head + dt * c[5],
    )
    sixth = dt / 6.0
    lon += sixth * (a[0] + 2.0 * (b[0] + c[0]) + d[0])
    lat += sixth * (a[1] + 2.0 * (b[1] + c[1]) + d[1])
    alt += sixth * (a[2] + 2.0 * (b[2] + c[2]) + d[2])
    v += sixth * (a[3] + 2.0 * (b[3] + c[3]) + d[3])
    fpa += sixth * (a[4] + 2.0 * (b[4] + c[4]) + d[4])
    head += sixth * (a[5] + 2.0 * (b[5] + c[5]) + d[5])

    lat, fpa, lon_turn, heading_turn = folded(lat, fpa)
    truth["lon_rad"] = wrapped(lon + lon_turn)
    truth["lat_rad"] = lat
    truth["alt_m"] = alt
    truth["v_rel_mps"] = v
    truth["flight_path_angle_rad"] = fpa
    truth["heading_rad"] = wrapped(head + heading_turn)
    truth["heat_load_jpm2"] += sixth * (a[6] + 2.0 * (b[6] + c[6]) + d[6])
