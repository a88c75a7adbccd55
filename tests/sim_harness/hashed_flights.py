"""Prints the bytes of short flights: run compiled and uncompiled, the lines must be the same."""

import math
import sys

import numpy as np

from flight_sw.icd import N_VALUES
from sim_harness.world import vehicle
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.navigation import NAV_STATE, measure
from tests.sim_harness.flights import plain_mission
from tests.sim_harness.test_aerodynamics import ALPHAS, DRAG, LIFT, MACHS

FRAMES = 150

TABLE = {
    "model": "table",
    "angle_of_attack_deg": ALPHAS,
    "mach": MACHS,
    "lift_coefficient": LIFT,
    "drag_coefficient": DRAG,
}
NEWTONIAN = {"model": "newtonian", "n1": 0.8, "n2": 1.6, "a1": 0.08, "a2": 0.9}
SLOW_AXIS = {"lag_s": 0.3, "rate_max_degps": 20.0, "accel_max_degps2": 40.0}

MISSIONS = {
    "ideal, J2, Newtonian": {
        "planet__j2": 1e-3,
        "planet__rotation_radps": 7e-5,
        "vehicle__aerodynamics": NEWTONIAN,
        "atmosphere": {"model": "us76"},
    },
    "slow axes, table, other heating": {
        "vehicle__aerodynamics": TABLE,
        "atmosphere": {"model": "us76"},
        "heating__speed_exponent": 3.15,
        "heating__density_exponent": 0.45,
        "actuators__bank": SLOW_AXIS,
        "actuators__alpha": SLOW_AXIS,
    },
    "wind, random air, factors": {
        "vehicle__aerodynamics": {**TABLE, "lift_factor": 1.1, "drag_factor": 0.95},
        "atmosphere": {
            "model": "us76",
            "density_factor": 1.1,
            "density_sigma_top_ratio": 0.2,
        },
        "wind": {"east_mps": 30.0, "sigma_ground_mps": 10.0, "sigma_top_mps": 50.0},
    },
}
NAVIGATION = {
    "position_noise_m": 20.0,
    "speed_noise_mps": 0.3,
    "state_correlation_s": 3.0,
    "accel_noise_mps2": 0.05,
    "accel_lag_s": 0.1,
    "attitude_noise_deg": 0.1,
    "heat_flux_noise_kwpm2": 5.0,
    "heat_flux_scale_factor": 1.01,
    "latency_s": 0.06,
    "dropout_ratio": 0.1,
    "dropout_of": "message",
}


def flight_bytes(changes: dict) -> str:
    """The final record of a flight with moving commands, in hexadecimal."""
    mission = plain_mission(entry__altitude_km=60.0, entry__angle_of_attack_deg=30.0, **changes)
    world, truth = world_of(mission)[0], truth_of(mission)[0]
    for i in range(FRAMES):
        bank_cmd_rad = 3.0 * math.sin(0.1 * i)
        vehicle.advance(world, truth, bank_cmd_rad, 0.5 + 0.002 * i)
    return truth.tobytes().hex()


def report_bytes() -> str:
    """What navigation with errors reports along a flight, in hexadecimal."""
    errors = {f"navigation__{key}": value for key, value in NAVIGATION.items()}
    mission = plain_mission(entry__altitude_km=60.0, **errors)
    world, truth = world_of(mission)[0], truth_of(mission)[0]
    nav_state, values = np.zeros(1, NAV_STATE), np.zeros(N_VALUES)
    nav_state["seed"] = 20261125
    rows = b""
    for _ in range(FRAMES):
        measure(world, truth, nav_state[0], values)
        rows += values.tobytes()
        vehicle.advance(world, truth, 0.3, 0.0)
    return (rows + nav_state.tobytes()).hex()


if __name__ == "__main__":
    for changes in MISSIONS.values():
        sys.stdout.write(flight_bytes(changes) + "\n")
    sys.stdout.write(report_bytes() + "\n")
