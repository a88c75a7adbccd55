"""The vehicle between two frames: actuators, motion, and what a sensor would see at the end.

An ideal axis flies its command over the whole frame. Any other moves linearly within the frame, and
the forces take the angle of mid-frame, which keeps the step second order in the attitude.
"""

import math

from flight_sw.model.angles import wrapped
from flight_sw.model.atmosphere import sound_speed
from flight_sw.model.great_circle import range_flown
from flight_sw.records.types_ import Record
from sim_harness.jit import kernel
from sim_harness.world.actuators import follow, is_ideal
from sim_harness.world.aerodynamics import follows_mach, true_areas
from sim_harness.world.air import aero_accelerations, airspeed, true_density
from sim_harness.world.heating import heat_flux
from sim_harness.world.motion import step
from sim_harness.world.planet.gravity import haversine_m, jacobi_energy
from sim_harness.world.records import (
    END_CONDITION,
    FLYING,
    GROUND,
    NUMERICAL,
    SKIPPED_OUT,
    TIME_OUT,
)


@kernel
def hold(world: Record, truth: Record, bank_rad: float, alpha_rad: float) -> None:
    """Fixes the attitude the forces are computed with; areas only follow a changed alpha."""
    held = truth["held"]
    held["cos_bank"] = math.cos(bank_rad)
    held["sin_bank"] = world["aerodynamics"]["side_lift_ratio"] * math.sin(bank_rad)
    if alpha_rad != held["alpha_rad"]:
        hold_areas(world, held, alpha_rad)


@kernel
def hold_areas(world: Record, held: Record, alpha_rad: float) -> None:
    """Fixes the angle of attack and, for models without Mach number, the areas that go with it."""
    aero = world["aerodynamics"]
    held["alpha_rad"] = alpha_rad
    if not follows_mach(aero):
        held["lift_area_m2"], held["drag_area_m2"] = true_areas(aero, alpha_rad, 0.0)


@kernel
def turn(world: Record, truth: Record, bank_cmd_rad: float, alpha_cmd_rad: float) -> None:
    """Moves both axes by a frame and holds the attitude of its middle."""
    dt = world["dt_s"]
    bank = truth["bank_rad"]
    alpha = truth["alpha_rad"]
    bank_to, bank_rate = follow(world["bank"], bank, truth["bank_rate_radps"], bank_cmd_rad, dt)
    alpha_to, alpha_rate = follow(
        world["alpha"], alpha, truth["alpha_rate_radps"], alpha_cmd_rad, dt
    )
    bank_flown = bank_to
    alpha_flown = alpha_to
    if not is_ideal(world["bank"]):
        bank_flown = bank + 0.5 * wrapped(bank_to - bank)
    if not is_ideal(world["alpha"]):
        alpha_flown = alpha + 0.5 * wrapped(alpha_to - alpha)
    hold(world, truth, bank_flown, alpha_flown)
    truth["bank_rad"] = bank_to
    truth["bank_rate_radps"] = bank_rate
    truth["alpha_rad"] = alpha_to
    truth["alpha_rate_radps"] = alpha_rate


@kernel
def outputs(world: Record, truth: Record) -> None:
    """Fills what follows from the state: forces, air data, loads, energies and their peaks."""
    planet = world["planet"]
    alt = truth["alt_m"]
    v = truth["v_rel_mps"]
    radius = planet["radius_m"] + alt
    rho = true_density(world, alt)
    v_air = airspeed(world, alt, v, truth["flight_path_angle_rad"], truth["heading_rad"])
    lift, drag = aero_accelerations(world, truth["held"], alt, v_air, rho)
    flux = heat_flux(world["heating"], rho, v_air)
    load_factor = math.sqrt(lift * lift + drag * drag) / planet["g0_mps2"]
    pressure = 0.5 * rho * v_air * v_air
    s_lat = math.sin(truth["lat_rad"])
    c_lat = math.cos(truth["lat_rad"])
    truth["v_air_mps"] = v_air
    truth["lift_mps2"] = lift
    truth["drag_mps2"] = drag
    truth["rho_kgpm3"] = rho
    truth["mach"] = v_air / sound_speed(world["atmosphere"], alt)
    truth["dynamic_pressure_pa"] = pressure
    truth["heat_flux_wpm2"] = flux
    truth["load_factor_g"] = load_factor
    truth["energy_jpkg"] = 0.5 * v * v + planet["mu_m3ps2"] * alt / (planet["radius_m"] * radius)
    truth["jacobi_energy_jpkg"] = jacobi_energy(planet, radius, s_lat, c_lat, v)
    truth["heat_flux_max_wpm2"] = max(truth["heat_flux_max_wpm2"], flux)
    truth["load_factor_max_g"] = max(truth["load_factor_max_g"], load_factor)
    truth["dynamic_pressure_max_pa"] = max(truth["dynamic_pressure_max_pa"], pressure)


