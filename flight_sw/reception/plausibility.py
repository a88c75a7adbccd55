"""Gates on navigation: could this fix have followed the last one?

A CRC of eight bits lets one random frame in 256 pass. A message is therefore also refused where no
vehicle could have moved as it says since the last accepted fix. The gates widen with the cycles
that passed since then, and are open until there is a first fix.

Positions and directions are compared as vectors, so that neither a pole nor the vertical is a
special place. A sensed value is given the reach of the value that the load's model expects at the
fix, where the last one's own reach is too short: one that was wrongly believed to be small must not
keep the right one out.
"""

import math

from flight_sw import icd
from flight_sw.model.angles import wrapped
from flight_sw.model.atmosphere import density
from flight_sw.model.onboard import heat_flux, modelled_forces
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel

POSITION = icd.slot("NAV_POSITION")
VERTICAL = icd.slot("NAV_VERTICAL")
DIRECTION = icd.slot("NAV_DIRECTION")
AERO = icd.slot("NAV_AERO")
ATTITUDE = icd.slot("NAV_ATTITUDE")
HEATING = icd.slot("NAV_HEATING")
TIME = icd.slot("NAV_TIME")

LON = icd.value_index("NAV_POSITION", "lon_rad")
LAT = icd.value_index("NAV_POSITION", "lat_rad")
ALT = icd.value_index("NAV_VERTICAL", "alt_m")
SPEED = icd.value_index("NAV_VERTICAL", "v_rel_mps")
PATH_ANGLE = icd.value_index("NAV_DIRECTION", "flight_path_angle_rad")
HEADING_ANGLE = icd.value_index("NAV_DIRECTION", "heading_rad")
DRAG = icd.value_index("NAV_AERO", "drag_mps2")
LIFT = icd.value_index("NAV_AERO", "lift_mps2")
BANK = icd.value_index("NAV_ATTITUDE", "bank_rad")
ALPHA = icd.value_index("NAV_ATTITUDE", "alpha_rad")
HEAT_FLUX = icd.value_index("NAV_HEATING", "heat_flux_wpm2")
T = icd.value_index("NAV_TIME", "t_s")

TIME_SLACK_CYCLES = 16.0  # time messages that may be lost before the next one looks false

GATES = RecordSpec(
    "gates",
    Field("distance_margin_m", 0.0, 1e6, "allowed beyond speed times time"),
    Field("accel_max_mps2", 0.1, 1e5, "change of speed"),
    Field(
        "turn_rate_max_radps",
        math.radians(0.1),
        math.radians(1e4),
        "change of path angle and heading",
    ),
    Field("sensed_ratio", 0.0, 1e3, "change of a sensed acceleration in one cycle, of its value"),
    Field("sensed_margin_mps2", 0.0, 1e5, "and beyond that"),
    Field("heat_flux_ratio_ps", 0.0, 1e3, "change of heat flux a second, of its value"),
    Field("heat_flux_margin_wpm2", 0.0, 1e9, "and beyond that"),
    Field(
        "attitude_margin_rad",
        math.radians(1e-3),
        math.tau,
        "a cycle, beyond the way from flown to commanded",
    ),
    Field("agreeing_cycles", 3, 1_000_000, "refused sets that agree, then believed", kind="u4"),
)

Vector = tuple[float, float, float]


@kernel
def _on_the_way(angle_rad: float, flown_rad: float, command_rad: float, margin_rad: float) -> bool:
    """Whether an angle lies between the one flown last and the one commanded, either way round."""
    detour_rad = abs(wrapped(angle_rad - flown_rad)) + abs(wrapped(command_rad - angle_rad))
    return detour_rad <= abs(wrapped(command_rad - flown_rad)) + 2.0 * margin_rad


@kernel
def unit_position(lon_rad: float, lat_rad: float) -> Vector:
    """Direction of a place from the planet's centre, in axes that turn with the planet."""
    cos_lat = math.cos(lat_rad)
    return cos_lat * math.cos(lon_rad), cos_lat * math.sin(lon_rad), math.sin(lat_rad)


@kernel
def unit_velocity(lon_rad: float, lat_rad: float, gamma_rad: float, heading_rad: float) -> Vector:
    """Direction of flight in the same axes."""
    sin_lon, cos_lon = math.sin(lon_rad), math.cos(lon_rad)
    sin_lat, cos_lat = math.sin(lat_rad), math.cos(lat_rad)
    up = math.sin(gamma_rad)
    north = math.cos(gamma_rad) * math.cos(heading_rad)
    east = math.cos(gamma_rad) * math.sin(heading_rad)
    outward = up * cos_lat - north * sin_lat
    return (
        outward * cos_lon - east * sin_lon,
        outward * sin_lon + east * cos_lon,
        up * sin_lat + north * cos_lat,
    )


@kernel
def chord_sq(a: Vector, b: Vector) -> float:
    """Square of the distance of two points of the unit sphere."""
    x, y, z = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    return x * x + y * y + z * z


@kernel
def within_angle(a: Vector, b: Vector, angle_rad: float) -> bool:
    """Whether two directions are at most so far apart."""
    if angle_rad >= math.pi:
        return True
    longest = 2.0 * math.sin(0.5 * angle_rad)
    return chord_sq(a, b) <= longest * longest


@kernel
def _attitude(gates: Record, state: Record, nav: Record, values: F8, cycles: int) -> bool:
    """Flown angles lie between those flown last and those commanded, within a margin a cycle."""
    margin_rad = gates["attitude_margin_rad"] * cycles
    bank = state["bank_limiter"]
    alpha = state["alpha_limiter"]
    if bank["started"] == 0:
        return True
    return _on_the_way(
        values[BANK], nav["bank_rad"], bank["command_rad"], margin_rad
    ) and _on_the_way(values[ALPHA], nav["alpha_rad"], alpha["command_rad"], margin_rad)


