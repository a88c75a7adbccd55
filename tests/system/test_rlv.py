"""The winged vehicle planned onboard and tracked: [JOSHI]'s cases, nominal and dispersed."""

import functools
import math
from typing import Any

import numpy as np
import pytest

from flight_sw.errors import LoadError
from flight_sw.guidance.planned.plan_job import ENDINGS
from flight_sw.guidance.planned.planned_lqr import (
    FROM_JOB,
    FROM_LOAD,
    IN_FORCE,
    SEEKING,
    TELEMETRY,
)
from flight_sw.load_image import image_bytes, parse_image, read_image
from flight_sw.modes import SAFE
from sim_harness.mission.mission import GAINS
from tests.system.flights import NAV_FRAMES, Computer, World, is_from_computer, shipped
from tools.campaign.job import Flyer, Run, job_of
from tools.gains.planned.offline import fix_at_entry, iterations_of, plan_offline
from tools.reproduce.joshi import CORNERS, OF_THE_PAPER, Case, cases, flown

pytestmark = pytest.mark.jit_only

LAW = "planned-lqr"
HEAT_FLUX_MAX_WPCM2 = 70.0


@functools.cache
def case(name: str, whole: bool) -> Case:
    return flown(name, (), tuple(CORNERS) if whole else ("nominal",))


@pytest.mark.parametrize("name", cases())
def test_a_nominal_flight_ends_at_its_target(name: str) -> None:
    found = case(name, False)
    assert found.worst("latitude_error_deg") < 0.01
    assert found.worst("longitude_error_deg") < 0.01
    assert found.worst("altitude_error_km") < 0.05
    assert found.heat_flux_wpcm2 < 71.5


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=() if n == OF_THE_PAPER else pytest.mark.slow) for n in cases()],
)
def test_one_table_of_gains_flies_the_nine_corners(name: str) -> None:
    found = case(name, True)
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


def test_without_navigation_the_job_waits_and_then_ends_with_the_plan_of_its_inputs() -> None:
    """Two seconds of silence while it plans: SAFE, then COAST again and the same plan."""
    world, usual = in_coast(1500)
    assert law_of(usual)["stage"] == IN_FORCE
    frames = world.frames
    sets = frames[~is_from_computer(frames)].reshape(-1, NAV_FRAMES)
    computer = Computer(shipped(LAW, "rlv"))
    modes, stages = set(), []
    for cycle, frames in enumerate(sets):
        computer.feed(frames[-1:] if 40 <= cycle < 140 else frames)
        modes.add(int(computer.state["mode"][0]))
        stages.append(int(law_of(computer)["stage"]))
    assert SAFE in modes
    assert stages[39] == stages[139] == SEEKING
    assert stages[-1] == IN_FORCE
    plans = [law_of(c)["plans"][law_of(c)["in_force"]].tobytes() for c in (usual, computer)]
    assert plans[0] == plans[1]


@pytest.mark.parametrize("lift_ratio", [0.0, -1.0], ids=["no lift", "lift downwards"])
def test_where_the_bank_moves_nothing_or_the_other_way_the_plan_ends_in_a_word(
    lift_ratio: float,
) -> None:
    made = shipped(LAW, "rlv")
    load = made.load.copy()
    load["law"]["stored"]["profile"] = load["law"]["guess"]
    load["onboard"]["vehicle"]["aero"]["cl_powers"] *= lift_ratio
    found = plan_offline(load, fix_at_entry(made.mission))
    job = found.job[0]
    assert ENDINGS[int(job["ending"])] in ("stuck", "small step", "out of iterations", "converged")
    assert found.stage == IN_FORCE
    errors = [row["target_error"] + row["excess"] for row in iterations_of(job)]
    assert np.isfinite(errors).all() and np.isfinite(found.plan["state"]).all()
    if lift_ratio == 0.0:
        assert ENDINGS[int(job["ending"])] != "converged"
        places = {(row["latitude_deg"], row["longitude_deg"]) for row in iterations_of(job)}
        assert len(places) == 1  # the bank at the end alone gets better


def test_gains_that_do_not_cover_the_plan_are_refused_in_a_sentence() -> None:
    image = read_image(GAINS / "rlv" / "planned-lqr.load")
    for part, words in (
        (slice(0, 20), "tracker.index goes from 0.05 to"),
        (slice(40, 66), "allowed at least 75% of where the plan is tracked, 0.02 to 7.2"),
    ):
        body = image.body.copy()
        table = body["law"]["tracker"][0]
        rows = table["index"][part].copy()
        table["index"][: len(rows)], table["n_rows"] = rows, len(rows)
        with pytest.raises(LoadError, match=words):
            parse_image(image_bytes(LAW, image.mission, body), "other.load")
