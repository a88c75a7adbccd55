"""Slow twin of the predictor: the motion of docs/laws/drag.md, section 22, as vectors in a plane.

Position and velocity are Cartesian in the vertical plane of the fix, x ahead and y up, the planet's
turn enters as -2 Omega x v and -Omega x (Omega x r) of its vector in local east, north, up. Nothing
is in polar form, and the end is found by the integrator's root finder, so that the twin can
disagree with the kernel's steps.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from tests.flight_sw.mars_cases import MU, RADIUS_M, RHO0, SCALE_M

Plane = np.ndarray


class Vehicle(NamedTuple):
    """What the law has sensed of it, and the planet under it."""

    drag_area_m2pkg: float
    """Drag over rho V^2."""
    lift_area_m2pkg: float
    spin_radps: float = 0.0
    lat_rad: float = 0.0
    heading_rad: float = math.pi / 2.0


class Plan(NamedTuple):
    """The bank of the flight ahead, and where it ends."""

    bank_fast_rad: float
    bank_slow_rad: float
    v_fast_mps: float
    v_slow_mps: float
    end_speed_mps: float
    end_alt_m: float
    cos_low: float = -1.0
    cos_high: float = 1.0

    def cos_nominal(self, v_mps: float) -> float:
        """Of a bank on a straight line over speed."""
        speeds = self.v_slow_mps, self.v_fast_mps
        banks = self.bank_slow_rad, self.bank_fast_rad
        return math.cos(float(np.interp(v_mps, speeds, banks)))

    def cos_bank(self, v_mps: float, shift: float) -> float:
        """Shifted, within its limits."""
        return min(max(self.cos_nominal(v_mps) + shift, self.cos_low), self.cos_high)


def turned(vehicle: Vehicle, up: Plane, velocity: Plane, radius_m: float) -> Plane:
    """Coriolis and centrifugal acceleration in the plane, the planet's turn as a vector."""
    east_north_up = vehicle.spin_radps * np.array(
        [0.0, math.cos(vehicle.lat_rad), math.sin(vehicle.lat_rad)]
    )
    ahead_3d = np.array([math.sin(vehicle.heading_rad), math.cos(vehicle.heading_rad), 0.0])
    up_3d = np.array([0.0, 0.0, 1.0])
    ahead = np.array([up[1], -up[0]])
    v_3d = velocity @ ahead * ahead_3d + velocity @ up * up_3d
    coriolis = -2.0 * np.cross(east_north_up, v_3d)
    outward = -np.cross(east_north_up, np.cross(east_north_up, radius_m * up_3d))
    # Of the centrifugal part the plane keeps what is up; its northward rest is left out.
    along_up = coriolis @ up_3d + outward @ up_3d
    return np.asarray(along_up * up + (coriolis @ ahead_3d) * ahead)


def end_of(
    fix: dict[str, float], vehicle: Vehicle, plan: Plan, shift: float
) -> tuple[float, float, float]:
    """Way flown over the sphere from the fix to the end in metres, altitude and speed there."""

    def rates(_: float, state: np.ndarray) -> np.ndarray:
        position, velocity = state[:2], state[2:]
        r, v = float(np.hypot(*position)), float(np.hypot(*velocity))
        up = position / r
        rho = RHO0 * math.exp(-(r - RADIUS_M) / SCALE_M)
        forward, across = velocity / v, np.array([-velocity[1], velocity[0]]) / v
        drag = -vehicle.drag_area_m2pkg * rho * v * v * forward
        lift = vehicle.lift_area_m2pkg * rho * v * v * plan.cos_bank(v, shift) * across
        gravity = -MU / r**2 * up
        return np.concatenate([velocity, drag + lift + gravity + turned(vehicle, up, velocity, r)])

    def fast(_: float, state: np.ndarray) -> float:
        return float(np.hypot(*state[2:])) - plan.end_speed_mps

    def high(_: float, state: np.ndarray) -> float:
        return float(np.hypot(*state[:2])) - RADIUS_M - plan.end_alt_m

    for end in (fast, high):
        end.terminal, end.direction = True, -1.0  # type: ignore[attr-defined]
    gamma, v = fix["flight_path_angle_rad"], fix["v_rel_mps"]
    start = [0.0, RADIUS_M + fix["alt_m"], v * math.cos(gamma), v * math.sin(gamma)]
    flown = solve_ivp(rates, (0.0, 2000.0), start, events=(fast, high), rtol=1e-9, atol=1e-6)
    x, y, vx, vy = flown.y[:, -1]
    return RADIUS_M * math.atan2(x, y), math.hypot(x, y) - RADIUS_M, math.hypot(vx, vy)
