"""The onboard motion against a twin in complex numbers, the world's motion and a vector twin.

The twin is written from [JOSHI] Eqs. 1-7 and the potential of J2, in plain functions that take
complex numbers: a complex step gives partial derivatives without a difference's round-off.
"""

import cmath
import math
from typing import Any

import numpy as np
import pytest

from flight_sw.model import motion
from flight_sw.model.motion import MOTION, jacobi_energy, motion_partials, motion_rates
from flight_sw.model.onboard import ONBOARD
from sim_harness.mission.mission import Mission
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.motion import step as world_step
from sim_harness.world.vehicle import hold
from tests.sim_harness.cartesian_twin import Twin, planet_fixed
from tests.sim_harness.flights import EARTH_J2, EARTH_SPIN_RADPS, plain_mission
from tools.gains.body import fill_onboard

SMALL = 1e-30
TURNING = {"planet__rotation_radps": EARTH_SPIN_RADPS, "planet__j2": EARTH_J2}
POLYNOMIAL = {
    "model": "polynomial",
    "lift_powers": [[-0.2, 0.01], [0.029, -1e-4, 2e-6]],
    "drag_powers": [[0.08, 1e-3], [-0.006], [0.0006, 0.0, 1e-7], [1e-7]],
}
TABLE = {
    "model": "table",
    "angle_of_attack_deg": [0.0, 10.0, 25.0, 45.0],
    "mach": [3.0, 10.0, 22.0],
    "lift_coefficient": [[0.0, 0.1, 0.1], [0.3, 0.25, 0.2], [0.8, 0.7, 0.65], [1.1, 1.0, 0.9]],
    "drag_coefficient": [[0.1, 0.09, 0.1], [0.2, 0.15, 0.14], [0.5, 0.4, 0.45], [1.2, 1.0, 1.1]],
}
SPINNING_BACK = {**TURNING, "planet__rotation_radps": -2e-4}
MISSIONS = {
    "polynomial": {**TURNING, "vehicle__aerodynamics": POLYNOMIAL},
    "table": {**TURNING, "vehicle__aerodynamics": TABLE},
    "retrograde": {**SPINNING_BACK, "vehicle__aerodynamics": POLYNOMIAL},
    "oblate": {**TURNING, "planet__j2": 0.05, "vehicle__aerodynamics": POLYNOMIAL},
}
STATES = [  # speed, path angle, heading, altitude, latitude, longitude; angle of attack, bank; deg
    (7400.0, -1.3, 95.0, 75e3, 12.0, 40.0, 38.0, 62.0),
    (3100.0, -6.0, -20.0, 42e3, -55.0, -170.0, 20.0, -75.0),
    (950.0, 12.0, 181.0, 26e3, 78.0, 2.0, 7.0, 130.0),
]


class Believed:
    """A mission as the onboard model has it."""

    def __init__(self, mission: Mission) -> None:
        world = world_of(mission)
        self.mission = mission
        self.onboard = np.zeros(1, ONBOARD.dtype)
        fill_onboard(self.onboard[0], world[0])
        self.atmosphere = world["atmosphere"]
        self.motion = np.zeros(1, MOTION)
        self.radius_m = float(world["planet"]["radius_m"][0])

    def state(self, row: tuple[float, ...]) -> tuple[np.ndarray, float, float]:
        """State of shape (6,), angle of attack and bank in rad of a row of STATES."""
        v, gamma, psi, alt, lat, lon, alpha, bank = row
        angles = np.radians([gamma, psi, lat, lon, alpha, bank])
        x = np.array([v, angles[0], angles[1], self.radius_m + alt, angles[2], angles[3]])
        return x, float(angles[4]), float(angles[5])


