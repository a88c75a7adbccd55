"""Each gate on navigation, on both sides of its limit."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flight_sw import icd
from flight_sw.computer import new_state
from flight_sw.model.angles import wrapped
from flight_sw.reception import plausibility as gate
from flight_sw.reception.plausibility import plausible, unit_position
from tests.system.flights import built

DT_S = 0.02
RADIUS_M = 6378137.0
HAIR = 1e-9  # of a limit: just inside and just outside

GATE = {
    "distance_margin_m": 200.0,
    "accel_max_mps2": 400.0,
    "turn_rate_max_radps": 1.0,
    "sensed_ratio": 1.5,
    "sensed_margin_mps2": 0.5,
    "heat_flux_ratio_ps": 2.0,
    "heat_flux_margin_wpm2": 2000.0,
    "attitude_margin_rad": 0.05,
}
FIX = {
    "t_s": 100.0, "lon_rad": 0.3, "lat_rad": 0.4, "alt_m": 70e3, "v_rel_mps": 7000.0,
    "flight_path_angle_rad": -0.02, "heading_rad": 1.0, "drag_mps2": 40.0, "lift_mps2": 60.0,
    "bank_rad": 1.0, "alpha_rad": 0.4, "heat_flux_wpm2": 5e6,
}  # fmt: skip
INDEX = {
    "lon_rad": gate.LON, "lat_rad": gate.LAT, "alt_m": gate.ALT, "v_rel_mps": gate.SPEED,
    "flight_path_angle_rad": gate.PATH_ANGLE, "heading_rad": gate.HEADING_ANGLE,
    "drag_mps2": gate.DRAG, "lift_mps2": gate.LIFT, "bank_rad": gate.BANK,
    "alpha_rad": gate.ALPHA, "heat_flux_wpm2": gate.HEAT_FLUX, "t_s": gate.T,
}  # fmt: skip
SLOTS = {
    "lon_rad": gate.POSITION, "lat_rad": gate.POSITION, "alt_m": gate.VERTICAL,
    "v_rel_mps": gate.VERTICAL, "flight_path_angle_rad": gate.DIRECTION,
    "heading_rad": gate.DIRECTION, "drag_mps2": gate.AERO, "lift_mps2": gate.AERO,
    "bank_rad": gate.ATTITUDE, "alpha_rad": gate.ATTITUDE, "heat_flux_wpm2": gate.HEATING,
    "t_s": gate.TIME,
}  # fmt: skip


class Gates:
    """A computer that has had one fix, and the gates it judges the next message with."""

    def __init__(self, cycles_without_fix: int = 0, **fix: float) -> None:
        self.load: Any = built("nominal").load.copy()
        for name, value in GATE.items():
            self.load["gates"][name] = value
        self.state: Any = new_state("nominal")
        self.state["had_fix"] = 1
        self.state["cycles_without_fix"] = cycles_without_fix
        self.state["radius_m"] = RADIUS_M
        self.fix = {**FIX, **fix}
        for name, value in self.fix.items():
            self.state["nav"][name] = value
            self.state["accepted"][0, INDEX[name]] = value
        for name, key in (("bank_limiter", "bank_rad"), ("alpha_limiter", "alpha_rad")):
            self.state[name]["started"] = 1
            self.state[name]["command_rad"] = self.fix[key]

    def move_to(self, **fix: float) -> None:
        """The last fix has these values instead."""
        for name, value in fix.items():
            self.fix[name] = value
            self.state["nav"][name] = value
            self.state["accepted"][0, INDEX[name]] = value

    def passes(self, **changes: float) -> bool:
        """Whether the message that carries these values is believed; the rest as in the fix."""
        values = np.zeros(icd.N_VALUES)
        for name, value in {**self.fix, "t_s": self.fix["t_s"] + DT_S, **changes}.items():
            values[INDEX[name]] = value
        (slot,) = {SLOTS[name] for name in changes}
        return bool(plausible(self.load[0], self.state[0], slot, values))


def swing(angle: float, cos_elevation: float) -> float:
    """How far a direction turns about an axis to be an angle away from where it was."""
    return 2.0 * math.asin(math.sin(angle / 2.0) / cos_elevation)


def reaches(cycles: int) -> dict[str, float]:
    """How far each value may move in so many cycles, in words of the gates' documentation.

    The sensed values of the fix are larger than those of the model: theirs is the reach.
    """
    span_s = cycles * DT_S
    way_m = (FIX["v_rel_mps"] + 400.0 * span_s) * span_s + 200.0
    return {
        "lon_rad": swing(way_m / RADIUS_M, math.cos(FIX["lat_rad"])),
        "lat_rad": way_m / RADIUS_M,
        "alt_m": way_m,
        "v_rel_mps": 400.0 * span_s,
        "flight_path_angle_rad": 1.0 * span_s,
        "heading_rad": swing(1.0 * span_s, math.cos(FIX["flight_path_angle_rad"])),
        "drag_mps2": cycles * (1.5 * FIX["drag_mps2"] + 0.5),
        "lift_mps2": cycles * (1.5 * FIX["lift_mps2"] + 0.5),
        "bank_rad": cycles * 0.05,  # at the commanded angle
        "alpha_rad": cycles * 0.05,
        "heat_flux_wpm2": 2.0 * span_s * FIX["heat_flux_wpm2"] + 2000.0 * cycles,
    }


@pytest.mark.parametrize("missed", [0, 1, 7])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("name", list(reaches(1)))
def test_a_value_may_move_as_far_as_its_gate_and_no_farther(
    name: str, sign: float, missed: int
) -> None:
    reach = reaches(missed + 1)[name]
    gates = Gates(cycles_without_fix=missed)
    assert gates.passes(**{name: FIX[name] + sign * reach * (1.0 - HAIR)})
    assert not gates.passes(**{name: FIX[name] + sign * reach * (1.0 + HAIR)})


@pytest.mark.parametrize("missed", [0, 5])
def test_time_moves_on_by_at_least_half_a_frame_and_not_too_far(missed: int) -> None:
    gates = Gates(cycles_without_fix=missed)
    longest_s = (missed + 1 + 16) * DT_S  # sixteen messages may be lost besides
    for step_s, passes in (
        (0.5 * DT_S + 1e-9, True), (0.5 * DT_S - 1e-9, False), (0.0, False), (-DT_S, False),
        (DT_S, True), (longest_s - 1e-9, True), (longest_s + 1e-9, False),
    ):  # fmt: skip
        assert gates.passes(t_s=FIX["t_s"] + step_s) is passes, step_s


def test_without_a_first_fix_everything_is_believed() -> None:
    gates = Gates()
    gates.state["had_fix"] = 0
    assert gates.passes(alt_m=3e5)
    assert gates.passes(t_s=-1.0)


@pytest.mark.parametrize("before", [math.pi - 1e-6, -math.pi + 1e-6])
def test_longitude_and_heading_pass_the_date_line(before: float) -> None:
    gates = Gates(lon_rad=before, heading_rad=before)
    after = -before
    assert gates.passes(lon_rad=after)
    assert gates.passes(heading_rad=after)
    assert not gates.passes(lon_rad=0.0)
    assert not gates.passes(heading_rad=0.0)


def along_a_great_circle(rng: np.random.Generator, miss_rad: float) -> dict[str, Any]:
    """Places and headings, by vectors, along a circle that passes a pole so near; 3 s each side."""
    pole = rng.choice([-1.0, 1.0])
    side = rng.uniform(-math.pi, math.pi)
    nearest = np.array([
        math.sin(miss_rad) * math.cos(side), math.sin(miss_rad) * math.sin(side),
        pole * math.cos(miss_rad),
    ])  # fmt: skip
    ahead = np.array([-math.sin(side), math.cos(side), 0.0])
    angle = 7500.0 / RADIUS_M * (np.arange(300) - 150.0 + rng.uniform(0.0, 1.0)) * DT_S
    place = np.outer(np.cos(angle), nearest) + np.outer(np.sin(angle), ahead)
    going = np.outer(np.cos(angle), ahead) - np.outer(np.sin(angle), nearest)
    lon = np.arctan2(place[:, 1], place[:, 0])
    east = np.stack([-np.sin(lon), np.cos(lon), np.zeros(300)], axis=1)
    north = np.cross(place, east)
    heading = np.arctan2((going * east).sum(1), (going * north).sum(1))
    return {"lon_rad": lon, "lat_rad": np.arcsin(place[:, 2]), "heading_rad": heading}


@pytest.mark.parametrize("miss_rad", [0.0, 1e-9, 1e-6, 1e-5, 1e-4, 1e-3, 0.02])
@pytest.mark.parametrize("seed", range(4))
def test_nothing_true_is_refused_on_a_way_past_a_pole(seed: int, miss_rad: float) -> None:
    way = along_a_great_circle(np.random.default_rng([seed, 20261130]), miss_rad)
    turned = np.abs(wrapped_array(np.diff(way["heading_rad"]))).max()
    assert turned > 0.02 or miss_rad > 1e-3  # the heading does swing about there
    gates = Gates(v_rel_mps=7500.0)
    for i in range(1, 300):
        gates.move_to(**{name: float(values[i - 1]) for name, values in way.items()})
        now = {name: float(values[i]) for name, values in way.items()}
        assert gates.passes(lon_rad=now["lon_rad"], lat_rad=now["lat_rad"])
        for name in ("lon_rad", "lat_rad"):
            gates.state["accepted"][0, INDEX[name]] = now[name]
        assert gates.passes(flight_path_angle_rad=-0.02, heading_rad=now["heading_rad"])


def wrapped_array(angles: Any) -> Any:
    """Angles within half a turn."""
    return np.remainder(angles + math.pi, math.tau) - math.pi


def test_at_a_pole_a_false_place_and_a_false_direction_are_refused() -> None:
    gates = Gates(lat_rad=math.pi / 2 - 1e-6, heading_rad=0.5)
    assert gates.passes(lon_rad=-2.0)  # a few metres away
    assert not gates.passes(lat_rad=math.pi / 2 - 1e-3)
    gates.state["accepted"][0, gate.LON] = FIX["lon_rad"] + 2.0  # beyond the pole, as it were
    assert gates.passes(heading_rad=0.5 + 2.0)  # the same way on
    assert not gates.passes(heading_rad=0.5)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_true_is_refused_in_a_vertical_dive(seed: int) -> None:
    rng = np.random.default_rng(seed)
    steep, turn = rng.uniform(0.0, 0.01), rng.uniform(0.3, 0.9)
    axis = np.array([0.0, math.sin(steep), -math.cos(steep)])  # east, north, up
    side = np.array([1.0, 0.0, 0.0])
    angle = turn * (np.arange(100) - 50.0) * DT_S
    flown = np.outer(np.cos(angle), axis) + np.outer(np.sin(angle), side)
    gamma, heading = np.arcsin(flown[:, 2]), np.arctan2(flown[:, 0], flown[:, 1])
    gates = Gates()
    for i in range(1, 100):
        gates.move_to(flight_path_angle_rad=float(gamma[i - 1]), heading_rad=float(heading[i - 1]))
        assert gates.passes(flight_path_angle_rad=float(gamma[i]), heading_rad=float(heading[i]))


def test_near_the_vertical_a_false_path_angle_is_refused() -> None:
    gates = Gates(flight_path_angle_rad=-math.pi / 2 + 1e-3)
    assert gates.passes(heading_rad=-2.0)
    assert not gates.passes(flight_path_angle_rad=-1.5)


@given(st.floats(-math.pi, math.pi), st.floats(-math.pi / 2, math.pi / 2))
def test_a_place_is_a_unit_vector(lon_rad: float, lat_rad: float) -> None:
    assert math.hypot(*unit_position(lon_rad, lat_rad)) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize(("name", "false", "true"), [
    ("drag_mps2", 0.0, 6.0), ("lift_mps2", 0.0, 6.0), ("heat_flux_wpm2", 0.0, 30e3),
])  # fmt: skip
def test_a_value_believed_to_be_nothing_does_not_keep_the_true_one_out(
    name: str, false: float, true: float
) -> None:
    # At 65 km and 7,000 m/s the model expects 10 m/s2 and more, and 1.4 MW/m2.
    assert Gates(alt_m=65e3, **{name: false}).passes(**{name: true})
    assert not Gates(alt_m=120e3, **{name: false}).passes(**{name: true})


def test_a_speed_believed_too_low_narrows_no_gate_for_ever() -> None:
    gates = Gates(cycles_without_fix=500, v_rel_mps=3000.0)
    assert gates.passes(v_rel_mps=7000.0)
    assert gates.passes(lat_rad=FIX["lat_rad"] + 7000.0 * 501 * DT_S / RADIUS_M)


@pytest.mark.parametrize(("flown", "command"), [
    (1.0, 1.5), (1.5, 1.0), (3.0, -3.0), (-3.0, 3.0), (-0.2, 0.3),
])  # fmt: skip
def test_a_flown_angle_lies_between_the_last_and_the_commanded_the_shorter_way(
    flown: float, command: float
) -> None:
    gates = Gates(bank_rad=flown)
    gates.state["bank_limiter"]["command_rad"] = command
    way = math.remainder(command - flown, math.tau)
    for share in (0.0, 0.3, 1.0):
        assert gates.passes(bank_rad=math.remainder(flown + share * way, math.tau))
    beyond = math.copysign(0.05, way)
    for end, outward in ((flown, -beyond), (command, beyond)):
        assert gates.passes(bank_rad=math.remainder(end + 0.999 * outward, math.tau))
        assert not gates.passes(bank_rad=math.remainder(end + 1.001 * outward, math.tau))


def test_before_the_first_command_any_attitude_is_believed() -> None:
    gates = Gates()
    gates.state["bank_limiter"]["started"] = 0
    assert gates.passes(bank_rad=-2.0)


@pytest.mark.parametrize(("name", "margin"), [("drag_mps2", 0.5), ("heat_flux_wpm2", 2000.0)])
def test_a_sensed_value_may_rise_from_nothing_by_its_margin(name: str, margin: float) -> None:
    gates = Gates(**{name: 0.0}, alt_m=500e3, v_rel_mps=1.0)  # the model expects nothing
    assert gates.passes(**{name: margin})
    assert not gates.passes(**{name: margin * (1.0 + HAIR)})


@pytest.mark.parametrize("name", ["lat_rad", "alt_m", "v_rel_mps", "drag_mps2", "heat_flux_wpm2"])
def test_nan_is_never_plausible(name: str) -> None:
    assert not Gates().passes(**{name: math.nan})


def test_messages_without_a_gate_are_believed() -> None:
    gates = Gates()
    for message in ("GROUND_REQUEST", "FSW_COMMAND"):
        assert plausible(gates.load[0], gates.state[0], icd.slot(message), np.zeros(icd.N_VALUES))


@given(st.floats(-50.0, 50.0))
def test_a_wrapped_angle_is_the_same_angle_within_half_a_turn(angle: float) -> None:
    found = wrapped(angle)
    assert -math.pi <= found <= math.pi
    assert math.sin(found) == pytest.approx(math.sin(angle), abs=1e-13)
    assert math.cos(found) == pytest.approx(math.cos(angle), abs=1e-13)
