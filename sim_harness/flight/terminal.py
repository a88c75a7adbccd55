"""How a flight ended against its target, and which end condition ended it.

The final state of a flight is its first minor frame at or below the end condition; errors are told
at the moment within that frame at which the condition was met, so that they do not depend on where
frames happen to fall (up to 10 m at 50 Hz and 500 m/s). Signs: downrange is target minus flown,
altitude and speed flown minus target.
"""

import math
from typing import Any, NamedTuple

from flight_sw.model.great_circle import range_flown
from flight_sw.records.types_ import Record
from sim_harness.mission.mission import Mission
from sim_harness.world.motion import rates
from sim_harness.world.planet.gravity import jacobi_energy
from sim_harness.world.records import END_CONDITION
from sim_harness.world.vehicle import is_low, is_slow, is_spent, is_there

TRIGGERS = (("speed", is_slow), ("altitude", is_low), ("target", is_there), ("energy", is_spent))

FULL_TURN_DEG = 360.0

Vector = tuple[float, float, float]


class State(NamedTuple):
    """Where the vehicle is and how it moves."""

    lon_rad: float
    lat_rad: float
    alt_m: float
    v_rel_mps: float
    flight_path_angle_rad: float
    heading_rad: float


STATE_NAMES = State._fields


class TerminalErrors(NamedTuple):
    """Miss of the target; None everywhere without one."""

    downrange_error_km: float | None = None
    """Target minus flown along the great circle from entry to target: short is positive."""
    crossrange_error_km: float | None = None
    """Distance from that great circle, positive to its right."""
    altitude_error_km: float | None = None
    speed_error_mps: float | None = None
    latitude_error_deg: float | None = None
    longitude_error_deg: float | None = None
    path_angle_error_deg: float | None = None
    heading_error_deg: float | None = None


def direction(lon_rad: float, lat_rad: float) -> Vector:
    """Unit vector of a place: x to longitude 0, z to the north pole."""
    cos_lat = math.cos(lat_rad)
    return cos_lat * math.cos(lon_rad), cos_lat * math.sin(lon_rad), math.sin(lat_rad)


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def ranges_rad(start: Vector, target: Vector, flown: Vector) -> tuple[float, float, float]:
    """Arc from start to target, arc flown along it, and arc to its right, on the unit sphere.

    A target at the start or opposite to it leaves the great circle open: the arc flown is then the
    distance from the start, and there is no right or left.
    """
    normal = _cross(start, target)  # to the left of the way
    length = math.sqrt(_dot(normal, normal))
    wanted = math.atan2(length, _dot(start, target))
    if length == 0.0:
        apart = _cross(start, flown)
        return wanted, math.atan2(math.sqrt(_dot(apart, apart)), _dot(start, flown)), 0.0
    left = (normal[0] / length, normal[1] / length, normal[2] / length)
    ahead = _cross(left, start)
    right = -math.asin(min(max(_dot(flown, left), -1.0), 1.0))
    return wanted, math.atan2(_dot(flown, ahead), _dot(flown, start)), right


def state_of(truth: Record) -> State:
    """Position and velocity of a truth record."""
    return State(*(float(truth[name]) for name in STATE_NAMES))


def _moved(state: State, by_s: float, moving: tuple[float, ...]) -> State:
    return State(*(x + by_s * rate for x, rate in zip(state, moving, strict=True)))


def _rates(world: Record, truth: Record, state: State) -> tuple[float, ...]:
    """Rates of a state, with the attitude that the frame was flown with."""
    return tuple(
        rates(
            world,
            truth["held"],
            state.lat_rad,
            state.alt_m,
            state.v_rel_mps,
            state.flight_path_angle_rad,
            state.heading_rad,
        )[: len(STATE_NAMES)]
    )


def energy_of(world: Record, state: State) -> float:
    """Jacobi's energy, J/kg."""
    planet = world["planet"]
    radius_m = float(planet["radius_m"]) + state.alt_m
    s, c = math.sin(state.lat_rad), math.cos(state.lat_rad)
    return float(jacobi_energy(planet, radius_m, s, c, state.v_rel_mps))


