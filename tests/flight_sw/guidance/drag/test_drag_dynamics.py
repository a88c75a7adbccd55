"""Rate and second derivative of the drag: against the paper's form, and against flights."""

import math
from typing import Any

import numpy as np
import pytest

from flight_sw.guidance.drag.dynamics import DYNAMICS, drag_dynamics, jacobi_energy
from flight_sw.model.onboard import PLANET
from flight_sw.records.dictionary import NAV
from sim_harness.world import atmosphere, vehicle
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.missions import load_mission
from tests.flight_sw.mars_cases import MU, RADIUS_M, RHO0, SCALE_M

AIR = atmosphere.exponential(RHO0, SCALE_M, 220.0)
RATE_HZ = 1000.0
SIGNS = [-1.0, 1.0]


def planet(spin_radps: float = 0.0) -> Any:
    record = np.zeros(1, PLANET.dtype)
    record["radius_m"], record["mu_m3ps2"], record["rotation_radps"] = RADIUS_M, MU, spin_radps
    return record


def dynamics(nav: Any, drag: float, lift: float, air: Any = AIR, spin_radps: float = 0.0) -> Any:
    out = np.zeros(1, DYNAMICS.dtype)
    drag_dynamics(planet(spin_radps)[0], air[0], nav, drag, lift, out[0])
    return out[0]


def printed_f(v: float, g: float, d: float, gamma: float, r: float, sign: float) -> float:
    """[YANHE] f below Eq. 10 with C = 0; `sign` of its v^2 cos^2/(r hs) term."""
    s, c, h = math.sin(gamma), math.cos(gamma), SCALE_M
    first = (-v * s / h - 4 * d / v - 2 * g * s / v) * (
        -v * s / h * d - 2 * d**2 / v - 2 * g * s / v * d
    )
    rest = (d * s + g) / h + (4 * g * s**2 - 2 * g * c**2) / r
    rest -= (2 * d**2 + 4 * d * g * s + 2 * g**2 * s**2 - 2 * g**2 * c**2) / v**2
    return first + d * (rest + sign * v**2 * c**2 / (r * h))


@pytest.mark.parametrize("seed", range(20))
def test_f_and_g0_are_the_papers_with_one_sign_corrected(seed: int) -> None:
    rng = np.random.default_rng(seed)
    nav = np.zeros(1, NAV)
    v, alt = rng.uniform(400.0, 7000.0), rng.uniform(5e3, 60e3)
    gamma, d, lift = rng.uniform(-0.5, 0.3), rng.uniform(1.0, 130.0), rng.uniform(-20.0, 20.0)
    nav["v_rel_mps"], nav["alt_m"], nav["flight_path_angle_rad"] = v, alt, gamma
    nav["heading_rad"] = rng.uniform(-3.0, 3.0)
    r = RADIUS_M + alt
    g = MU / r**2
    got = dynamics(nav[0], d, lift)
    scale = d * (d / v + v / SCALE_M) ** 2
    assert got["free_mps4"] == pytest.approx(printed_f(v, g, d, gamma, r, -1.0), abs=1e-12 * scale)
    assert abs(got["free_mps4"] - printed_f(v, g, d, gamma, r, 1.0)) > 1e-6 * scale
    g0 = -(v / SCALE_M + 2 * g / v) * lift * d * math.cos(gamma) / v
    assert got["authority_mps4"] == pytest.approx(g0, rel=1e-10)
    log_rate = -v * math.sin(gamma) / SCALE_M - 2 * d / v - 2 * g * math.sin(gamma) / v
    assert got["log_rate_1ps"] == pytest.approx(log_rate, rel=1e-10, abs=1e-14)


FLIGHTS: dict[str, dict[str, Any]] = {
    "at rest": {},
    "turning": {
        "planet.rotation_radps": 7.0882e-5, "entry.latitude_deg": 30.0, "entry.heading_deg": 50.0
    },
    "westward": {"planet.rotation_radps": 7.0882e-5, "entry.heading_deg": -90.0},
}  # fmt: skip


@pytest.fixture(scope="module", params=FLIGHTS)
def flight(request: pytest.FixtureRequest) -> Any:
    """Truth at three consecutive frames of 1 ms, at places along a flight with constant bank."""
    overrides = {"guidance.rate_hz": RATE_HZ, **FLIGHTS[request.param]}
    mission = load_mission("mars-lander", overrides)
    world, truth, bank = world_of(mission)[0], truth_of(mission), math.radians(52.0)
    spin = mission.planet.rotation_radps
    places, kept = [], []
    for speed_mps in (6700.0, 6000.0, 4500.0, 2500.0, 900.0):
        while truth["v_rel_mps"][0] > speed_mps or truth["t_s"][0] < 20.0:
            kept = [*kept[-2:], truth.copy()]
            vehicle.advance(world, truth[0], bank, 0.0)
        places.append(kept)
    return spin, bank, world_of(mission)["atmosphere"], places


def nav_of(frame: Any) -> Any:
    nav = np.zeros(1, NAV)
    for name in NAV.names or ():
        nav[name] = frame[name]
    return nav[0]


@pytest.mark.jit_only
def test_rates_are_those_of_a_flight(flight: Any) -> None:
    spin, bank, air, places = flight
    for before, here, after in places:
        drag, lift = float(here["drag_mps2"][0]), float(here["lift_mps2"][0])
        got = dynamics(nav_of(here), drag, lift, air, spin)
        step = 1.0 / RATE_HZ
        down, up = float(before["drag_mps2"][0]), float(after["drag_mps2"][0])
        rate = drag * float(got["log_rate_1ps"])
        assert rate == pytest.approx((up - down) / (2.0 * step), abs=1e-6)
        accel = float(got["free_mps4"] + got["authority_mps4"] * math.cos(bank))
        # 1 ms of 8-byte numbers leaves 1e-7; a turning planet's northward part is not modelled
        allowed = 1e-6 if spin == 0.0 else 1e-5
        assert accel == pytest.approx((up - 2.0 * drag + down) / step**2, abs=allowed)


@pytest.mark.jit_only
def test_energy_falls_by_speed_times_drag(flight: Any) -> None:
    spin, _, _, places = flight
    for before, here, after in places:
        lost = [
            jacobi_energy(planet(spin)[0], float(f["alt_m"][0]), float(f["lat_rad"][0]),
                          float(f["v_rel_mps"][0]))
            for f in (before, after)
        ]  # fmt: skip
        power = float(here["v_rel_mps"][0] * here["drag_mps2"][0])
        assert (lost[0] - lost[1]) * RATE_HZ / 2.0 == pytest.approx(power, rel=1e-5, abs=0.05)


def test_slopes_of_the_density_are_those_of_its_table() -> None:
    air = world_of(load_mission("hyperion-1"))["atmosphere"][0]
    from flight_sw.model.atmosphere import density, log_density_slopes

    for alt_m in (3e3, 11_500.0, 30e3, 71_200.0, 95e3):
        first, second = log_density_slopes(air, alt_m)
        logs = [math.log(density(air, alt_m + d)) for d in (-1.0, 0.0, 1.0)]
        assert first == pytest.approx(0.5 * (logs[2] - logs[0]), rel=1e-6)
        assert second == pytest.approx(logs[2] - 2.0 * logs[1] + logs[0], abs=1e-12)
