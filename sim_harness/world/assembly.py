"""From a mission file to the records of the world: units turn to SI here and nowhere else."""

import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from flight_sw.errors import MissionError
from sim_harness.mission import documents
from sim_harness.mission.aero_keys import (
    ConstantAerodynamics,
    NewtonianAerodynamics,
    PolynomialAerodynamics,
)
from sim_harness.mission.keys import (
    Axis,
    ExponentialAtmosphere,
    Heating,
    TableAtmosphere,
    Us76Atmosphere,
)
from sim_harness.mission.mission import Mission
from sim_harness.world import atmosphere as atmospheres
from sim_harness.world import records, vehicle
from sim_harness.world.assembly_navigation import fill_navigation
from sim_harness.world.frames import Velocity, relative_from_inertial
from sim_harness.world.ground_track import fill_ground_track
from sim_harness.world.planet.gravity import jacobi_energy
from sim_harness.world.profiles import air_record

FULL_TURN_DEG = 360.0
CSV_COLUMNS = ("altitude_km", "density_kgpm3", "sound_speed_mps", "temperature_k")


def world_of(mission: Mission, seed: int = 0) -> np.ndarray:
    """The WORLD record of a mission's flight with a seed, shape (1,), read-only."""
    world = np.zeros(1, records.WORLD)
    world["dt_s"] = mission.dt_s
    planet = mission.planet
    world["planet"] = (
        planet.radius_km * 1e3,
        planet.mu_m3ps2,
        planet.rotation_radps,
        planet.j2,
        planet.g0_mps2,
    )
    fill_aerodynamics(world["aerodynamics"], mission)
    world["heating"] = heating_row(mission.heating)
    world["bank"] = actuator_row(mission.actuators.bank, mission.dt_s)
    world["alpha"] = actuator_row(mission.actuators.alpha, mission.dt_s)
    end = mission.end
    world["end"]["entry_alt_m"] = mission.entry.altitude_km * 1e3
    world["end"]["speed_mps"] = end.speed_mps
    world["end"]["alt_m"] = end.altitude_km * 1e3
    world["end"]["energy_jpkg"] = end.jacobi_energy_mjpkg * 1e6
    if end.at_target_energy == "yes":
        at_target = target_energy_jpkg(world["planet"][0], mission)
        world["end"]["energy_jpkg"] = max(end.jacobi_energy_mjpkg * 1e6, at_target)
    world["end"]["time_max_s"] = end.time_max_s
    if end.at_target == "yes":
        world["end"]["at_target"] = 1
        fill_ground_track(world["end"]["ground_track"][0], mission)
    fill_navigation(world["navigation"], mission)
    world["atmosphere"] = atmosphere_record(mission)
    world["air"] = air_record(mission, seed)
    world.setflags(write=False)
    return world


def target_energy_jpkg(planet: np.void, mission: Mission) -> float:
    """Jacobi's energy of the target's speed at the target."""
    target = mission.target
    assert target is not None  # the mission is refused without
    latitude_rad = math.radians(target.latitude_deg)
    radius_m = float(planet["radius_m"]) + target.altitude_km * 1e3
    sin_lat, cos_lat = math.sin(latitude_rad), math.cos(latitude_rad)
    return float(jacobi_energy(planet, radius_m, sin_lat, cos_lat, target.speed_mps))


def heating_row(heating: Heating | None) -> tuple[float, float, float]:
    """A HEATING record's values; a mission without heating has a flux of zero."""
    if heating is None:
        return 0.0, 0.5, 3.0
    return heating.factor_si, heating.density_exponent, heating.speed_exponent


def fill_aerodynamics(record: np.ndarray, mission: Mission) -> None:
    """Writes mass, area and the chosen model."""
    record["mass_kg"] = mission.vehicle.mass_kg
    record["area_m2"] = mission.vehicle.reference_area_m2
    record["side_lift_ratio"] = mission.vehicle.side_lift_ratio
    model = mission.vehicle.aerodynamics
    record["lift_ratio"], record["drag_ratio"] = model.lift_factor, model.drag_factor
    if isinstance(model, ConstantAerodynamics):
        record["model"] = records.AERO_CONSTANT
        record["lift_coefficient"] = model.lift_coefficient
        record["drag_coefficient"] = model.drag_coefficient
    elif isinstance(model, NewtonianAerodynamics):
        record["model"] = records.AERO_NEWTONIAN
        for key in ("n1", "n2", "a1", "a2"):
            record[key] = getattr(model, key)
    elif isinstance(model, PolynomialAerodynamics):
        record["model"] = records.AERO_POLYNOMIAL
        for key in ("lift_powers", "drag_powers"):
            record[key] = model.powers(key)
    else:
        record["model"] = records.AERO_TABLE
        rows, columns = len(model.angle_of_attack_deg), len(model.mach)
        record["n_alpha"], record["n_mach"] = rows, columns
        record["alpha_rad"][0, :rows] = np.radians(model.angle_of_attack_deg)
        record["mach"][0, :columns] = model.mach
        record["lift_table"][0, :rows, :columns] = model.lift_coefficient
        record["drag_table"][0, :rows, :columns] = model.drag_coefficient


