"""Flights on a navigation with errors: the same bits everywhere, and what the computer does."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim_harness.flight.bus_flight import fly_bus
from sim_harness.flight.flight import FlightRun, fly_memory
from sim_harness.world.missions import load_mission
from tests.system.flights import MISSION, PIECES, Built, built, run_of

NOISY = {
    "navigation.position_noise_m": 15.0,
    "navigation.altitude_noise_m": 15.0,
    "navigation.speed_noise_mps": 0.3,
    "navigation.path_angle_noise_deg": 0.02,
    "navigation.state_correlation_s": 5.0,
    "navigation.accel_noise_mps2": 0.05,
    "navigation.accel_lag_s": 0.1,
    "navigation.attitude_noise_deg": 0.1,
    "navigation.heat_flux_noise_kwpm2": 5.0,
    "navigation.dropout_ratio": 0.02,
    "navigation.dropout_s": 0.1,
}
LATE = {"navigation.latency_s": 0.06}


def flown(
    tmp_path: Path, bus: str = "memory", seed: int = 7, changes: dict[str, Any] = NOISY
) -> FlightRun:
    """20 s on the heat-flux limit with errors of navigation."""
    plain = built("lqy", "tracking")
    mission = load_mission(
        MISSION,
        {**PIECES["tracking"], "heat_flux_max_kwpm2": 1700.0, "end.time_max_s": 20.0, **changes},
    )
    made = Built(mission, plain.law, plain.raw, plain.image, plain.load)
    run = run_of(made, tmp_path / "lqy.load", bus, seed=seed, recorded=False)
    if bus == "memory":
        fly_memory(run)
    else:
        assert fly_bus(run) == ""
    return run


@pytest.fixture(scope="module")
def noisy(tmp_path_factory: pytest.TempPathFactory) -> FlightRun:
    return flown(tmp_path_factory.mktemp("noisy"))


@pytest.mark.jit_only
def test_a_noisy_flight_is_the_same_over_a_bus(noisy: FlightRun, tmp_path: Path) -> None:
    late = flown(tmp_path, changes={**NOISY, **LATE})
    over_bus = flown(tmp_path, "unix", changes={**NOISY, **LATE})
    assert over_bus.command_sha256 == late.command_sha256 != noisy.command_sha256
    for part in ("truth", "navigation", "metrics"):
        assert over_bus.harness[part].tobytes() == late.harness[part].tobytes()


@pytest.mark.jit_only
def test_the_seed_changes_the_flight_and_nothing_else_does(
    noisy: FlightRun, tmp_path: Path
) -> None:
    assert flown(tmp_path).command_sha256 == noisy.command_sha256
    assert flown(tmp_path, seed=8).command_sha256 != noisy.command_sha256


@pytest.mark.jit_only
def test_without_errors_the_seed_changes_nothing(tmp_path: Path) -> None:
    first, second = (flown(tmp_path, seed=seed, changes={}) for seed in (1, 2))
    assert first.command_sha256 == second.command_sha256


@pytest.mark.jit_only
def test_sensible_errors_pass_the_gates(noisy: FlightRun) -> None:
    refused = {k: n for k, n in noisy.computer["verdicts"].items() if n and k not in ("OK", "LOST")}
    assert refused == {}
    assert int(noisy.harness["port"]["tx_refused"][0]) == 0


@pytest.mark.jit_only
def test_every_set_that_was_withheld_is_counted_and_its_command_held(noisy: FlightRun) -> None:
    state = noisy.harness["navigation"][0]
    dropped = int(state["dropouts"])
    assert dropped > 20
    assert noisy.computer["incomplete_sets"] == dropped
    assert noisy.harness["metrics"]["without_fix_s"][0] == pytest.approx(dropped * 0.02)
    assert noisy.outcome_text == "time out"


@pytest.mark.jit_only
def test_one_message_missing_is_a_set_missing(tmp_path: Path) -> None:
    run = flown(tmp_path, changes={"dropout_ratio": 0.05, "dropout_of": "message"})
    dropped = int(run.harness["navigation"]["dropouts"][0])
    assert dropped > 20
    assert run.computer["incomplete_sets"] == dropped
    assert run.computer["verdicts"]["LOST"] > 0


@pytest.mark.jit_only
def test_a_long_drop_out_leads_to_safe_and_back(tmp_path: Path) -> None:
    run = flown(tmp_path, seed=3, changes={"dropout_ratio": 0.003, "dropout_s": 1.0})
    assert int(run.harness["navigation"]["dropouts"][0]) >= 50
    assert int(run.harness["port"]["mode"][0]) == 2  # ENTRY again, after SAFE
    assert run.outcome_text == "time out"
    assert np.isfinite(run.harness["truth"]["v_rel_mps"][0])
