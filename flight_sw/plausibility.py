"""Gates on navigation: could this fix have followed the last one?

A CRC of eight bits lets one random frame in 256 pass. A message is therefore also refused where no
vehicle could have moved as it says since the last accepted fix. The gates widen with the cycles
that passed since then, and are open until there is a first fix.
"""

import math

from flight_sw import icd
from flight_sw.fields import Field, RecordSpec
from flight_sw.jit import kernel
from flight_sw.types_ import F8, Record

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
COS_LAT_MIN = 0.02  # no gate on longitude nearer to a pole than 1.1 deg
INSIDE_RAD = 3.0  # an angle within it is what wrapping it gives, bit for bit
COS_GAMMA_MIN = 0.1  # no gate on heading within 6 deg of the vertical

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
)


@kernel
def wrapped(angle_rad: float) -> float:
    """The same angle within +-pi."""
    if abs(angle_rad) <= INSIDE_RAD:
        return angle_rad
    return angle_rad - math.tau * math.floor((angle_rad + math.pi) / math.tau)


@kernel
def _on_the_way(angle_rad: float, flown_rad: float, command_rad: float, margin_rad: float) -> bool:
    """Whether an angle lies between the one flown last and the one commanded, either way round."""
    detour_rad = abs(wrapped(angle_rad - flown_rad)) + abs(wrapped(command_rad - angle_rad))
    return detour_rad <= abs(wrapped(command_rad - flown_rad)) + 2.0 * margin_rad


@kernel
def _attitude(gates: Record, state: Record, values: F8, cycles: int) -> bool:
    """Flown angles lie between those flown last and those commanded, within a margin a cycle."""
    nav = state["nav"]
    margin_rad = gates["attitude_margin_rad"] * cycles
    bank = state["bank_limiter"]
    alpha = state["alpha_limiter"]
    if bank["started"] == 0:
        return True
    return _on_the_way(
        values[BANK], nav["bank_rad"], bank["command_rad"], margin_rad
    ) and _on_the_way(values[ALPHA], nav["alpha_rad"], alpha["command_rad"], margin_rad)


@kernel
def _position(nav: Record, values: F8, radius_m: float, reach_m: float) -> bool:
    """Position within reach of the last fix."""
    north_m = abs(values[LAT] - nav["lat_rad"]) * radius_m
    east_rad = abs(wrapped(values[LON] - nav["lon_rad"]))
    if north_m <= reach_m and east_rad * radius_m <= reach_m:
        return True  # at any latitude
    cos_lat = math.cos(nav["lat_rad"])
    return north_m <= reach_m and (
        east_rad * cos_lat * radius_m <= reach_m or cos_lat < COS_LAT_MIN
    )


@kernel
def _motion(gates: Record, state: Record, slot: int, values: F8, span_s: float) -> bool:
    """Position, speed and direction within reach of the last fix."""
    nav = state["nav"]
    reach_m = nav["v_rel_mps"] * span_s + gates["distance_margin_m"]
    if slot == POSITION:
        return _position(nav, values, state["radius_m"], reach_m)
    if slot == VERTICAL:
        return (
            abs(values[ALT] - nav["alt_m"]) <= reach_m
            and abs(values[SPEED] - nav["v_rel_mps"]) <= gates["accel_max_mps2"] * span_s
        )
    turn_rad = gates["turn_rate_max_radps"] * span_s
    if not abs(values[PATH_ANGLE] - nav["flight_path_angle_rad"]) <= turn_rad:
        return False
    if abs(wrapped(values[HEADING_ANGLE] - nav["heading_rad"])) <= turn_rad:
        return True
    return math.cos(nav["flight_path_angle_rad"]) < COS_GAMMA_MIN


@kernel
def _sensed(gates: Record, nav: Record, slot: int, values: F8, cycles: int, span_s: float) -> bool:
    """Sensed accelerations and heat flux near those of the last fix."""
    if slot == AERO:
        margin_mps2 = gates["sensed_margin_mps2"] * cycles
        ratio = gates["sensed_ratio"] * cycles
        return (
            abs(values[DRAG] - nav["drag_mps2"]) <= ratio * nav["drag_mps2"] + margin_mps2
            and abs(values[LIFT] - nav["lift_mps2"]) <= ratio * nav["lift_mps2"] + margin_mps2
        )
    reach_wpm2 = (
        gates["heat_flux_ratio_ps"] * span_s * nav["heat_flux_wpm2"]
        + gates["heat_flux_margin_wpm2"] * cycles
    )
    return slot != HEATING or abs(values[HEAT_FLUX] - nav["heat_flux_wpm2"]) <= reach_wpm2


@kernel
def plausible(load: Record, state: Record, slot: int, values: F8) -> bool:
    """Whether message `slot`, decoded in `values`, can follow the last accepted fix."""
    if state["had_fix"] == 0:
        return True
    gates = load["gates"]
    nav = state["nav"]
    cycles = state["cycles_without_fix"] + 1
    span_s = cycles * load["dt_s"]
    if slot in (POSITION, VERTICAL, DIRECTION):
        return _motion(gates, state, slot, values, span_s)
    if slot == TIME:
        step_s = values[T] - nav["t_s"]
        return 0.5 * load["dt_s"] <= step_s <= span_s + TIME_SLACK_CYCLES * load["dt_s"]
    if slot == ATTITUDE:
        return _attitude(gates, state, values, cycles)
    return _sensed(gates, nav, slot, values, cycles, span_s)
