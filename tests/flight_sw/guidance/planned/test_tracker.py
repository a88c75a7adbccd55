"""The tracker at the end of its plan, at a pole and with errors of a known direction."""

import math
from typing import Any

import numpy as np
import pytest

from flight_sw.guidance.planned.tracker import ACROSS, ALONG, TRACKING, compare
from flight_sw.load_image import activate, read_image
from flight_sw.model.motion import LAMBDA, PHI, PSI, RADIUS, V
from flight_sw.runtime.jit import kernel
from sim_harness.mission.mission import GAINS
from tests.flight_sw.test_sphere import frame

pytestmark = pytest.mark.jit_only


@kernel
def compared(loads: Any, own: Any, t_s: float) -> bool:
    load = loads[0]
    return compare(
        load["onboard"]["planet"], load["law"]["stored"], load["law"]["tracker"], own[0], t_s
    )


class Tracked:
    """The shipped plan, and a vehicle beside one of its rows."""

    def __init__(self) -> None:
        self.load = activate(read_image(GAINS / "rlv" / "planned-lqr.load")).copy()
        self.plan = self.load["law"]["stored"][0]
        self.own = np.zeros(1, TRACKING)

    def at(self, row: int) -> np.ndarray:
        self.own["x"][0] = self.plan["state"][row]
        return self.own["x"][0]

    def compare(self) -> bool:
        return bool(compared(self.load, self.own, 0.0))


def test_beyond_the_end_of_the_plan_the_errors_stay() -> None:
    tracked = Tracked()
    last = int(tracked.plan["n_rows"]) - 1
    x = tracked.at(last)
    x[V] += 0.5
    x[RADIUS] += 40.0
    assert tracked.compare()
    before, index = tracked.own["error"].tobytes(), float(tracked.own["index"][0])
    x[V] -= 30.0
    x[PHI] += 0.01
    assert not tracked.compare()
    assert tracked.own["error"].tobytes() == before
    assert tracked.own["index"][0] > index  # where it is on the axis of energy is told on


@pytest.mark.parametrize("latitude_deg", [-16.0, 60.0, 89.5, -89.5])
@pytest.mark.parametrize("ahead_km", [8.0, -8.0])
def test_an_error_along_the_track_is_one_wherever_on_the_planet(
    latitude_deg: float, ahead_km: float
) -> None:
    """A vehicle some way further on the great circle of a row flies straight and stands ahead."""
    tracked = Tracked()
    row = 400
    rows = tracked.plan["state"][: int(tracked.plan["n_rows"])]
    rows[:, PHI] = math.radians(latitude_deg)  # the energy of a row hangs on its latitude
    rows[:, LAMBDA], rows[:, PSI] = 3.0, rows[row, PSI]
    x = tracked.at(row)
    arc = ahead_km * 1e3 / x[RADIUS]
    lat, lon, psi = rows[row, [PHI, LAMBDA, PSI]]
    up, north, east = frame(lat, lon)
    way = math.cos(psi) * north + math.sin(psi) * east
    there = math.cos(arc) * up + math.sin(arc) * way
    on = math.cos(arc) * way - math.sin(arc) * up
    x[PHI], x[LAMBDA] = math.asin(there[2]), math.atan2(there[1], there[0])
    _, there_north, there_east = frame(x[PHI], x[LAMBDA])
    x[PSI] = math.atan2(float(on @ there_east), float(on @ there_north))
    assert tracked.compare()
    error = tracked.own["error"][0]
    assert error[ALONG] == pytest.approx(arc, rel=1e-6)
    assert error[ACROSS] == pytest.approx(0.0, abs=1e-6 * abs(arc))
    assert error[PSI] == pytest.approx(0.0, abs=1e-7)
