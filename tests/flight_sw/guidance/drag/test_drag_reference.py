"""The reference, the way to the target and the nominal bank, against closed forms."""

import math

import numpy as np
import pytest

from flight_sw.errors import LoadError
from flight_sw.guidance.drag.bank_profile import BANK_PROFILE, nominal_bank
from flight_sw.guidance.drag.reference import NOMINAL, REFERENCE, look_up
from flight_sw.model.great_circle import GROUND_TRACK, range_flown
from sim_harness.world.ground_track import fill_ground_track
from sim_harness.world.missions import load_mission


@pytest.fixture
def cubic():
    """Rows of 2 + 3x + x^2 - 0.5 x^3, with its slope and bend."""
    reference = np.zeros(1, REFERENCE.dtype)
    x = np.array([0.0, 0.5, 1.3, 2.0])
    reference["n_rows"] = 4
    reference["grid"][0, :4] = x
    reference["drag_mps2"][0, :4] = 2.0 + 3.0 * x + x**2 - 0.5 * x**3
    reference["slope"][0, :4] = 3.0 + 2.0 * x - 1.5 * x**2
    reference["bend"][0, :4] = 2.0 - 3.0 * x
    reference["range_m"][0, :4] = 100.0 * x
    return reference[0]


def looked_up(reference, at):
    out = np.zeros(1, NOMINAL.dtype)
    look_up(reference, float(at), out[0])
    return out[0]


@pytest.mark.parametrize("x", [0.0, 0.1, 0.5, 0.9, 1.7, 2.0])
def test_a_cubic_is_met_everywhere(cubic, x):
    got = looked_up(cubic, x)
    assert got["drag_mps2"] == pytest.approx(2.0 + 3.0 * x + x**2 - 0.5 * x**3, rel=1e-13)
    assert got["slope"] == pytest.approx(3.0 + 2.0 * x - 1.5 * x**2, rel=1e-13)
    assert got["bend"] == pytest.approx(2.0 - 3.0 * x, rel=1e-12, abs=1e-13)
    assert got["range_m"] == pytest.approx(100.0 * x, abs=1e-12)


@pytest.mark.parametrize("x, row", [(-0.1, 0), (2.1, 3), (1e9, 3)])
def test_outside_its_rows_the_end_is_held_without_slope(cubic, x, row):
    got = looked_up(cubic, x)
    assert got["drag_mps2"] == cubic["drag_mps2"][row]
    assert (got["slope"], got["bend"]) == (0.0, 0.0)


def test_the_track_is_the_great_circle():
    mission = load_mission(
        "mars-lander", {"target.longitude_deg": 60.0, "target.latitude_deg": 45.0}
    )
    track = np.zeros(1, GROUND_TRACK.dtype)
    fill_ground_track(track[0], mission)
    radius_m = 3397e3
    # cos c = cos 45 cos 60
    arc = math.acos(math.cos(math.pi / 4) * 0.5)
    assert track["target_m"][0] == pytest.approx(radius_m * arc)
    lon, lat = math.radians(60.0), math.radians(45.0)
    assert range_flown(track[0], radius_m, lon, lat) == pytest.approx(radius_m * arc)
    assert range_flown(track[0], radius_m, 0.0, 0.0) == pytest.approx(0.0, abs=1e-9)
    # A place abeam of the start has flown nothing: at right angles to the way's first heading.
    heading = math.atan2(math.sin(lon) * math.cos(lat), math.sin(lat))
    lat_abeam = math.asin(math.sin(0.1) * math.cos(heading + math.pi / 2))
    lon_abeam = math.asin(math.sin(0.1) * math.sin(heading + math.pi / 2) / math.cos(lat_abeam))
    assert range_flown(track[0], radius_m, lon_abeam, lat_abeam) == pytest.approx(0.0, abs=1e-6)


def test_a_track_that_is_no_frame_is_refused():
    track = np.zeros(1, GROUND_TRACK.dtype)
    track["cos_start_x"], track["cos_ahead_x"] = 1.0, 1.0
    with pytest.raises(LoadError, match="allowed 1, 1 and 0"):
        GROUND_TRACK.check(track[0], "ground_track")


@pytest.mark.parametrize(
    "v_mps, bank_deg", [(503.0, 47.0), (6750.0, 56.0), (3626.5, 51.5), (9e3, 56.0), (0.0, 47.0)]
)
def test_the_nominal_bank_is_a_straight_line_held_outside(v_mps, bank_deg):
    profile = np.zeros(1, BANK_PROFILE.dtype)
    profile[0] = (math.radians(56.0), math.radians(47.0), 6750.0, 503.0)
    assert math.degrees(nominal_bank(profile[0], v_mps)) == pytest.approx(bank_deg)