def actuator_row(axis: Axis, dt_s: float) -> tuple[float, ...]:
    """An ACTUATOR record's values."""
    lag_gain = 1.0 if axis.lag_s == 0.0 else -math.expm1(-dt_s / axis.lag_s)
    return (
        lag_gain,
        math.radians(axis.rate_max_degps),
        math.radians(axis.accel_max_degps2),
        math.radians(axis.low_deg),
        math.radians(axis.high_deg),
        int(axis.high_deg - axis.low_deg >= FULL_TURN_DEG),
    )


us76_record = lru_cache(maxsize=1)(atmospheres.us_standard_1976)


def atmosphere_record(mission: Mission) -> np.ndarray:
    """The ATMOSPHERE record, checked to reach up to the entry altitude."""
    model = mission.atmosphere
    if isinstance(model, ExponentialAtmosphere):
        record = atmospheres.exponential(
            model.density_ref_kgpm3, model.scale_height_m, model.sound_speed_mps
        )
    elif isinstance(model, Us76Atmosphere):
        record = us76_record()
    else:
        record = table_record(model, mission.path)
    top_km = record["alt_m"][0, int(record["n"][0]) - 1] / 1e3
    if mission.entry.altitude_km > top_km:
        raise MissionError(
            f"{mission.path.name}: entry.altitude_km is {mission.entry.altitude_km}, "
            f"allowed up to the top of the atmosphere's table, {top_km:.12g} km"
        )
    return record


def table_record(model: TableAtmosphere, mission_path: Path) -> np.ndarray:
    """The record of a table in the mission file or in a CSV file beside it."""
    if model.csv is not None:
        name = model.csv
        columns = read_csv(mission_path.parent / name)
        try:
            model = TableAtmosphere(
                model="table",
                gas_constant_jpkgk=model.gas_constant_jpkgk,
                heat_capacity_ratio=model.heat_capacity_ratio,
                **columns,
            )
        except ValueError as error:
            raise MissionError(csv_sentence(name, error)) from None
    if model.sound_speed_mps is not None:
        sound = np.array(model.sound_speed_mps)
    else:
        gas = model.heat_capacity_ratio * model.gas_constant_jpkgk
        sound = np.sqrt(gas * np.array(model.temperature_k))
    return atmospheres.table(
        np.array(model.altitude_km) * 1e3, np.array(model.density_kgpm3), sound
    )


def csv_sentence(name: str, error: Any) -> str:
    """What is wrong with a CSV table, one sentence per error."""
    lines = []
    for found in error.errors():
        column = "".join(f"column {key} " for key in found["loc"])
        lines.append(f"{name}: {column}{found['msg']}")
    return "\n".join(lines)


def read_csv(path: Path) -> dict[str, Any]:
    """Columns by name."""
    rows = documents.read_csv(path)
    header = rows[0][1] if rows else []
    unknown = [name for name in header if name not in CSV_COLUMNS]
    if unknown or not header or len(set(header)) < len(header):
        told = documents.short(",".join(header))
        why = ", separated by semicolons" if any(";" in name for name in header) else ""
        why = why or (", a column twice" if header and not unknown else "")
        raise MissionError(
            f"{path.name}: header is {told}{why}, allowed columns {', '.join(CSV_COLUMNS)}"
        )
    columns: dict[str, list[float]] = {name: [] for name in header}
    for number, row in rows[1:]:
        if len(row) != len(header):
            raise MissionError(
                f"{path.name}: line {number} has {len(row)} values, allowed {len(header)}"
            )
        for name, text in zip(header, row, strict=True):
            try:
                columns[name].append(float(text))
            except ValueError:
                raise MissionError(
                    f"{path.name}: line {number}, {name} is {documents.quoted(text)}, "
                    "allowed a number"
                ) from None
    return columns


def truth_of(mission: Mission, seed: int = 0, world: np.ndarray | None = None) -> np.ndarray:
    """The TRUTH record at entry, shape (1,), with the derived fields filled.

    `world` is that of the seed, where it has been made before.
    """
    if world is None:
        world = world_of(mission, seed)
    entry = mission.entry
    velocity = Velocity(
        entry.speed_mps,
        math.radians(entry.flight_path_angle_deg),
        math.remainder(math.radians(entry.heading_deg), 2.0 * math.pi),
    )
    lat_rad = math.radians(entry.latitude_deg)
    if entry.frame == "inertial":
        radius_m = (mission.planet.radius_km + entry.altitude_km) * 1e3
        velocity = relative_from_inertial(
            velocity, radius_m, lat_rad, mission.planet.rotation_radps
        )
    truth = np.zeros(1, records.TRUTH)
    truth["lon_rad"] = math.radians(entry.longitude_deg)
    truth["lat_rad"] = lat_rad
    truth["alt_m"] = entry.altitude_km * 1e3
    truth["v_rel_mps"] = velocity.speed_mps
    truth["flight_path_angle_rad"] = velocity.flight_path_angle_rad
    truth["heading_rad"] = velocity.heading_rad
    truth["bank_rad"] = math.radians(entry.bank_deg)
    truth["alpha_rad"] = math.radians(entry.angle_of_attack_deg)
    vehicle.start(world[0], truth[0])
    return truth
