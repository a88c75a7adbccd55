"""Somebody else's capsule at another planet, from two files of their own: nothing of it is ours.

A slender lander, exponential air of Mars, 25 Hz, guidance every other frame, commands limited in
rate and acceleration, actuators with a lag. Its flight is judged by what its own files say.
"""

from pathlib import Path

import numpy as np
import pytest

from sim_harness.flight.bus_flight import fly_bus
from sim_harness.flight.flight import FlightPlan, FlightRun, fly_memory
from sim_harness.flight.summary import summary_of
from sim_harness.telemetry.logs import COMMANDS
from sim_harness.world.missions import load_mission
from tests.system.flights import Built, Computer, World
from tools.gains.image import design_path, make_all, write

pytestmark = pytest.mark.jit_only

MISSION = """
name = "red-kite"
title = "A lifting capsule at Mars"

[planet]
radius_km = 3389.5
mu_m3ps2 = 4.2828e13
rotation_radps = 7.088e-5
g0_mps2 = 9.80665

[atmosphere]
model = "exponential"
density_ref_kgpm3 = 0.0158
scale_height_m = 9354.0
sound_speed_mps = 220.0

[vehicle]
mass_kg = 2800.0
reference_area_m2 = 12.0

[vehicle.aerodynamics]
model = "table"
angle_of_attack_deg = [0.0, 10.0, 20.0]
mach = [2.0, 10.0, 30.0]
lift_coefficient = [[0.0, 0.0, 0.0], [0.6, 0.62, 0.64], [1.0, 1.02, 1.05]]
drag_coefficient = [[0.4, 0.45, 0.5], [0.5, 0.55, 0.6], [0.9, 1.0, 1.05]]

[heating]
coefficient = 1.9027e-4
nose_radius_m = 0.66

[entry]
altitude_km = 100.0
longitude_deg = 175.0
latitude_deg = -12.0
speed_mps = 5400.0
flight_path_angle_deg = -10.5
heading_deg = 75.0
angle_of_attack_deg = 20.0

[limits]
heat_flux_max_kwpm2 = 470.0
load_factor_max_g = 8.0

[end]
speed_mps = 600.0
altitude_km = 5.0
time_max_s = 1500.0

[actuators.bank]
lag_s = 0.1
rate_max_degps = 20.0
accel_max_degps2 = 20.0
low_deg = -180.0
high_deg = 180.0

[actuators.alpha]
lag_s = 0.1
rate_max_degps = 5.0
accel_max_degps2 = 5.0
low_deg = 0.0
high_deg = 20.0

[guidance]
law = "lqy"
rate_hz = 25.0
gains = "."
"""

DESIGN = """
mission = "red-kite.toml"
laws = ["nominal", "lqy"]

[timing]
guidance_divider = 2

[modes]
entry_load_g = 0.01
terminal_speed_mps = 700.0
coast_alpha_deg = 20.0

[limits.bank]
low_deg = 0.0
high_deg = 150.0
rate_max_degps = 15.0
accel_max_degps2 = 10.0

[limits.alpha]
low_deg = 0.0
high_deg = 20.0
rate_max_degps = 4.0

[nominal]
alpha_before_peak_deg = 20.0
alpha_after_peak_deg = 12.0
scale_height_m = 9354.0
k_gamma_p_mps2prad = 4.2
k_gamma_i_mps3prad = 0.5
k_gamma_d_mpsprad = 0.0
k_flow_p_rad = -1.0
k_flow_d_heat_flux_rads = -0.8
k_flow_d_load_rads = -0.5
transition_start_ratio = 0.5
transition_duration_s = 10.0
release_exponent = 5.0

[lqy]
heat_flux_error_max_kwpm2 = 5.0
load_error_max_g = 0.25
bank_error_max_deg = 15.0
lead_s = 8.0
band_ratio = 0.2
decay_s = 5.0
speeds_mps = [2000, 3000, 4000, 5000]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both files, and the load images that were made from them."""
    folder = tmp_path_factory.mktemp("red-kite")
    (folder / "red-kite.toml").write_text(MISSION)
    (folder / "design.toml").write_text(DESIGN)
    for made in make_all(design_path(str(folder))):
        write(folder, made)
    return folder


def run_of(folder: Path, law: str, bus: str) -> FlightRun:
    """A flight of the capsule."""
    path = folder / f"{law}.load"
    mission = load_mission(folder / "red-kite.toml")
    return FlightRun(FlightPlan(mission, law, path.read_bytes(), path, bus, recorded=False), [])


def test_it_flies_closed_loop_to_its_own_end(folder: Path) -> None:
    errors = {}
    for law in ("nominal", "lqy"):
        run = run_of(folder, law, "memory")
        fly_memory(run)
        summary = summary_of(run)
        assert summary["outcome"] == "end condition"
        assert summary["mission"] == "red-kite"
        assert summary["frames_rejected"] == 0
        assert summary["without_fix_s"] == 0.0
        assert summary["minor_frames"] == round(summary["flight_time_s"] * 25.0)
        assert 470.0 < summary["heat_flux_max_kwpm2"] < 1.06 * 470.0
        assert summary["tracking_time_s"] > 60.0
        errors[law] = summary["heat_flux_error_mjpm2"]
    assert errors["lqy"] < errors["nominal"]


def test_memory_and_bus_give_the_same_commands(folder: Path) -> None:
    memory, over_bus = run_of(folder, "lqy", "memory"), run_of(folder, "lqy", "unix")
    fly_memory(memory)
    assert fly_bus(over_bus) == ""
    assert over_bus.command_sha256 == memory.command_sha256
    assert over_bus.harness["truth"]["heat_load_jpm2"] == memory.harness["truth"]["heat_load_jpm2"]


def test_commands_keep_the_designs_limits_and_the_vehicle_the_missions(folder: Path) -> None:
    run = run_of(folder, "lqy", "memory")
    made = Built(run.plan.mission, "lqy", run.plan.load_image, run.image, run.load)
    world = World(made, 8000)
    assert world.fly(Computer(made), 8000) == 1
    truth, dt_s = world.truth, 0.04
    sent = world.logs.commands[: int(world.harness["written"][0, COMMANDS])]["data"]
    bank_deg = np.degrees((sent >> np.uint64(12) & np.uint64((1 << 26) - 1)) * 1e-7)
    assert bank_deg.max() <= 150.0 + 1e-5
    steps = np.diff(bank_deg[:-1])
    assert np.abs(steps).max() <= 15.0 * dt_s + 2e-5  # resolution of the bus
    assert np.abs(steps).max() > 14.0 * dt_s  # the limit was used
    assert np.abs(np.diff(steps)).max() <= 10.0 * dt_s**2 + 4e-5
    assert np.degrees(np.abs(truth["bank_rate_radps"])).max() <= 20.0 + 1e-9
    alpha_deg = np.degrees(truth["alpha_rad"])
    assert alpha_deg[0] == pytest.approx(20.0)
    assert alpha_deg[-1] == pytest.approx(12.0, abs=0.01)
    assert np.abs(np.diff(alpha_deg)).max() <= 5.0 * dt_s + 1e-9
