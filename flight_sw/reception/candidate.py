"""Dead reckoning: which of two frames is nearer to it, and which doubted sets move as they say.

Sets that were refused, follow each other through the gates and are where their own speed, path and
sensed drag have led since the first of them are a candidate for the fix.
"""

import math

import numpy as np

from flight_sw.model.angles import wrapped
from flight_sw.reception import plausibility as gate
from flight_sw.reception.receiver import COUNTER_MASK
from flight_sw.records.dictionary import NAV
from flight_sw.records.types_ import F8, Record
from flight_sw.runtime.jit import kernel

NAV_SLOTS = (gate.POSITION, gate.VERTICAL, gate.DIRECTION, gate.AERO, gate.ATTITUDE, gate.HEATING)
GAP_MAX_CYCLES = 5  # between two sets of a candidate
DISTANCE_SCALE_MIN_M = 1.0  # of a comparison, where the design's margin is smaller

CANDIDATE = np.dtype(
    [
        ("agreeing", "u4"),  # sets in a row, 0: there is no candidate
        ("counter", "u4"),  # of the last one
        ("believed", "u4"),  # candidates that became the fix
        ("nav", NAV),  # the last one
        ("cos_reckoned_x", "f8"),  # unit vector reckoned from the first one on
        ("cos_reckoned_y", "f8"),
        ("cos_reckoned_z", "f8"),
        ("reckoned_alt_m", "f8"),
        ("reckoned_v_rel_mps", "f8"),
    ],
    align=True,
)


@kernel
def fill_nav(nav: Record, values: F8) -> None:
    """A set's values as a navigation fix."""
    nav["t_s"] = values[gate.T]
    nav["lon_rad"] = values[gate.LON]
    nav["lat_rad"] = values[gate.LAT]
    nav["alt_m"] = values[gate.ALT]
    nav["v_rel_mps"] = values[gate.SPEED]
    nav["flight_path_angle_rad"] = values[gate.PATH_ANGLE]
    nav["heading_rad"] = values[gate.HEADING_ANGLE]
    nav["drag_mps2"] = values[gate.DRAG]
    nav["lift_mps2"] = values[gate.LIFT]
    nav["bank_rad"] = values[gate.BANK]
    nav["alpha_rad"] = values[gate.ALPHA]
    nav["heat_flux_wpm2"] = values[gate.HEAT_FLUX]


@kernel
def _along(nav: Record, radius_m: float, span_s: float) -> gate.Vector:
    """Way over the ground in `span_s`, in units of the planet's radius."""
    way_rad = nav["v_rel_mps"] * span_s / (radius_m + nav["alt_m"])
    along = math.cos(nav["flight_path_angle_rad"]) * way_rad
    x, y, z = gate.unit_velocity(nav["lon_rad"], nav["lat_rad"], 0.0, nav["heading_rad"])
    return along * x, along * y, along * z


@kernel
def _deceleration(load: Record, nav: Record) -> float:
    """Change of speed a second, by the sensed drag and gravity."""
    planet = load["onboard"]["planet"]
    radius_m = planet["radius_m"] + nav["alt_m"]
    gravity_mps2 = planet["mu_m3ps2"] / (radius_m * radius_m)
    return -nav["drag_mps2"] - gravity_mps2 * math.sin(nav["flight_path_angle_rad"])


@kernel
def surprise(load: Record, state: Record, slot: int, values: F8) -> float:
    """How far a message is from what the last fix lets expect: comparable within a message."""
    nav = state["nav"]
    span_s = (np.int64(state["cycles_without_fix"]) + 1) * load["dt_s"]
    if slot == gate.POSITION:
        x, y, z = gate.unit_position(nav["lon_rad"], nav["lat_rad"])
        dx, dy, dz = _along(nav, state["radius_m"], span_s)
        here = gate.unit_position(values[gate.LON], values[gate.LAT])
        return gate.chord_sq(here, (x + dx, y + dy, z + dz))
    if slot == gate.VERTICAL:
        rise_m = nav["v_rel_mps"] * math.sin(nav["flight_path_angle_rad"]) * span_s
        v_mps = nav["v_rel_mps"] + _deceleration(load, nav) * span_s
        gates = load["gates"]
        off_m = abs(values[gate.ALT] - nav["alt_m"] - rise_m)
        off_mps = abs(values[gate.SPEED] - v_mps)
        scale_m = max(gates["distance_margin_m"], DISTANCE_SCALE_MIN_M)
        return off_m / scale_m + off_mps / (gates["accel_max_mps2"] * load["dt_s"])
    if slot == gate.DIRECTION:
        place = state["accepted"]
        then = gate.unit_velocity(
            nav["lon_rad"], nav["lat_rad"], nav["flight_path_angle_rad"], nav["heading_rad"]
        )
        angle, heading = values[gate.PATH_ANGLE], values[gate.HEADING_ANGLE]
        now = gate.unit_velocity(place[gate.LON], place[gate.LAT], angle, heading)
        return gate.chord_sq(now, then)
    if slot == gate.AERO:
        return abs(values[gate.DRAG] - nav["drag_mps2"]) + abs(values[gate.LIFT] - nav["lift_mps2"])
    if slot == gate.ATTITUDE:
        bank_rad = wrapped(values[gate.BANK] - state["bank_limiter"]["command_rad"])
        alpha_rad = wrapped(values[gate.ALPHA] - state["alpha_limiter"]["command_rad"])
        return abs(bank_rad) + abs(alpha_rad)
    return abs(values[gate.HEAT_FLUX] - nav["heat_flux_wpm2"])


