"""Missions and compiled flights that the tests of the world share."""

import math
from typing import Any

import numpy as np

from sim_harness.jit import kernel
from sim_harness.mission.mission import Mission
from sim_harness.world import vehicle
from sim_harness.world.assembly import truth_of, world_of

EARTH_RADIUS_M = 6_378_137.0
EARTH_MU_M3PS2 = 3.986004418e14
EARTH_SPIN_RADPS = 7.292115e-5
EARTH_J2 = 1.08263e-3

TRACE = ("t_s", "alt_m", "v_rel_mps", "flight_path_angle_rad", "load_factor_g", "heat_flux_wpm2")


def plain_mission(**changes: Any) -> Mission:
    """A 1,000 kg vehicle with constant coefficients in an exponential atmosphere of a still Earth.

    Changes are dotted keys with `__` for the dot, or whole sections.
    """
    raw: dict[str, Any] = {
        "name": "plain",
        "title": "Test vehicle",
        "planet": {
            "radius_km": EARTH_RADIUS_M / 1e3,
            "mu_m3ps2": EARTH_MU_M3PS2,
            "rotation_radps": 0.0,
        },
        "atmosphere": {
            "model": "exponential",
            "density_ref_kgpm3": 1.225,
            "scale_height_m": 7200.0,
            "sound_speed_mps": 300.0,
        },
        "vehicle": {
            "mass_kg": 1000.0,
            "reference_area_m2": 1.0,
            "aerodynamics": {
                "model": "constant",
                "lift_coefficient": 0.0,
                "drag_coefficient": 0.0,
            },
        },
        "heating": {"coefficient": 1.7415e-4, "nose_radius_m": 1.0},
        "entry": {
            "altitude_km": 120.0,
            "longitude_deg": 10.0,
            "latitude_deg": 20.0,
            "speed_mps": 7500.0,
            "flight_path_angle_deg": -3.0,
            "heading_deg": 60.0,
        },
        "limits": {"heat_flux_max_kwpm2": 1e3, "load_factor_max_g": 10.0},
        "guidance": {"law": "nominal"},
    }
    for key, value in changes.items():
        *parents, leaf = key.split("__")
        table = raw
        for parent in parents:
            table = table.setdefault(parent, {})
        table[leaf] = value
    return Mission.model_validate(raw)


@kernel
def fly(world: Any, truth: Any, bank_cmd_rad: float, alpha_cmd_rad: float, frames: int) -> int:
    """Up to so many frames with commands held; the outcome."""
    w = world[0]
    s = truth[0]
    code = 0
    for _ in range(frames):
        vehicle.advance(w, s, bank_cmd_rad, alpha_cmd_rad)
        code = vehicle.ended(w, s)
        if code != 0:
            break
    return code


@kernel
def trace(
    world: Any, truth: Any, bank_cmd_rad: float, alpha_cmd_rad: float, low_m: float, out: Any
) -> int:
    """Rows of TRACE at every frame, until `out` is full or the altitude is below `low_m`."""
    w = world[0]
    s = truth[0]
    for i in range(out.shape[0]):
        out[i, 0] = s["t_s"]
        out[i, 1] = s["alt_m"]
        out[i, 2] = s["v_rel_mps"]
        out[i, 3] = s["flight_path_angle_rad"]
        out[i, 4] = s["load_factor_g"]
        out[i, 5] = s["heat_flux_wpm2"]
        if s["alt_m"] < low_m:
            return i
        vehicle.advance(w, s, bank_cmd_rad, alpha_cmd_rad)
    return out.shape[0]


def flown(mission: Mission, seconds: float, bank_deg: float = 0.0, alpha_deg: float = 0.0) -> Any:
    """The truth after so many seconds."""
    world, truth = world_of(mission), truth_of(mission)
    frames = round(seconds * mission.guidance.rate_hz)
    w, s = world, truth
    run(w, s, math.radians(bank_deg), math.radians(alpha_deg), frames)
    return truth[0]


@kernel
def run(world: Any, truth: Any, bank_cmd_rad: float, alpha_cmd_rad: float, frames: int) -> None:
    """So many frames with commands held, whatever happens."""
    for _ in range(frames):
        vehicle.advance(world[0], truth[0], bank_cmd_rad, alpha_cmd_rad)


def traced(
    mission: Mission, frames: int, bank_deg: float = 0.0, low_m: float = 0.0, flat: bool = False
) -> Any:
    """Columns of TRACE by name over a flight; a flat planet has no gravity either."""
    world, truth = world_of(mission), truth_of(mission)
    if flat:
        world = world.copy()
        world["planet"]["radius_m"] = 1e13
        world["planet"]["mu_m3ps2"] = 0.0
        world.setflags(write=False)
    out = np.zeros((frames, len(TRACE)))
    rows = trace(world, truth, math.radians(bank_deg), 0.0, low_m, out)
    return dict(zip(TRACE, out[:rows].T, strict=True))
