"""Flights ahead: order through kinks, landing on breaks, sensitivities against differences.

Air is exponential: kinks of tabulated air inside a step would spoil the order, not the method.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from flight_sw.model.motion import (
    GAMMA,
    LAMBDA,
    MOTION,
    N_STATES,
    PHI,
    PSI,
    RADIUS,
    V,
    motion_rates,
)
from flight_sw.model.profile import BY_ENERGY, BY_TIME, PROFILE, index_of, merge_breaks
from flight_sw.model.propagation import (
    CONDITIONS,
    ENDED,
    FAILED,
    GOING,
    PATH,
    WORK,
    advance,
    begin,
)
from flight_sw.model.sphere import offset
from flight_sw.runtime.jit import kernel
from tests.flight_sw.test_motion import TURNING, Believed
from tests.sim_harness.flights import plain_mission

pytestmark = pytest.mark.jit_only

ORBITER = {  # Betts' coefficients, mass and area
    "mass_kg": 92079.0,
    "reference_area_m2": 249.9,
    "aerodynamics": {
        "model": "polynomial",
        "lift_powers": [[-0.20704], [0.029244]],
        "drag_powers": [[0.07854], [-0.0061592], [0.000621408]],
    },
}
BANK_KNOTS = [0.05, 0.10, 0.5, 1.2, 2.4, 3.8, 5.2, 6.56]
BANK_DEG = [0.0, 82.0, 80.0, 70.0, 5.0, -45.0, -50.0, 0.0]
ALPHA_KNOTS, ALPHA_DEG = [0.0, 3.5, 5.8], [42.0, 42.0, 28.0]
END_ALT_M = 25e3
STEPS_MAX = 20_000


@kernel
def fly_on(onboard: Any, air: Any, profile: Any, conditions: Any, flight: Any, most: int) -> int:
    """Up to so many steps."""
    path, work = flight
    code = GOING
    for _ in range(most):
        code = advance(onboard[0], air[0], profile[0], conditions[0], path[0], work[0])
        if code != GOING:
            break
    return code


class Ahead:
    """An orbiter's entry along a profile over energy, or the same knots over time."""

    def __init__(self, index_by: int = BY_ENERGY, heat_flux_limit_wpm2: float = 4e5) -> None:
        self.believed = Believed(plain_mission(**TURNING, vehicle=ORBITER))
        self.profile = np.zeros(1, PROFILE)
        profile = self.profile[0]
        profile["index_by"], profile["time_unit_s"] = index_by, 230.0
        profile["energy_ref_jpkg"], profile["index_speed_mps"] = -62.40e6, 7760.0
        profile["index_unit_mps"] = 1000.0
        profile["n_bank"], profile["n_alpha"] = len(BANK_KNOTS), len(ALPHA_KNOTS)
        profile["bank_index"][: len(BANK_KNOTS)] = BANK_KNOTS
        profile["bank_rad"][: len(BANK_DEG)] = np.radians(BANK_DEG)
        profile["alpha_index"][: len(ALPHA_KNOTS)] = ALPHA_KNOTS
        profile["alpha_rad"][: len(ALPHA_DEG)] = np.radians(ALPHA_DEG)
        merge_breaks(profile)
        self.conditions = np.zeros(1, CONDITIONS)
        self.conditions["end_alt_m"] = END_ALT_M
        self.conditions["heat_flux_limit_wpm2"] = heat_flux_limit_wpm2
        self.conditions["heat_flux_unit_wpm2"] = 1e4
        self.start = np.array([
            7600.0, math.radians(-2.1), math.radians(100.0), self.believed.radius_m + 120e3,
            math.radians(2.0), 0.1,
        ])  # fmt: skip

    def begun(self) -> tuple[np.ndarray, np.ndarray]:
        path, work = np.zeros(1, PATH), np.zeros(1, WORK)
        begin(path[0], self.profile[0], self.believed.onboard["planet"][0], self.start, 0.0)
        return path, work

    def go(self, flight: tuple[np.ndarray, np.ndarray], most: int = STEPS_MAX) -> int:
        return int(
            fly_on(self.believed.onboard, self.believed.atmosphere, self.profile,
                   self.conditions, flight, most)
        )  # fmt: skip

    def flown(self, step_s: float, sensed: bool = False) -> np.void:
        self.conditions["step_s"], self.conditions["has_sensitivities"] = step_s, sensed
        flight = self.begun()
        assert self.go(flight) == ENDED
        return flight[0][0]


def ends(ahead: Ahead, steps_s: tuple[float, ...]) -> list[np.ndarray]:
    return [np.append(p["x"], p["excess"]) for p in (ahead.flown(s) for s in steps_s)]


@pytest.mark.parametrize("index_by", [BY_ENERGY, BY_TIME])
def test_the_error_falls_with_the_fourth_power_of_the_step_through_kinks_of_the_bank(
    index_by: int,
) -> None:
    exact, *others = ends(Ahead(index_by), (0.125, 4.0, 2.0, 1.0))
    for at in (V, GAMMA, PSI, PHI):
        coarse, middle, fine = (abs(float(found[at] - exact[at])) for found in others)
        assert 10.0 < coarse / middle < 24.0
        assert 10.0 < middle / fine < 24.0