@kernel
def _start_candidate(candidate: Record, values: F8) -> None:
    x, y, z = gate.unit_position(values[gate.LON], values[gate.LAT])
    candidate["agreeing"] = 1
    candidate["cos_reckoned_x"] = x
    candidate["cos_reckoned_y"] = y
    candidate["cos_reckoned_z"] = z
    candidate["reckoned_alt_m"] = values[gate.ALT]
    candidate["reckoned_v_rel_mps"] = values[gate.SPEED]


@kernel
def _reckon(load: Record, state: Record, cycles: int) -> None:
    """Move the candidate's reckoned place and speed on as its last set says that it moves."""
    candidate = state["candidate"]
    nav = candidate["nav"]
    span_s = cycles * load["dt_s"]
    dx, dy, dz = _along(nav, state["radius_m"], span_s)
    candidate["cos_reckoned_x"] += dx
    candidate["cos_reckoned_y"] += dy
    candidate["cos_reckoned_z"] += dz
    candidate["reckoned_alt_m"] += (
        nav["v_rel_mps"] * math.sin(nav["flight_path_angle_rad"]) * span_s
    )
    candidate["reckoned_v_rel_mps"] += _deceleration(load, nav) * span_s


@kernel
def _is_flown(load: Record, state: Record, values: F8) -> bool:
    """Whether a set is where the candidate's own motion has led since its first one."""
    candidate = state["candidate"]
    gates = load["gates"]
    frame_s = load["dt_s"]
    reach_mps = gates["accel_max_mps2"] * frame_s
    reach_m = gates["distance_margin_m"] + candidate["reckoned_v_rel_mps"] * frame_s
    reckoned = (
        candidate["cos_reckoned_x"],
        candidate["cos_reckoned_y"],
        candidate["cos_reckoned_z"],
    )
    here = gate.unit_position(values[gate.LON], values[gate.LAT])
    reach_rad = reach_m / state["radius_m"]
    return (
        abs(values[gate.SPEED] - candidate["reckoned_v_rel_mps"]) <= reach_mps
        and abs(values[gate.ALT] - candidate["reckoned_alt_m"]) <= reach_m
        and gate.within_angle(here, reckoned, reach_rad)
    )


@kernel
def _goes_on(load: Record, state: Record, counter: int, values: F8) -> bool:
    """Whether a set follows the candidate's last: through every gate, and as it was moving."""
    candidate = state["candidate"]
    nav = candidate["nav"]
    if candidate["agreeing"] == 0:
        return False
    cycles = np.int64(math.floor((values[gate.T] - nav["t_s"]) / load["dt_s"] + 0.5))
    steps = counter - np.int64(candidate["counter"])
    if not 1 <= cycles <= GAP_MAX_CYCLES or (cycles - steps) & COUNTER_MASK != 0:
        return False
    for slot in NAV_SLOTS:
        if not gate.follows(load, state, nav, cycles, slot, values, values):
            return False
    _reckon(load, state, cycles)
    return _is_flown(load, state, values)


@kernel
def join(load: Record, state: Record, counter: int, values: F8) -> bool:
    """Take a whole set that was refused as the candidate's next; True once it is believed."""
    candidate = state["candidate"]
    if candidate["agreeing"] > 0 and values[gate.T] == candidate["nav"]["t_s"]:
        return False  # the same set once more
    if _goes_on(load, state, counter, values):
        candidate["agreeing"] += 1
    else:
        _start_candidate(candidate, values)
    candidate["counter"] = counter
    fill_nav(candidate["nav"], values)
    if candidate["agreeing"] < load["gates"]["agreeing_cycles"]:
        return False
    candidate["believed"] += 1
    return True