@kernel
def _position(nav: Record, values: F8, reach_rad: float) -> bool:
    """Position within reach of the last fix, as an angle at the planet's centre."""
    north_rad = values[LAT] - nav["lat_rad"]
    east_rad = wrapped(values[LON] - nav["lon_rad"])
    if north_rad * north_rad + east_rad * east_rad <= reach_rad * reach_rad:
        return True  # at any latitude
    here = unit_position(values[LON], values[LAT])
    return within_angle(here, unit_position(nav["lon_rad"], nav["lat_rad"]), reach_rad)


@kernel
def _direction(nav: Record, values: F8, place: F8, turn_rad: float) -> bool:
    """Direction of flight within a turn of the last fix; `place` holds the position it is at."""
    up_rad = values[PATH_ANGLE] - nav["flight_path_angle_rad"]
    right_rad = wrapped(values[HEADING_ANGLE] - nav["heading_rad"])
    moved_rad = wrapped(place[LON] - nav["lon_rad"])
    if up_rad * up_rad + right_rad * right_rad + moved_rad * moved_rad <= turn_rad * turn_rad:
        return True  # in any axes
    then = unit_velocity(
        nav["lon_rad"], nav["lat_rad"], nav["flight_path_angle_rad"], nav["heading_rad"]
    )
    now = unit_velocity(place[LON], place[LAT], values[PATH_ANGLE], values[HEADING_ANGLE])
    return within_angle(now, then, turn_rad)


@kernel
def _motion(
    gates: Record, nav: Record, slot: int, values: F8, place: F8, reach: tuple[float, float]
) -> bool:
    """Position, speed and direction within reach of the last fix; `reach` is span and radius."""
    span_s, radius_m = reach
    faster_mps = gates["accel_max_mps2"] * span_s
    reach_m = (nav["v_rel_mps"] + faster_mps) * span_s + gates["distance_margin_m"]
    if slot == POSITION:
        return _position(nav, values, reach_m / radius_m)
    if slot == VERTICAL:
        return (
            abs(values[ALT] - nav["alt_m"]) <= reach_m
            and abs(values[SPEED] - nav["v_rel_mps"]) <= faster_mps
        )
    return _direction(nav, values, place, gates["turn_rate_max_radps"] * span_s)


@kernel
def _aero(load: Record, state: Record, nav: Record, values: F8, cycles: int) -> bool:
    """Sensed accelerations near those of the last fix, or of the model there."""
    gates = load["gates"]
    margin_mps2 = gates["sensed_margin_mps2"] * cycles
    ratio = gates["sensed_ratio"] * cycles
    drag_mps2 = abs(values[DRAG] - nav["drag_mps2"]) - margin_mps2
    lift_mps2 = abs(values[LIFT] - nav["lift_mps2"]) - margin_mps2
    if drag_mps2 <= ratio * nav["drag_mps2"] and lift_mps2 <= ratio * nav["lift_mps2"]:
        return True
    modelled = state["modelled"]
    modelled_forces(
        load["onboard"],
        load["atmosphere"],
        nav["alt_m"],
        nav["v_rel_mps"],
        nav["alpha_rad"],
        modelled,
    )
    return drag_mps2 <= ratio * max(nav["drag_mps2"], modelled["drag_mps2"]) and (
        lift_mps2 <= ratio * max(nav["lift_mps2"], abs(modelled["lift_mps2"]))
    )


@kernel
def _heating(load: Record, nav: Record, values: F8, cycles: int, span_s: float) -> bool:
    """Heat flux near that of the last fix, or of the model there."""
    gates = load["gates"]
    ratio = gates["heat_flux_ratio_ps"] * span_s
    beyond_wpm2 = (
        abs(values[HEAT_FLUX] - nav["heat_flux_wpm2"]) - gates["heat_flux_margin_wpm2"] * cycles
    )
    if beyond_wpm2 <= ratio * nav["heat_flux_wpm2"]:
        return True
    rho_kgpm3 = density(load["atmosphere"], nav["alt_m"])
    return beyond_wpm2 <= ratio * heat_flux(load["onboard"], rho_kgpm3, nav["v_rel_mps"])


@kernel
def follows(
    load: Record, state: Record, nav: Record, cycles: int, slot: int, values: F8, place: F8
) -> bool:
    """Whether message `slot`, decoded in `values`, can be `cycles` after the fix `nav`.

    `place` is a vector of values that holds the position at which a direction was measured.
    """
    span_s = cycles * load["dt_s"]
    if slot in (POSITION, VERTICAL, DIRECTION):
        return _motion(load["gates"], nav, slot, values, place, (span_s, state["radius_m"]))
    if slot == TIME:
        step_s = values[T] - nav["t_s"]
        return 0.5 * load["dt_s"] <= step_s <= span_s + TIME_SLACK_CYCLES * load["dt_s"]
    if slot == ATTITUDE:
        return _attitude(load["gates"], state, nav, values, cycles)
    if slot == AERO:
        return _aero(load, state, nav, values, cycles)
    return slot != HEATING or _heating(load, nav, values, cycles, span_s)


@kernel
def plausible(load: Record, state: Record, slot: int, values: F8) -> bool:
    """Whether message `slot`, decoded in `values`, can follow the last accepted fix."""
    if state["had_fix"] == 0:
        return True
    cycles = state["cycles_without_fix"] + 1
    return follows(load, state, state["nav"], cycles, slot, values, state["accepted"])