def test_the_path_stands_on_every_break_and_on_the_end() -> None:
    ahead = Ahead()
    ahead.conditions["step_s"] = 4.0
    path, _ = flight = ahead.begun()
    planet, met = ahead.believed.onboard["planet"][0], []
    breaks = list(ahead.profile["breaks"][0, : ahead.profile["n_breaks"][0]])
    assert breaks == sorted({*BANK_KNOTS, *ALPHA_KNOTS})
    before = int(path["next_break"][0])
    for _ in range(STEPS_MAX):
        code = ahead.go(flight, 1)
        if int(path["next_break"][0]) > before:
            before = int(path["next_break"][0])
            index = index_of(ahead.profile[0], planet, path["x"][0], float(path["t_s"][0]))
            met.append(index - breaks[before - 1])
        if code != GOING:
            break
    assert code == ENDED
    assert len(met) >= len(breaks) - 2  # the first lies before the entry, the last below the end
    assert np.abs(met).max() < 1e-12
    assert path["x"][0, RADIUS] - planet["radius_m"] == pytest.approx(END_ALT_M, abs=1e-6)


@pytest.mark.parametrize("index_by", [BY_ENERGY, BY_TIME])
def test_sensitivities_are_those_of_central_differences(index_by: int) -> None:
    ahead, step_s, moved_rad = Ahead(index_by), 0.5, 1e-3
    path = ahead.flown(step_s, sensed=True).copy()
    rates = np.zeros(1, MOTION)
    last = ahead.profile["alpha_rad"][0, len(ALPHA_DEG) - 1]
    motion_rates(
        ahead.believed.onboard[0], ahead.believed.atmosphere[0], path["x"], last, 0.0, rates[0]
    )
    n = len(BANK_KNOTS)
    by_knot, rate = path["by_knot"][:, :n], rates["rate"][0]
    at_end = by_knot - np.outer(rate, by_knot[RADIUS] / rate[RADIUS])  # at the altitude's time
    differences = np.zeros((N_STATES + 1, n))
    for k in range(n):
        sides = {}
        for times in (1.0, -1.0, 2.0, -2.0):
            ahead.profile["bank_rad"][0, k] += times * moved_rad
            sides[times] = ends(ahead, (step_s,))[0]
            ahead.profile["bank_rad"][0, k] -= times * moved_rad
        near, far = sides[1.0] - sides[-1.0], sides[2.0] - sides[-2.0]
        differences[:, k] = (8.0 * near - far) / (12.0 * moved_rad)
    states = [V, PSI, PHI, N_STATES - 1]  # the path angle hangs on the last bank, which is not 0
    scale = np.abs(differences).max(axis=1)
    assert (scale[states] > 0.0).all()
    apart = np.abs(at_end - differences[:N_STATES]).max(axis=1)[states] / scale[states]
    assert apart.max() < 1e-6
    excess = path["excess_by_knot"][:n]
    assert path["excess"] > 0.0
    assert np.abs(excess - differences[N_STATES]).max() / scale[N_STATES] < 1e-4  # a kink


@pytest.mark.parametrize("most", [1, 7, 1000])
def test_how_many_steps_are_made_at_a_time_makes_no_difference(most: int) -> None:
    ahead = Ahead()
    whole = ahead.flown(2.0, sensed=True)
    flight, code = ahead.begun(), GOING
    while code == GOING:
        code = ahead.go(flight, most)
    assert flight[0][0].tobytes() == whole.tobytes()


@pytest.mark.parametrize(
    "spoil",
    [
        lambda path: path["x"].__setitem__((0, V), math.nan),
        lambda path: path["x"].__setitem__((0, RADIUS), 0.0),
        lambda path: path["x"].__setitem__((0, V), -1.0),
    ],
)
def test_a_path_that_cannot_go_on_fails_and_stays(spoil: Callable[[Any], None]) -> None:
    ahead = Ahead()
    ahead.conditions["step_s"] = 2.0
    path, _ = flight = ahead.begun()
    spoil(path)
    before = path.tobytes()
    assert ahead.go(flight, 5) == FAILED
    assert path.tobytes() == before


def over(ahead: Ahead, latitude_deg: float, heading_deg: float) -> np.void:
    """A flight without the planet's turning or flattening, flown from there."""
    ahead.believed.onboard["planet"]["rotation_radps"] = 0.0
    ahead.believed.onboard["planet"]["j2"] = 0.0
    ahead.start[[PSI, PHI]] = math.radians(heading_deg), math.radians(latitude_deg)
    return ahead.flown(1.0, sensed=True)


@pytest.mark.parametrize("latitude_deg", [60.0, -70.0, 85.0, 89.9])
@pytest.mark.parametrize("off_deg", [0.0, 1e-6, 0.5, 8.0])
def test_over_a_pole_a_flight_is_that_along_the_equator(
    latitude_deg: float, off_deg: float
) -> None:
    """On a ball that stands still the poles are places like others."""
    heading_deg = off_deg if latitude_deg > 0.0 else 180.0 - off_deg
    usual, polar = over(Ahead(), 0.0, 90.0), over(Ahead(), latitude_deg, heading_deg)
    alike = [V, GAMMA, RADIUS]
    assert polar["x"][alike] == pytest.approx(usual["x"][alike], rel=1e-6)
    assert polar["t_s"] == pytest.approx(usual["t_s"], rel=1e-6)
    flown_rad = [
        math.hypot(*offset(p["x"][PHI], p["x"][LAMBDA], math.radians(lat), 0.1))
        for p, lat in ((usual, 0.0), (polar, latitude_deg))
    ]
    assert flown_rad[1] == pytest.approx(flown_rad[0], abs=2e-6)  # some 13 m
    moved = polar["by_knot"][:, : len(BANK_KNOTS)], usual["by_knot"][:, : len(BANK_KNOTS)]
    for at in alike:
        most = np.abs(moved[1][at]).max()
        assert moved[0][at] == pytest.approx(moved[1][at], abs=1e-5 * most)
