"""Entries that cross a pole, close by and farther off: nothing true is refused."""

from typing import Any

import numpy as np
import pytest

from flight_sw.load_image import activate, image_bytes, parse_image
from flight_sw.records.dictionary import FRAME
from sim_harness.telemetry.logs import Logs
from sim_harness.world.missions import load_mission
from sim_harness.world.records import END_CONDITION
from tests.system.flights import MISSION, NAV_FRAMES, Built, Computer, World, design
from tools.gains.body import fill_body

pytestmark = pytest.mark.jit_only


def towards(latitude_deg: float, heading_deg: float, rotation: dict[str, Any]) -> Built:
    """Hyperion-1 from this latitude, on this heading."""
    entry = {"entry.latitude_deg": latitude_deg, "entry.heading_deg": heading_deg}
    mission = load_mission(MISSION, {**entry, **rotation})
    raw = image_bytes("lqy", MISSION, fill_body("lqy", design(), mission).body)
    image = parse_image(raw, "lqy")
    return Built(mission, "lqy", raw, image, activate(image))


@pytest.mark.parametrize("heading_deg", [0.0, 0.1, 1.0])
@pytest.mark.parametrize(("latitude_deg", "rotation"), [
    (70.0, {"rotation_radps": 0.0}), (75.0, {}), (-70.0, {"rotation_radps": 0.0}),
])  # fmt: skip
def test_a_flight_over_a_pole_loses_no_set(
    latitude_deg: float, heading_deg: float, rotation: dict[str, Any]
) -> None:
    heading_deg = heading_deg if latitude_deg > 0.0 else 180.0 - heading_deg
    made = towards(latitude_deg, heading_deg, rotation)
    world, computer = World(made, 1), Computer(made)
    world.logs = Logs(np.zeros(55_000, FRAME), world.logs.bus[:0], world.logs.truth[:0])
    assert world.fly(computer, 50_000) == END_CONDITION
    cycles = int(world.harness["truth"]["minor_frames"][0])
    assert computer.counted == {"OK": NAV_FRAMES * cycles + 1}
    assert computer.state["incomplete_sets"][0] == 0
