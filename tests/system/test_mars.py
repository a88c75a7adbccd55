"""The Mars lander closed loop: nominal, dispersed, noisy, over the bus; and another planet's."""

from pathlib import Path
from typing import Any

import pytest

from sim_harness.flight.bus_flight import fly_bus
from sim_harness.flight.flight import FlightPlan, FlightRun, fly_memory
from sim_harness.flight.summary import summary_of
from sim_harness.world.missions import load_mission
from tools.campaign.engine import results_of
from tools.campaign.plan import Wanted
from tools.gains.image import design_path, image_path, make_all, write
from tools.reproduce.yan_flights import (
    AS_PRINTED,
    DISPERSED,
    NOMINAL_GAINS,
    RANGE_TRIGGER,
    flown,
    missed_km,
    noisy,
    observer,
)

pytestmark = pytest.mark.jit_only

PRINTED = (*AS_PRINTED, *NOMINAL_GAINS, observer(0.481))
NOT_STILL = {
    "planet.rotation_radps": 7.0882e-5, "entry.latitude_deg": -20.0, "entry.heading_deg": 60.0,
    "target.longitude_deg": 11.0, "target.latitude_deg": -14.0, "target.altitude_km": 9.0,
    "entry.flight_path_angle_deg": -13.9, "vehicle.mass_kg": 1100.0, "end.altitude_km": 9.0,
}  # fmt: skip


@pytest.mark.parametrize("law", ["drag-state", "drag-observer"])
def test_the_nominal_flight_ends_within_five_metres_of_its_target(law: str) -> None:
    for settings in (PRINTED, ()):
        flight = flown(law, settings)
        assert flight["outcome"] == "end condition"
        assert abs(flight["downrange_error_km"]) < 0.005
        assert abs(flight["altitude_error_km"]) < 0.005
        assert abs(flight["speed_error_mps"]) < 0.5
        assert flight["frames_rejected"] == 0


def test_the_gap_between_the_laws_falls_with_the_observers_eps() -> None:
    state = missed_km("drag-state", PRINTED, DISPERSED)
    gaps = {
        eps: abs(missed_km("drag-observer", (*PRINTED, observer(eps)), DISPERSED) - state)
        for eps in (0.481, 0.05)
    }
    assert gaps[0.481] == pytest.approx(0.15, abs=0.03)
    assert gaps[0.05] / 0.05 == pytest.approx(gaps[0.481] / 0.481, rel=0.05)


def test_accelerometer_noise_neither_shakes_nor_shifts_the_shipped_law() -> None:
    unlimited = ("design.limits.bank.rate_max_degps=inf",)
    quiet = noisy("drag-observer", unlimited, 0.0, 1)
    loud = noisy("drag-observer", unlimited, 0.05, 4)
    assert loud.bank_step_rms_deg < 1.0
    assert abs(loud.downrange_error_km - quiet.downrange_error_km) < 0.3


@pytest.mark.parametrize("factor", [0.75, 1.12])
def test_range_control_ends_on_target_whatever_the_air(factor: float) -> None:
    air = {"atmosphere.density_ref_kgpm3": 0.0158 * factor}
    held = flown("range-predictor", (), air)
    tracked = flown("drag-observer", (), air)
    assert abs(held["downrange_error_km"]) < 0.15
    assert abs(held["downrange_error_km"]) < 0.1 * abs(tracked["downrange_error_km"])
    triggered = flown("range-predictor", RANGE_TRIGGER, air)
    assert triggered["end_trigger"] in ("target", "altitude and target", "altitude")
    assert abs(triggered["downrange_error_km"]) < 0.15


def test_an_average_profile_of_the_planet_moves_the_end_less_with_range_control() -> None:
    air = ("atmosphere.model=table", "atmosphere.csv=mars-gram-average.csv")
    held = flown("range-predictor", air)
    tracked = flown("drag-observer", air)
    assert 1.0 < abs(tracked["downrange_error_km"]) < 10.0
    assert abs(held["downrange_error_km"]) < 0.2 * abs(tracked["downrange_error_km"])


def plan(
    path: Path, bus: str, overrides: dict[str, float], mission: Any = "mars-lander"
) -> FlightRun:
    raw = path.read_bytes()
    flight = FlightPlan(load_mission(mission, overrides), path.stem, raw, path, bus, recorded=False)
    return FlightRun(flight, [])


def test_memory_and_bus_give_the_same_commands() -> None:
    path = image_path(load_mission("mars-lander").gains_folder, "range-predictor")
    runs = [plan(path, bus, DISPERSED) for bus in ("memory", "unix")]
    fly_memory(runs[0])
    assert fly_bus(runs[1]) == ""
    assert runs[0].command_sha256 == runs[1].command_sha256
    told = [summary_of(run) for run in runs]
    assert told[0]["downrange_error_km"] == told[1]["downrange_error_km"]


def test_a_turning_planet_and_another_target_give_a_reference_of_their_own(tmp_path: Path) -> None:
    folder = load_mission("mars-lander").gains_folder
    text = (load_mission("mars-lander").path).read_text()
    (tmp_path / "other.toml").write_text(
        text.replace("rate_hz = 50.0", 'rate_hz = 25.0\ngains = "."')
    )
    design = (folder / "design.toml").read_text().replace('"mars-lander"', '"other.toml"', 1)
    (tmp_path / "design.toml").write_text(design)
    for key, value in NOT_STILL.items():
        change(tmp_path / "other.toml", key, value)
    for made in make_all(design_path(str(tmp_path))):
        write(tmp_path, made)
    for law in ("drag-observer", "range-predictor"):
        run = plan(image_path(tmp_path, law), "memory", {}, tmp_path / "other.toml")
        fly_memory(run)
        summary = summary_of(run)
        assert summary["outcome"] == "end condition"
        assert abs(summary["downrange_error_km"]) < 0.1, law
        assert abs(summary["altitude_error_km"]) < 0.1, law


def change(path: Path, key: str, value: float) -> None:
    """Write a number over another in a mission file."""
    section, name = key.split(".")
    head, title, tail = path.read_text().partition(f"[{section}]")
    lines = tail.split("\n")
    at = next(i for i, line in enumerate(lines) if line.startswith(f"{name} = "))
    lines[at] = f"{name} = {value}"
    path.write_text(head + title + "\n".join(lines))


@pytest.mark.slow
def test_a_thousand_flights_spread_as_the_paper_says() -> None:
    table = results_of(Wanted("mars-lander", "table2", 1000, 1, "drag-observer", ()))
    downrange, altitude = (table[f"{n}_error_km"].to_numpy() for n in ("downrange", "altitude"))
    assert 0.5 < altitude.mean() < 0.9
    assert 0.7 < altitude.std() < 1.2
    assert 3.5 < altitude.max() < 4.8
    assert 5.0 < downrange.std() < 10.0
    assert ((downrange > -10.0) & (downrange < 20.0)).mean() >= 0.9


@pytest.mark.slow
def test_range_control_with_a_range_trigger_halves_the_spread() -> None:
    table = results_of(Wanted("mars-lander", "table2", 1000, 1, "range-predictor", RANGE_TRIGGER))
    assert table["downrange_error_km"].to_numpy().std() < 4.0