class ComplexTwin:
    """Rates by [JOSHI] Eqs. 1-7, of complex numbers."""

    def __init__(self, mission: Mission) -> None:
        self.mission, self.planet = mission, mission.planet

    def coefficient(self, key: str, alpha: complex, mach: complex) -> complex:
        aero = self.mission.vehicle.aerodynamics
        degrees = alpha * 180.0 / math.pi
        if aero.model == "polynomial":
            rows = getattr(aero, f"{key}_powers")
            return sum(
                value * degrees**i * mach**j
                for i, row in enumerate(rows)
                for j, value in enumerate(row)
            )
        table = np.array(getattr(aero, f"{key}_coefficient"))
        alphas, machs = np.array(aero.angle_of_attack_deg), np.array(aero.mach)
        i = int(np.clip(np.searchsorted(alphas, degrees.real, "right") - 1, 0, alphas.size - 2))
        j = int(np.clip(np.searchsorted(machs, mach.real, "right") - 1, 0, machs.size - 2))
        u = (degrees - alphas[i]) / (alphas[i + 1] - alphas[i])
        w = (mach - machs[j]) / (machs[j + 1] - machs[j])
        if mach.real < machs[0] or mach.real > machs[-1]:
            w = complex(0.0 if mach.real < machs[0] else 1.0)
        low = table[i, j] * (1 - w) + table[i, j + 1] * w
        high = table[i + 1, j] * (1 - w) + table[i + 1, j + 1] * w
        return low * (1 - u) + high * u

    def energy(self, x: Any) -> complex:
        """V^2/2, the potential of J2, and that of the rotation."""
        planet, (v, _, _, r, phi, _) = self.planet, x
        ratio = planet.radius_km * 1e3 / r
        bulge = 1.5 * cmath.sin(phi) ** 2 - 0.5
        potential = planet.mu_m3ps2 / r * (1 - planet.j2 * ratio**2 * bulge)
        return v**2 / 2 - potential - (planet.rotation_radps * r * cmath.cos(phi)) ** 2 / 2

    def drag(self, x: Any, alpha: complex) -> complex:
        air, vehicle = self.mission.atmosphere, self.mission.vehicle
        rho = air.density_ref_kgpm3 * cmath.exp(
            -(x[motion.RADIUS] - self.planet.radius_km * 1e3) / air.scale_height_m
        )
        mach = x[motion.V] / air.sound_speed_mps
        area = self.coefficient("drag", alpha, mach) * vehicle.reference_area_m2
        return 0.5 * rho * x[motion.V] ** 2 * area / vehicle.mass_kg

    def rates(self, x: Any, alpha: complex, bank: complex) -> np.ndarray:
        planet, vehicle = self.planet, self.mission.vehicle
        v, gamma, psi, r, phi, _ = x
        re, mu, spin, j2 = (
            planet.radius_km * 1e3, planet.mu_m3ps2, planet.rotation_radps, planet.j2,
        )  # fmt: skip
        air = self.mission.atmosphere
        rho = air.density_ref_kgpm3 * cmath.exp(-(r - re) / air.scale_height_m)
        mach = v / air.sound_speed_mps
        pressure = 0.5 * rho * v**2 * vehicle.reference_area_m2 / vehicle.mass_kg
        lift = pressure * self.coefficient("lift", alpha, mach)
        drag = pressure * self.coefficient("drag", alpha, mach)
        s, c, t = cmath.sin, cmath.cos, cmath.tan
        down = mu / r**2 * (1 - 1.5 * j2 * (re / r) ** 2 * (3 * s(phi) ** 2 - 1))
        south = 3 * mu / r**2 * j2 * (re / r) ** 2 * s(phi) * c(phi)
        rate_v = (
            -drag - down * s(gamma) - south * c(gamma) * c(psi)
            + r * spin**2 * c(phi) * (s(gamma) * c(phi) - c(gamma) * c(psi) * s(phi))
        )  # fmt: skip
        rate_gamma = (
            lift * c(bank) / v
            + (-down * c(gamma) + south * s(gamma) * c(psi) + v**2 / r * c(gamma)) / v
            + 2 * spin * s(psi) * c(phi)
            + r * spin**2 * c(phi) / v * (s(gamma) * c(psi) * s(phi) + c(gamma) * c(phi))
        )
        rate_psi = (
            lift * s(bank) / (v * c(gamma))
            + south * s(psi) / (v * c(gamma))
            + v / r * c(gamma) * s(psi) * t(phi)
            + 2 * spin * (s(phi) - t(gamma) * c(psi) * c(phi))
            + r * spin**2 / (v * c(gamma)) * c(phi) * s(psi) * s(phi)
        )
        return np.array([
            rate_v, rate_gamma, rate_psi, v * s(gamma), v * c(gamma) * c(psi) / r,
            v * c(gamma) * s(psi) / (r * c(phi)),
        ])  # fmt: skip


@pytest.mark.parametrize("row", STATES)
@pytest.mark.parametrize("name", MISSIONS)
def test_rates_and_partial_derivatives_are_those_of_the_complex_twin(
    name: str, row: tuple[float, ...]
) -> None:
    believed = Believed(plain_mission(**MISSIONS[name]))
    x, alpha, bank = believed.state(row)
    found = believed.motion[0]
    motion_partials(believed.onboard[0], believed.atmosphere[0], x, alpha, bank, found)
    twin = ComplexTwin(believed.mission)
    assert found["rate"] == pytest.approx(twin.rates(x, alpha, bank).real, rel=1e-12, abs=1e-15)
    for j in range(motion.N_STATES):
        moved = x.astype(complex)
        moved[j] += SMALL * 1j
        expected = twin.rates(moved, alpha, bank).imag / SMALL
        assert found["by_state"][:, j] == pytest.approx(expected, rel=1e-9, abs=1e-16), j
    for j, (d_alpha, d_bank) in enumerate(((SMALL * 1j, 0.0), (0.0, SMALL * 1j))):
        expected = twin.rates(x.astype(complex), alpha + d_alpha, bank + d_bank).imag / SMALL
        assert found["by_control"][:, j] == pytest.approx(expected, rel=1e-9, abs=1e-16), j