def time_past(world: Record, state: State, moving: tuple[float, ...]) -> float:
    """How long before a state the first of the end conditions was met; at most a minor frame."""
    end, radius_m = world["end"], float(world["planet"]["radius_m"])
    alt_rate, v_rate = moving[2], moving[3]
    past_s = 0.0
    if v_rate < 0.0 and state.v_rel_mps <= end["speed_mps"]:
        past_s = (state.v_rel_mps - end["speed_mps"]) / v_rate
    if alt_rate < 0.0 and state.alt_m <= end["alt_m"]:
        past_s = max(past_s, (state.alt_m - end["alt_m"]) / alt_rate)
    before = _moved(state, -float(world["dt_s"]), moving)
    spent = energy_of(world, state)
    if spent <= end["energy_jpkg"] and energy_of(world, before) > spent:
        lost = energy_of(world, before) - spent
        past_s = max(past_s, (end["energy_jpkg"] - spent) / lost * world["dt_s"])
    if end["at_target"] == 1:
        track = end["ground_track"]
        here_m = range_flown(track, radius_m, state.lon_rad, state.lat_rad)
        gained_m = here_m - range_flown(track, radius_m, before.lon_rad, before.lat_rad)
        if here_m >= track["target_m"] and gained_m > 0.0:
            past_s = max(past_s, (here_m - track["target_m"]) / gained_m * world["dt_s"])
    return float(min(past_s, world["dt_s"]))


def state_at_end(world: Record, truth: Record, outcome: int) -> State:
    """The state when the end condition was met, within the last frame; otherwise the last state.

    Backwards by the rates of the middle of that time: second order in the frame.
    """
    last = state_of(truth)
    if outcome != END_CONDITION:
        return last
    moving = _rates(world, truth, last)
    for _ in range(2):  # the second pass takes the time from the middle's rates as well
        half = _moved(last, -0.5 * time_past(world, last, moving), _rates(world, truth, last))
        moving = _rates(world, truth, half)
    return _moved(last, -time_past(world, last, moving), moving)


def terminal_errors(mission: Mission, state: State) -> TerminalErrors:
    """Errors of a state against the mission's target."""
    target = mission.target
    if target is None:
        return TerminalErrors()
    entry = mission.entry
    wanted, flown, right = ranges_rad(
        direction(math.radians(entry.longitude_deg), math.radians(entry.latitude_deg)),
        direction(math.radians(target.longitude_deg), math.radians(target.latitude_deg)),
        direction(state.lon_rad, state.lat_rad),
    )
    return TerminalErrors(
        mission.planet.radius_km * (wanted - flown),
        mission.planet.radius_km * right,
        state.alt_m / 1e3 - target.altitude_km,
        state.v_rel_mps - target.speed_mps,
        math.degrees(state.lat_rad) - target.latitude_deg,
        math.remainder(math.degrees(state.lon_rad) - target.longitude_deg, FULL_TURN_DEG),
        _beyond(math.degrees(state.flight_path_angle_rad), target.final_path_angle_deg),
        _beyond(math.degrees(state.heading_rad), target.final_heading_deg),
    )


def _beyond(flown_deg: float, wanted_deg: float | None) -> float | None:
    """An angle less the one wanted, between -180 and 180 deg; None where none is."""
    if wanted_deg is None:
        return None
    return math.remainder(flown_deg - wanted_deg, FULL_TURN_DEG)


def end_trigger(world: Record, truth: Record, outcome: int) -> str | None:
    """Which part of the end condition ended the flight; None if it ended otherwise."""
    if outcome != END_CONDITION:
        return None
    return " and ".join(name for name, is_met in TRIGGERS if is_met(world, truth))


def told(mission: Mission, world: Record, truth: Record, outcome: int) -> dict[str, Any]:
    """What summary.json says of the end of a flight."""
    errors = terminal_errors(mission, state_at_end(world, truth, outcome))
    return {"end_trigger": end_trigger(world, truth, outcome), **errors._asdict()}