@kernel
def advance(world: Record, truth: Record, bank_cmd_rad: float, alpha_cmd_rad: float) -> None:
    """One minor frame: actuators, motion with heat load, ground range, outputs."""
    lon = truth["lon_rad"]
    lat = truth["lat_rad"]
    turn(world, truth, bank_cmd_rad, alpha_cmd_rad)
    step(world, truth)
    truth["ground_range_m"] += haversine_m(
        world["planet"]["radius_m"], lon, lat, truth["lon_rad"], truth["lat_rad"]
    )
    truth["minor_frames"] += 1
    truth["t_s"] = truth["minor_frames"] * world["dt_s"]
    if truth["alpha_rad"] != truth["held"]["alpha_rad"]:
        hold_areas(world, truth["held"], truth["alpha_rad"])
    outputs(world, truth)


@kernel
def start(world: Record, truth: Record) -> None:
    """Fills the derived fields of an initial state."""
    hold_areas(world, truth["held"], truth["alpha_rad"])
    hold(world, truth, truth["bank_rad"], truth["alpha_rad"])
    outputs(world, truth)


@kernel
def is_slow(world: Record, truth: Record) -> bool:
    """At or below the end speed."""
    return truth["v_rel_mps"] <= world["end"]["speed_mps"]


@kernel
def is_low(world: Record, truth: Record) -> bool:
    """At or below the end altitude."""
    return truth["alt_m"] <= world["end"]["alt_m"]


@kernel
def is_there(world: Record, truth: Record) -> bool:
    """At or beyond the target's range, where the flight ends there."""
    end = world["end"]
    if end["at_target"] == 0:
        return False
    radius_m = world["planet"]["radius_m"]
    flown_m = range_flown(end["ground_track"], radius_m, truth["lon_rad"], truth["lat_rad"])
    return flown_m >= end["ground_track"]["target_m"]


@kernel
def is_spent(world: Record, truth: Record) -> bool:
    """At or below the end's energy."""
    return truth["jacobi_energy_jpkg"] <= world["end"]["energy_jpkg"]


@kernel
def has_met_end(world: Record, truth: Record) -> bool:
    """Whether any part of the end condition is met."""
    if is_slow(world, truth) or is_low(world, truth):
        return True
    return is_there(world, truth) or is_spent(world, truth)


@kernel
def ended(world: Record, truth: Record) -> int:
    """Outcome so far, records.FLYING while the flight goes on."""
    end = world["end"]
    alt = truth["alt_m"]
    v = truth["v_rel_mps"]
    direction = truth["flight_path_angle_rad"] + truth["heading_rad"]
    place = truth["lon_rad"] + truth["lat_rad"] + alt
    heat = truth["heat_flux_wpm2"] + truth["heat_load_jpm2"]
    if not math.isfinite(place + v + direction + heat) or v < 0.0:
        return NUMERICAL
    if has_met_end(world, truth):
        return END_CONDITION
    if alt <= 0.0:
        return GROUND
    if alt > end["entry_alt_m"] and truth["flight_path_angle_rad"] > 0.0:
        return SKIPPED_OUT
    if truth["t_s"] >= end["time_max_s"]:
        return TIME_OUT
    return FLYING
