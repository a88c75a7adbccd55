"""Load bodies in exponential air, and random states of a law, for the tests of the laws."""

import functools
from typing import Any

import numpy as np

from flight_sw.guidance import law_module, law_step
from flight_sw.records.dictionary import GUIDANCE, NAV
from sim_harness.world import atmosphere
from tests.flight_sw.guidance.heat_flux.guidance_twin import (
    AIR_SCALE_M,
    MASS_KG,
    RHO0_KGPM3,
    Values,
    areas_m2,
    density,
    values_of,
)
from tests.system.flights import built

HEAT_FLUX_MAX_WPM2 = 1.7e6
ROUND_OFF = {"heat_flux_error_wpm2": 1e-6}  # a difference of two fluxes


@functools.cache
def _body(law: str) -> Any:
    body = built(law).image.body.copy()
    body["atmosphere"] = atmosphere.exponential(RHO0_KGPM3, AIR_SCALE_M, 300.0)
    return body


def body_of(law: str) -> Any:
    """The load body of a law, shape (1,), one's own to change."""
    return _body(law).copy()


class Case:
    """One law with its records: what a step reads and writes."""

    def __init__(self, law: str) -> None:
        self.body = body_of(law)
        self.state = np.zeros(1, law_module(law).STATE.dtype)
        self.nav = np.zeros(1, NAV)
        self.out = np.zeros(1, GUIDANCE)

    @property
    def design(self) -> Any:
        """The nominal guidance's design."""
        law = self.body[0]["law"]
        return law["nominal"] if "nominal" in (law.dtype.names or ()) else law

    @property
    def memory(self) -> Any:
        """The nominal guidance's state."""
        state = self.state[0]
        return state["nominal"] if "nominal" in (state.dtype.names or ()) else state

    def step(self, **nav: float) -> int:
        """One guidance step at a fix with these fields changed."""
        for name, value in nav.items():
            self.nav[name] = value
        return int(law_step(self.body[0], self.state[0], self.nav[0], self.out[0]))

    def start_tracking(self, phase: int = 2) -> None:
        """A memory that tracks the present rho V^6, at rest in everything else."""
        nav, memory = self.nav[0], self.memory
        memory["phase"] = phase
        memory["heat_flux_peak_wpm2"] = HEAT_FLUX_MAX_WPM2
        memory["tracking_constant"] = density(float(nav["alt_m"])) * float(nav["v_rel_mps"]) ** 6


def altitude_of_load(load_g: float, v_mps: float) -> float:
    """Altitude in the twin's air where the load factor at 20 deg is this."""
    force = float(np.hypot(*areas_m2(np.radians(20.0))))
    rho = 2.0 * load_g * 9.81 * MASS_KG / (force * v_mps**2)
    return AIR_SCALE_M * float(np.log(RHO0_KGPM3 / rho))


def random_nav(rng: np.random.Generator) -> Values:
    """A fix anywhere along an entry, its load factor from 0.05 to 6 g."""
    v_mps = rng.uniform(2400.0, 7800.0)
    return {
        "lat_rad": rng.uniform(-1.4, 1.4),
        "heading_rad": rng.uniform(-3.1, 3.1),
        "v_rel_mps": v_mps,
        "alt_m": altitude_of_load(float(np.exp(rng.uniform(np.log(0.05), np.log(6.0)))), v_mps),
        "flight_path_angle_rad": rng.normal(-0.01, 0.01),
        "heat_flux_wpm2": HEAT_FLUX_MAX_WPM2 * rng.uniform(0.85, 1.15),
    }


def random_memory(rng: np.random.Generator, memory: Any, nav: Values, n: float) -> None:
    """A memory that such a fix could meet, in any phase; n of the heat-flux limit."""
    v_mps = nav["v_rel_mps"]
    memory["phase"] = rng.integers(0, 4)
    memory["falling"] = rng.integers(0, 2)
    memory["heat_flux_prev_wpm2"] = nav["heat_flux_wpm2"] * rng.choice([0.999, 1.0, 1.001])
    memory["heat_flux_peak_wpm2"] = HEAT_FLUX_MAX_WPM2 * rng.uniform(0.9, 1.2)
    memory["heat_flux_slow_peak_wpm2"] = memory["heat_flux_peak_wpm2"] * rng.uniform(0.95, 1.0)
    memory["heat_flux_slow_wpm2"] = memory["heat_flux_slow_peak_wpm2"] * rng.uniform(0.96, 1.0)
    memory["tracking_constant"] = density(nav["alt_m"]) * v_mps**n * np.exp(rng.normal(0.0, 0.1))
    memory["gamma_integral_rads"] = rng.normal(0.0, 0.1)
    memory["gamma_error_prev_rad"] = rng.normal(0.0, 1e-3)
    memory["gamma_started"] = rng.integers(0, 2)
    memory["transition_time_s"] = rng.uniform(0.0, 20.0)
    memory["released"] = rng.integers(0, 2)
    memory["released_s"] = rng.uniform(0.0, 12.0) * memory["released"]


def random_beliefs(rng: np.random.Generator, design: Any, memory: Any, nav: Values) -> None:
    """What the source lacks: a loop with its own gains, a held integral, forces learnt and felt."""
    design["k_gamma_p_1ps"], design["k_gamma_i_1ps2"] = rng.uniform(0.0, 0.1), 2.5e-3
    design["peak_drop_wpm2"] = rng.choice([0.0, 0.0, 0.1]) * HEAT_FLUX_MAX_WPM2
    design["peak_floor_ratio"] = rng.choice([0.0, 0.5, 1.0])
    design["peak_by"] = rng.integers(0, 2)
    design["peak_scale_exponent"] = rng.uniform(1.0, 2.0)
    design["adaptation_share_ratio"] = rng.choice([0.0, 0.3, 1.0])
    design["adaptation_load_min_g"] = rng.choice([0.05, 0.5])
    design["adaptation_max_ratio"] = rng.choice([0.1, 0.5])
    memory["gamma_held"] = rng.integers(0, 2)
    memory["drag_excess_ratio"], memory["lift_excess_ratio"] = rng.uniform(-0.3, 0.3, 2)
    angle = "alpha_before_peak_rad" if memory["phase"] == 0 else "alpha_after_peak_rad"
    nav["alpha_rad"] = float(design[angle]) + rng.choice([0.0, 0.009, 0.011])
    pressure = density(nav["alt_m"]) * nav["v_rel_mps"] ** 2 / 2 / MASS_KG
    drag_m2, lift_m2 = areas_m2(float(design[angle]))
    nav["drag_mps2"] = pressure * drag_m2 * rng.uniform(0.7, 1.3)
    nav["lift_mps2"] = pressure * lift_m2 * rng.uniform(0.7, 1.3)


def differences(record: Any, twin: Values, path: str = "") -> dict[str, tuple[float, float]]:
    """Numbers of a record that are not those of the twin, to round-off."""
    found = {}
    for name, value in values_of(record).items():
        if name == "forces":
            continue  # the twin keeps none
        if isinstance(value, dict):
            found.update(differences(record[name], twin[name], f"{path}{name}."))
        elif not np.isclose(value, twin[name], rtol=1e-10, atol=ROUND_OFF.get(name, 1e-11)):
            found[path + name] = (value, twin[name])
    return found
