"""Prints the bytes of short flights: run compiled and uncompiled, the lines must be the same."""

import math
import sys

from sim_harness import vehicle
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
}


def flight_bytes(changes: dict) -> str:
    """The final record of a flight with moving commands, in hexadecimal."""
    mission = plain_mission(entry__altitude_km=60.0, entry__angle_of_attack_deg=30.0, **changes)
    world, truth = mission.world()[0], mission.truth()[0]
    for i in range(FRAMES):
        bank_cmd_rad = 3.0 * math.sin(0.1 * i)
        vehicle.advance(world, truth, bank_cmd_rad, 0.5 + 0.002 * i)
    return truth.tobytes().hex()


if __name__ == "__main__":
    for changes in MISSIONS.values():
        sys.stdout.write(flight_bytes(changes) + "\n")
