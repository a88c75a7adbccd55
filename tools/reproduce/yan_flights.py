"""Flights of the Mars lander as [YANHE] flies them, for its reproduction: single and a thousand."""

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from flight_sw.guidance.drag.bank_profile import BANK_PROFILE
from sim_harness.flight.profile_flight import fly_profile
from sim_harness.flight.terminal import state_at_end, terminal_errors
from sim_harness.mission.mission import Mission
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.missions import load_mission
from sim_harness.world.records import TRUTH
from tools.campaign.engine import results_of
from tools.campaign.job import Flyer, Run, job_of
from tools.campaign.plan import Wanted, plan_of
from tools.campaign.pool import processors

MISSION = "mars-lander"
SET = "table2"
SEED = 1

AS_PRINTED = (
    "design.drag.observes=error",
    "design.drag.takes=sensed",
    "design.drag.model=closed-loop",
    "design.drag.lift=model",
    "design.drag.authority_min_mps4=0",
    "design.limits.bank.rate_max_degps=inf",
)
"""The law as the paper states it, without what a product adds."""
NOMINAL_GAINS = ("design.drag.eps0_s=5", "design.drag.a=1.982", "design.drag.b=3")
MONTE_CARLO_GAINS = ("design.drag.eps0_s=20", "design.drag.a=20", "design.drag.b=5")
UNLIMITED = ("design.limits.bank.rate_max_degps=inf",)
RANGE_TRIGGER = (
    "end.at_target=yes",
    "end.speed_mps=300",
    "end.altitude_km=8",
    "design.range_predictor.end=altitude",
)
"""A parachute released by range, in a box that reaches down to 8 km and 300 m/s."""

DISPERSED = {
    "atmosphere.density_ref_kgpm3": 0.9 * 0.0158,
    "vehicle.aerodynamics.drag_coefficient": 0.95 * 62.0 / 115.0,  # C_D = m/(115 S)
    "vehicle.aerodynamics.lift_coefficient": 1.05 * 0.18 * 62.0 / 115.0,
    "vehicle.mass_kg": 1.02 * 992.0,
}
"""One flight with every dispersion of Table 2 in it, and never saturated."""


def observer(eps_s: float) -> str:
    """The setting of the observer's eps."""
    return f"design.drag_observer.eps_s={eps_s:g}"


class Noisy(NamedTuple):
    """The same flight with so many seeds of accelerometer noise."""

    bank_step_rms_deg: float
    downrange_error_km: float
    """Mean."""


def flown(
    law: str, settings: tuple[str, ...], overrides: dict[str, float] | None = None, seed: int = 0
) -> dict[str, Any]:
    """One flight in memory."""
    job, _ = job_of(MISSION, law, list(settings), None)
    return Flyer(job).fly(Run(1, overrides or {}, seed, {}))


def missed_km(
    law: str, settings: tuple[str, ...], overrides: dict[str, float] | None = None
) -> float:
    """Downrange error of one flight."""
    return float(flown(law, settings, overrides)["downrange_error_km"])


def noisy(law: str, settings: tuple[str, ...], noise_mps2: float, seeds: int) -> Noisy:
    """The dispersed flight under white accelerometer noise."""
    job, _ = job_of(MISSION, law, [*settings, f"navigation.accel_noise_mps2={noise_mps2:g}"], None)
    flyer = Flyer(job)
    with ThreadPoolExecutor(processors()) as pool:
        rows = list(pool.map(lambda s: flyer.fly(Run(s, DISPERSED, s, {})), range(1, seeds + 1)))
    steps = np.array([row["bank_step_rms_deg"] for row in rows])
    errors = np.array([row["downrange_error_km"] for row in rows])
    return Noisy(float(np.sqrt(np.mean(steps**2))), float(errors.mean()))


class Spread(NamedTuple):
    """A Monte Carlo study: errors at the end, one value a flight."""

    downrange_km: np.ndarray
    altitude_km: np.ndarray
    speed_mps: np.ndarray

    @property
    def inside(self) -> float:
        """Share of downrange errors between -10 and 20 km."""
        return float(np.mean((self.downrange_km > -10.0) & (self.downrange_km < 20.0)))


def monte_carlo(law: str, settings: tuple[str, ...], n: int) -> Spread:
    """Flights of the dispersion set; the samples are the same for every law and setting."""
    table = results_of(Wanted(MISSION, SET, n, SEED, law, settings))
    names = ("downrange_error_km", "altitude_error_km", "speed_error_mps")
    return Spread(*(np.array(table[name].to_pylist(), dtype=float) for name in names))


def _lift_up(mission: Mission) -> float:
    """Downrange error in km of a flight that holds full lift up from entry to end."""
    world, truth = world_of(mission), truth_of(mission)
    profile = np.zeros(1, BANK_PROFILE.dtype)
    profile["v_fast_mps"] = 1.0
    log = np.zeros(math.ceil(mission.end.time_max_s * mission.guidance.rate_hz) + 2, TRUTH)
    n, outcome = fly_profile(world, profile, truth, log)
    errors = terminal_errors(mission, state_at_end(world[0], log[n - 1], outcome))
    return float(errors.downrange_error_km or 0.0)


def unreachable_km(n: int) -> np.ndarray:
    """What full lift up throughout still leaves missing to the target, sample by sample."""
    plan = plan_of(Wanted(MISSION, SET, n, SEED, None, ()))
    shipped = load_mission(MISSION)
    flyer = Flyer(plan.job)
    short = [
        _lift_up(flyer.mission(plan.run(number).overrides, shipped.name))
        for number in range(1, n + 1)
    ]
    return np.maximum(np.array(short), 0.0)
