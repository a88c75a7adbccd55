"""The winged vehicle planned onboard and tracked: [JOSHI]'s cases, nominal and dispersed."""

import functools
import math
from typing import Any

import numpy as np
import pytest

from flight_sw.guidance.planned.plan_job import ENDINGS
from flight_sw.guidance.planned.planned_lqr import (
    FROM_JOB,
    FROM_LOAD,
    IN_FORCE,
    SEEKING,
    TELEMETRY,
)
from tests.system.flights import Computer, World, shipped
from tools.campaign.job import Flyer, Run, job_of
from tools.reproduce.joshi import CASES_DEG, CORNERS, Case, flown

pytestmark = pytest.mark.jit_only

LAW = "planned-lqr"
HEAT_FLUX_MAX_WPCM2 = 70.0


@functools.cache
def case(latitude_deg: float, whole: bool) -> Case:
    return flown(latitude_deg, (), tuple(CORNERS) if whole else ("nominal",))


@pytest.mark.parametrize("latitude_deg", CASES_DEG)
def test_a_nominal_flight_ends_at_its_target(latitude_deg: float) -> None:
    found = case(latitude_deg, False)
    assert found.worst("latitude_error_deg") < 0.01
    assert found.worst("longitude_error_deg") < 0.01
    assert found.worst("altitude_error_km") < 0.05
    assert found.heat_flux_wpcm2 < 71.5


@pytest.mark.parametrize(
    "latitude_deg",
    [pytest.param(lat, marks=() if lat == 0.0 else pytest.mark.slow) for lat in CASES_DEG],
)
def test_one_table_of_gains_flies_the_nine_corners(latitude_deg: float) -> None:
    found = case(latitude_deg, True)
    assert found.worst("latitude_error_deg") < 0.2
    assert found.worst("longitude_error_deg") < 0.2
    assert found.worst("altitude_error_km") < 2.0
    assert found.worst("final_flight_path_angle_deg") < 1.5
    assert found.worst("final_heading_deg") < 8.0
    assert found.heat_flux_wpcm2 <= HEAT_FLUX_MAX_WPCM2


def in_coast(cycles: int) -> tuple[World, Computer]:
    made = shipped(LAW, "rlv")
    world, computer = World(made, 3000), Computer(made)
    world.fly(computer, cycles)
    return world, computer


def law_of(computer: Computer) -> Any:
    return computer.state["law"][0]


def test_the_plan_is_made_in_coast_and_swapped_in_whole() -> None:
    world, computer = in_coast(50)
    assert law_of(computer)["stage"] == SEEKING
    assert law_of(computer)["source"] == FROM_LOAD
    before = law_of(computer)["plans"].tobytes()
    while law_of(computer)["stage"] == SEEKING:
        assert law_of(computer)["source"] == FROM_LOAD
        assert law_of(computer)["plans"].tobytes() == before
        world.fly(computer, 10)
    while law_of(computer)["stage"] != IN_FORCE:
        assert law_of(computer)["source"] == FROM_LOAD
        world.fly(computer, 1)
    assert law_of(computer)["source"] == FROM_JOB
    plan = law_of(computer)["plans"][law_of(computer)["in_force"]]
    assert ENDINGS[plan["ending"]] == "converged"
    assert np.isfinite(plan["state"][: plan["n_rows"]]).all()
    assert (np.diff(plan["index"][: plan["n_rows"]]) > 0.0).all()


def test_in_coast_telemetry_tells_of_the_job() -> None:
    world, computer = in_coast(50)
    told = dict(zip(TELEMETRY, computer.state["guidance"][0]["telemetry"].tolist(), strict=False))
    assert (told["plan_stage"], told["plan_source"]) == (SEEKING, FROM_LOAD)
    stored = computer.made.load["law"][0]["stored"]
    assert told["plan_flights"] == stored["flights"]
    while law_of(computer)["stage"] != IN_FORCE:
        world.fly(computer, 1)
    told = dict(zip(TELEMETRY, computer.state["guidance"][0]["telemetry"].tolist(), strict=False))
    plan = law_of(computer)["plans"][law_of(computer)["in_force"]]
    assert (told["plan_stage"], told["plan_source"]) == (IN_FORCE, FROM_JOB)
    assert told["plan_flights"] == plan["flights"] and told["plan_ending"] == plan["ending"]


def flight_of(*settings: str) -> dict[str, Any]:
    """What a flight in memory with these settings ended with."""
    job, _ = job_of("rlv", LAW, list(settings), None)
    return Flyer(job).fly(Run(1, {}, 0, {}))


@pytest.mark.parametrize(
    ("entry", "target"),
    [((60.0, 0.0, 0.0), (66.66, 171.75)), ((-89.9, 0.0, 180.0), (-36.0, 166.0))],
    ids=["past the north pole", "across the south pole"],
)
def test_a_flight_over_a_pole_ends_at_its_target(
    entry: tuple[float, float, float], target: tuple[float, float]
) -> None:
    settings = [
        f"entry.{key}={value}"
        for key, value in zip(("latitude_deg", "longitude_deg", "heading_deg"), entry, strict=True)
    ]
    flown = flight_of(
        *settings, f"target.latitude_deg={target[0]}", f"target.longitude_deg={target[1]}",
        "entry.flight_path_angle_deg=-1", "limits.heat_flux_max_kwpm2=1000",
    )  # fmt: skip
    assert flown["outcome_class"] == "nominal"
    east_deg = flown["longitude_error_deg"] * math.cos(math.radians(target[0]))
    assert math.hypot(flown["latitude_error_deg"], east_deg) < 0.01
    assert abs(flown["altitude_error_km"]) < 0.15
