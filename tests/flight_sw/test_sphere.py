"""Offsets and directions on a sphere against vectors in space and central differences."""

import math

import numpy as np
import pytest

from flight_sw.model.sphere import offset, offset_slopes, turned_by

PLACES_DEG = [
    ((12.0, 30.0), (10.0, 28.0)),
    ((89.0, 10.0), (88.0, -160.0)),  # over the north pole
    ((-89.5, 100.0), (-89.9, -60.0)),
    ((5.0, 179.5), (-3.0, -179.0)),  # over the date line
    ((0.0, 0.0), (0.0, 100.0)),  # more than a quarter of the way round
    ((-16.0, 64.7), (-16.0, 64.701)),
    ((40.0, 380.0), (40.0, 25.0)),  # a longitude that has gone on past a turn
]


def frame(lat_rad: float, lon_rad: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors up, north and east of a place."""
    s, c = math.sin(lat_rad), math.cos(lat_rad)
    sl, cl = math.sin(lon_rad), math.cos(lon_rad)
    return np.array([c * cl, c * sl, s]), np.array([-s * cl, -s * sl, c]), np.array([-sl, cl, 0.0])


@pytest.mark.parametrize(("there", "here"), PLACES_DEG)
def test_an_offset_is_the_arc_in_its_direction(
    there: tuple[float, float], here: tuple[float, float]
) -> None:
    a, b = np.radians(there), np.radians(here)
    up, north, east = frame(*b)
    to = frame(*a)[0]
    arc = math.atan2(float(np.linalg.norm(np.cross(up, to))), float(up @ to))
    level = to - (up @ to) * up
    level /= np.linalg.norm(level)
    found = offset(*a, *b)
    assert found == pytest.approx((arc * (level @ north), arc * (level @ east)), abs=1e-9 * arc)


@pytest.mark.parametrize(("there", "here"), PLACES_DEG)
def test_slopes_are_those_of_central_differences(
    there: tuple[float, float], here: tuple[float, float]
) -> None:
    a, b = np.radians(there), np.radians(here)
    h = 1e-4
    by = []
    for axis in range(2):
        step = np.eye(2)[axis] * h
        near = np.subtract(offset(*(a + step), *b), offset(*(a - step), *b))
        far = np.subtract(offset(*(a + 2 * step), *b), offset(*(a - 2 * step), *b))
        by.append((8.0 * near - far) / (12.0 * h))
    north_by_lat, north_by_lon, east_by_lat, east_by_lon = offset_slopes(*a, *b)
    expected = (by[0][0], by[1][0], by[0][1], by[1][1])
    assert (north_by_lat, north_by_lon, east_by_lat, east_by_lon) == pytest.approx(
        expected, abs=1e-8
    )


@pytest.mark.parametrize(("there", "here"), PLACES_DEG)
def test_a_heading_keeps_its_angle_to_the_great_circle(
    there: tuple[float, float], here: tuple[float, float]
) -> None:
    a, b = np.radians(there), np.radians(here)
    azimuths = []
    for place, other in ((a, b), (b, a)):
        _, north, east = frame(*place)
        to = frame(*other)[0]
        azimuths.append(math.atan2(float(to @ east), float(to @ north)))
    gained = azimuths[1] + math.pi - azimuths[0]  # at the far end the circle goes on
    assert math.remainder(turned_by(*a, *b) - gained, 2 * math.pi) == pytest.approx(0.0, abs=1e-6)


def test_the_place_itself_and_the_antipode_are_finite() -> None:
    for lat, lon in ((0.3, 1.0), (-0.3, 1.0 + math.pi)):
        assert np.isfinite(offset(lat, lon, 0.3, 1.0)).all()
        assert np.isfinite(offset_slopes(lat, lon, 0.3, 1.0)).all()
    assert offset(0.3, 1.0, 0.3, 1.0) == (0.0, 0.0)
