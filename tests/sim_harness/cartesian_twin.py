"""The same flight, the other way: inertial Cartesian coordinates, adaptive DOP853, no shortcuts."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from tests.sim_harness.flights import EARTH_MU_M3PS2, EARTH_RADIUS_M


class Twin(NamedTuple):
    """Planet, exponential air and constant forces of a flight."""

    spin_radps: float
    j2: float
    lift_area_m2: float
    drag_area_m2: float
    mass_kg: float = 1000.0
    rho0_kgpm3: float = 1.225
    scale_height_m: float = 7200.0
    wind: Callable[[float], tuple[float, float]] = lambda _: (0.0, 0.0)
    """East and north, m/s, at an altitude in m."""

    def acceleration(self, place: Any, velocity: Any, bank_rad: float) -> Any:
        """Inertial acceleration, J2 as the Cartesian textbook form."""
        x, y, z = place
        r = math.sqrt(x * x + y * y + z * z)
        gravity = -EARTH_MU_M3PS2 / r**3 * place
        k = 1.5 * self.j2 * EARTH_MU_M3PS2 * EARTH_RADIUS_M**2 / r**5
        ratio = 5.0 * z * z / (r * r)
        oblate = k * np.array([x * (ratio - 1.0), y * (ratio - 1.0), z * (ratio - 3.0)])
        east = np.cross([0.0, 0.0, 1.0], place) / math.hypot(x, y)
        to_east, to_north = self.wind(r - EARTH_RADIUS_M)
        wind = to_east * east + to_north * np.cross(place / r, east)
        air = velocity - np.cross([0.0, 0.0, self.spin_radps], place) - wind
        v = np.linalg.norm(air)
        rho = self.rho0_kgpm3 * math.exp(-(r - EARTH_RADIUS_M) / self.scale_height_m)
        pressure = 0.5 * rho * v * v / self.mass_kg
        along = air / v
        forces = -pressure * self.drag_area_m2 * along
        if self.lift_area_m2 != 0.0:
            normal = place / r - np.dot(place / r, along) * along
            normal = normal / np.linalg.norm(normal)
            right = np.cross(along, normal)
            lift = pressure * self.lift_area_m2
            forces = forces + lift * (math.cos(bank_rad) * normal + math.sin(bank_rad) * right)
        return gravity + oblate + forces

    def fly(self, truth: Any, seconds: float, bank_rad: float) -> Any:
        """Place and velocity relative to the planet, in its axes, after so many seconds."""
        place, velocity = planet_fixed(truth)
        velocity = velocity + np.cross([0.0, 0.0, self.spin_radps], place)

        def slope(_: float, y: Any) -> Any:
            return np.concatenate([y[3:], self.acceleration(y[:3], y[3:], bank_rad)])

        start = np.concatenate([place, velocity])
        found = solve_ivp(slope, (0.0, seconds), start, "DOP853", rtol=1e-12, atol=1e-6)
        end = found.y[:, -1]
        velocity = end[3:] - np.cross([0.0, 0.0, self.spin_radps], end[:3])
        turned = self.spin_radps * seconds
        c, s = math.cos(turned), math.sin(turned)
        fixed_from_inertial = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return fixed_from_inertial @ end[:3], fixed_from_inertial @ velocity


def planet_fixed(truth: Any) -> Any:
    """Place and relative velocity of a TRUTH record in Cartesian axes of the planet."""
    lon, lat = truth["lon_rad"], truth["lat_rad"]
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    north = np.cross(up, east)
    fpa, heading = truth["flight_path_angle_rad"], truth["heading_rad"]
    along = math.cos(heading) * north + math.sin(heading) * east
    direction = math.cos(fpa) * along + math.sin(fpa) * up
    return (EARTH_RADIUS_M + truth["alt_m"]) * up, truth["v_rel_mps"] * direction
