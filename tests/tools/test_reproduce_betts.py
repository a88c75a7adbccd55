"""[BETTS10]'s maximum crossrange with the computer's motion: published numbers, slopes."""

import functools
import json
import math
from typing import Any

import numpy as np
import pytest

from flight_sw.model.motion import GAMMA, MOTION, PHI, RADIUS, V, motion_rates
from flight_sw.model.propagation import ENDED
from tools.cli import main
from tools.reproduce.crossrange import (
    BANK_DEG,
    BANK_INTERVALS,
    END_ALT_M,
    Found,
    Search,
    fly_legs,
    orbiter,
)

pytestmark = pytest.mark.jit_only

LATITUDE_DEG, DURATION_S = 34.1412, 2008.59  # [BETTS10], without a limit of heat flux


@functools.cache
def best(legs: int, step_s: float) -> tuple[Search, Found]:
    search = Search(legs, step_s)
    return search, search.best()


def test_the_orbiter_is_that_of_the_source() -> None:
    mission = orbiter()
    assert mission.planet.radius_km == pytest.approx(6371.204, abs=1e-3)
    assert mission.planet.mu_m3ps2 == pytest.approx(3.98603e14, rel=1e-5)
    assert mission.vehicle.mass_kg == pytest.approx(92_079.0, abs=2.0)
    assert mission.vehicle.reference_area_m2 == pytest.approx(249.91, abs=0.01)
    assert mission.entry.altitude_km == pytest.approx(79.248)
    assert (mission.planet.rotation_radps, mission.planet.j2) == (0.0, 0.0)


def test_the_best_crossrange_is_the_published_one() -> None:
    search, found = best(2, 4.0)
    assert found.latitude_deg == pytest.approx(LATITUDE_DEG, abs=0.02)
    assert found.t_s == pytest.approx(DURATION_S, abs=2.0)
    assert abs(found.speed_error_mps) < 0.01
    assert abs(found.path_error_deg) < 1e-3
    banks_deg = np.degrees(found.knots_rad[: search.n_bank])
    assert BANK_DEG[0] <= banks_deg.min() and banks_deg.max() <= BANK_DEG[1] + 1e-9


def test_the_flight_that_was_found_ends_at_the_end_altitude_with_shorter_steps_too() -> None:
    _, found = best(2, 4.0)
    finer = Search(2, 0.5)
    speed, path, latitude = finer.end(found.knots_rad)
    altitude_m = finer.path["x"][0, RADIUS] - finer.onboard["planet"]["radius_m"][0]
    assert altitude_m == pytest.approx(END_ALT_M, abs=1e-5)
    assert math.degrees(latitude) == pytest.approx(found.latitude_deg, abs=1e-4)
    assert speed == pytest.approx(762.0, abs=0.05)
    assert math.degrees(path) == pytest.approx(-5.0, abs=0.01)


def test_fewer_knots_carry_less_far_and_the_more_there_are_the_less_is_gained() -> None:
    few, more = best(1, 4.0)[1].latitude_deg, best(2, 4.0)[1].latitude_deg
    assert 0.05 < more - few < 0.15
    assert more < LATITUDE_DEG


@pytest.mark.slow
def test_more_knots_or_shorter_steps_change_less_than_the_bar() -> None:
    before, finest = best(2, 4.0)[1], best(3, 4.0)[1]
    assert finest.latitude_deg == pytest.approx(LATITUDE_DEG, abs=0.01)
    assert finest.t_s == pytest.approx(DURATION_S, abs=0.5)
    for other in (finest, best(2, 2.0)[1]):
        assert other.latitude_deg == pytest.approx(before.latitude_deg, abs=0.005)
        assert other.t_s == pytest.approx(before.t_s, abs=1.0)


def test_slopes_are_those_that_the_computer_integrates_beside_its_flight() -> None:
    search = Search(1, 2.0)
    knots = search.guess
    found = search.slopes(knots)
    search.conditions["has_sensitivities"] = 1
    end = search.end(knots)
    assert np.isfinite(end).all()
    x, rates = search.path["x"][0], np.zeros(1, MOTION)
    motion_rates(search.onboard[0], search.air[0], x, knots[-1], knots[BANK_INTERVALS], rates[0])
    by_knot, rate = search.path["by_knot"][0][:, : search.n_bank], rates["rate"][0]
    at_end = by_knot - np.outer(rate, by_knot[RADIUS] / rate[RADIUS])
    for row, state in enumerate((V, GAMMA, PHI)):
        apart = np.abs(found[row, : search.n_bank] - at_end[state]).max()
        assert apart < 1e-5 * np.abs(at_end[state]).max()


def test_a_flight_that_never_comes_down_to_the_end_has_no_numbers() -> None:
    search = Search(1, 4.0)
    search.conditions["end_alt_m"] = -1e9
    assert np.isnan(search.end(search.guess)).all()
    assert np.isnan(search.slopes(search.guess)).all()
    assert fly_legs(*search._flight) != ENDED


@pytest.mark.slow
def test_the_command_tells_the_published_numbers_beside_ours(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["reproduce", "betts", "--quick", "--json"]) == 0
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert (told["paper"], told["hold"]) == ("[BETTS10]", told["judged"])
    first = told["parts"][0]["rows"][0]
    assert (first["paper"], first["bar"]) == ("34.1412", "within 0.02")