@pytest.mark.parametrize("name", ["polynomial", "retrograde", "oblate"])
def test_the_jacobi_energy_is_that_of_the_potential_and_is_lost_by_drag_alone(name: str) -> None:
    believed = Believed(plain_mission(**MISSIONS[name]))
    twin = ComplexTwin(believed.mission)
    for row in STATES:
        x, alpha, bank = believed.state(row)
        found = jacobi_energy(believed.onboard["planet"][0], x)
        assert found == pytest.approx(twin.energy(x).real, rel=1e-14)
        rate = twin.rates(x, alpha, bank).real
        lost = twin.energy(x + SMALL * 1j * rate).imag / SMALL
        drag = twin.drag(x, alpha).real
        assert lost == pytest.approx(-x[motion.V] * drag, rel=1e-12, abs=1e-9 * x[motion.V])


def rk4(believed: Believed, x: np.ndarray, alpha: float, bank: float, step_s: float) -> np.ndarray:
    """A step of the onboard motion with held controls."""

    def rate(at: np.ndarray) -> np.ndarray:
        motion_rates(
            believed.onboard[0], believed.atmosphere[0], at, alpha, bank, believed.motion[0]
        )
        return np.array(believed.motion["rate"][0])

    a = rate(x)
    b = rate(x + 0.5 * step_s * a)
    c = rate(x + 0.5 * step_s * b)
    d = rate(x + step_s * c)
    return x + step_s / 6.0 * (a + 2.0 * (b + c) + d)


@pytest.mark.parametrize("name", MISSIONS)
def test_a_step_is_that_of_the_world(name: str) -> None:
    mission = plain_mission(**MISSIONS[name])
    believed, world = Believed(mission), world_of(mission)
    for row in STATES:
        x, alpha, bank = believed.state(row)
        truth = truth_of(mission)
        for field, value in (
            ("v_rel_mps", x[0]), ("flight_path_angle_rad", x[1]), ("heading_rad", x[2]),
            ("alt_m", x[3] - believed.radius_m), ("lat_rad", x[4]), ("lon_rad", x[5]),
            ("alpha_rad", alpha), ("bank_rad", bank),
        ):  # fmt: skip
            truth[field] = value
        hold(world[0], truth[0], bank, alpha)
        world_step(world[0], truth[0])
        flown = rk4(believed, x, alpha, bank, mission.dt_s)
        told = [float(truth[n][0]) for n in ("v_rel_mps", "flight_path_angle_rad")]
        assert flown[:2] == pytest.approx(told, rel=1e-10)
        assert math.remainder(flown[2] - float(truth["heading_rad"][0]), 2 * math.pi) == (
            pytest.approx(0.0, abs=1e-10)
        )
        place = [believed.radius_m + float(truth["alt_m"][0])]
        place += [float(truth[n][0]) for n in ("lat_rad", "lon_rad")]
        assert flown[3:] == pytest.approx(place, rel=1e-10)


@pytest.mark.jit_only
def test_a_flight_is_that_of_the_vector_twin() -> None:
    lift, drag, bank = 2.0, 2.5, math.radians(50.0)
    constant = {"model": "constant", "lift_coefficient": lift, "drag_coefficient": drag}
    believed = Believed(plain_mission(**TURNING, vehicle__aerodynamics=constant))
    truth = truth_of(believed.mission)[0]
    x = np.array([
        truth["v_rel_mps"], truth["flight_path_angle_rad"], truth["heading_rad"],
        believed.radius_m + truth["alt_m"], truth["lat_rad"], truth["lon_rad"],
    ])  # fmt: skip
    seconds, step_s = 160.0, 0.05
    for _ in range(round(seconds / step_s)):
        x = rk4(believed, x, 0.0, bank, step_s)
    end = truth.copy()
    end["v_rel_mps"], end["flight_path_angle_rad"], end["heading_rad"] = x[:3]
    end["alt_m"], end["lat_rad"], end["lon_rad"] = x[3] - believed.radius_m, x[4], x[5]
    place, velocity = planet_fixed(end)
    twin = Twin(EARTH_SPIN_RADPS, EARTH_J2, lift, drag).fly(truth, seconds, bank)
    assert np.linalg.norm(place - twin[0]) < 1e-2
    assert np.linalg.norm(velocity - twin[1]) < 1e-4


def test_at_a_pole_in_vertical_flight_and_at_rest_the_rates_are_finite() -> None:
    believed = Believed(plain_mission(**MISSIONS["polynomial"]))
    x, alpha, bank = believed.state(STATES[0])
    for index, value in (
        (motion.PHI, math.pi / 2), (motion.GAMMA, -math.pi / 2), (motion.V, 0.0),
    ):  # fmt: skip
        at = x.copy()
        at[index] = value
        motion_rates(
            believed.onboard[0], believed.atmosphere[0], at, alpha, bank, believed.motion[0]
        )
        assert np.isfinite(believed.motion["rate"][0]).all()
