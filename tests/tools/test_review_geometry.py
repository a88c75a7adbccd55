"""Places, directions and distances over a sphere, against closed forms."""

import math

import numpy as np
import pytest

from tools.review.geometry import across, arc, circle, positions, to_go, velocity_and_lift

RADIUS_KM = 6378.137


def direction(bank_deg: float, heading_deg: float = 0.0) -> np.ndarray:
    """Lift of a vehicle over 0 N 0 E in level flight."""
    zero = np.zeros(1)
    heading, bank = np.radians([heading_deg]), np.radians([bank_deg])
    return velocity_and_lift(zero, zero, zero, heading, bank)[1][0]


@pytest.mark.parametrize(
    ("lon_deg", "lat_deg", "axis"),
    [(0, 0, (1, 0, 0)), (90, 0, (0, 1, 0)), (180, 0, (-1, 0, 0)), (37, 90, (0, 0, 1))],
)
def test_places_on_the_axes(lon_deg: float, lat_deg: float, axis: tuple[float, ...]) -> None:
    place = positions(np.radians([lon_deg]), np.radians([lat_deg]), RADIUS_KM)[0]
    np.testing.assert_allclose(place, np.array(axis) * RADIUS_KM, atol=1e-9)


def test_every_place_lies_at_its_altitude() -> None:
    rng = np.random.default_rng(4)
    lon, lat = rng.uniform(-math.pi, math.pi, 200), rng.uniform(-1.57, 1.57, 200)
    alt = rng.uniform(0.0, 120.0, 200)
    found = np.linalg.norm(positions(lon, lat, RADIUS_KM + alt), axis=1)
    np.testing.assert_allclose(found, RADIUS_KM + alt, rtol=1e-14)


def test_flying_north_over_the_gulf_of_guinea_lift_goes_up_and_bank_turns_it_east() -> None:
    np.testing.assert_allclose(direction(0.0), [1, 0, 0], atol=1e-15)  # up is x at 0 N 0 E
    np.testing.assert_allclose(direction(90.0), [0, 1, 0], atol=1e-15)  # right wing down: east
    np.testing.assert_allclose(direction(-90.0), [0, -1, 0], atol=1e-15)
    np.testing.assert_allclose(direction(180.0), [-1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(direction(90.0, 90.0), [0, 0, -1], atol=1e-15)  # flying east: south


def test_lift_is_square_to_the_velocity_and_both_are_unit_vectors() -> None:
    rng = np.random.default_rng(5)
    state = [rng.uniform(-1.5, 1.5, 300) for _ in range(5)]
    velocity, lift = velocity_and_lift(*state)
    np.testing.assert_allclose((velocity * lift).sum(axis=1), 0.0, atol=1e-14)
    for vectors in (velocity, lift):
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, rtol=1e-14)


def test_a_quarter_of_the_equator_to_go() -> None:
    range_m, cross_m = to_go(np.zeros(1), np.zeros(1), (math.pi / 2, 0.0), 6.4e6)
    assert range_m[0] == pytest.approx(6.4e6 * math.pi / 2)
    assert cross_m[0] == pytest.approx(0.0, abs=1e-6)


def test_crossrange_is_positive_to_the_right_of_the_way_to_the_target() -> None:
    lon, lat = np.radians([0.0, 1.0, -2.0]), np.zeros(3)  # started at 0 E, target due north
    _, cross_m = to_go(lon, lat, (0.0, math.radians(30.0)), 6.4e6)
    np.testing.assert_allclose(cross_m, 6.4e6 * np.radians([0.0, 1.0, -2.0]), atol=1e-3)


def test_a_flight_that_starts_at_its_target_has_no_crossrange() -> None:
    _, cross_m = to_go(np.zeros(2), np.zeros(2), (0.0, 0.0), 6.4e6)
    assert cross_m.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("lat_deg", [-70.0, 0.0, 45.0, 89.0])
def test_a_circle_keeps_its_distance(lat_deg: float) -> None:
    lon_lat = circle(1.0, math.radians(lat_deg), math.radians(3.0))
    edge = positions(lon_lat[:, 0], lon_lat[:, 1], 1.0)
    middle = positions(np.array([1.0]), np.radians([lat_deg]), 1.0)[0]
    np.testing.assert_allclose(np.degrees(np.arccos(edge @ middle)), 3.0, rtol=1e-9)


@pytest.mark.parametrize(
    ("heading_deg", "target_deg", "right_deg", "abeam_deg"),
    [
        (90.0, (60.0, -20.0), 20.0, (60.0, 0.0)),  # eastwards along the equator, south is right
        (90.0, (60.0, 20.0), -20.0, (60.0, 0.0)),
        (0.0, (30.0, 0.0), 30.0, (0.0, 0.0)),  # northwards, east is right
        (270.0, (-170.0, 5.0), 5.0, (-170.0, 0.0)),
    ],
)
def test_a_target_lies_across_the_great_circle_by_the_angle_to_it(
    heading_deg: float, target_deg: tuple[float, float], right_deg: float,
    abeam_deg: tuple[float, float],
) -> None:  # fmt: skip
    target = (math.radians(target_deg[0]), math.radians(target_deg[1]))
    right, abeam = across((0.0, 0.0), math.radians(heading_deg), target)
    assert math.degrees(right) == pytest.approx(right_deg, abs=1e-12)
    lon, lat = np.radians(abeam_deg)
    np.testing.assert_allclose(
        abeam, positions(np.array([lon]), np.array([lat]), 1.0)[0], atol=1e-12
    )


def test_an_arc_has_equal_steps_and_ends_where_it_is_said_to() -> None:
    ends = positions(np.radians([10.0, 80.0]), np.radians([5.0, -40.0]), 1.0)
    line = arc(ends[0], ends[1], 9)
    np.testing.assert_allclose(line[[0, -1]], ends, atol=1e-15)
    steps = np.arccos(np.sum(line[:-1] * line[1:], axis=1))
    np.testing.assert_allclose(steps, math.acos(float(ends[0] @ ends[1])) / 8.0, rtol=1e-9)
    assert arc(ends[0], ends[0]).tolist() == [ends[0].tolist()] * 40
