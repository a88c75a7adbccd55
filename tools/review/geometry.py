"""Places and directions over a sphere, in the axes of the planet: x to 0 E, y to 90 E, z north."""

import numpy as np
import numpy.typing as npt

F8 = npt.NDArray[np.float64]


def positions(lon_rad: F8, lat_rad: F8, radius: F8 | float) -> F8:
    """Cartesian places, one row each, in the unit of the radius."""
    lon, lat = np.asarray(lon_rad, float), np.asarray(lat_rad, float)
    c_lat = np.cos(lat)
    up = np.stack([c_lat * np.cos(lon), c_lat * np.sin(lon), np.sin(lat)], axis=-1)
    return up * np.asarray(radius, float)[..., None]


def east_north_up(lon_rad: F8, lat_rad: F8) -> tuple[F8, F8, F8]:
    """Local unit vectors, one row a place."""
    lon, lat = np.asarray(lon_rad, float), np.asarray(lat_rad, float)
    zero = np.zeros_like(lon)
    east = np.stack([-np.sin(lon), np.cos(lon), zero], axis=-1)
    north = np.stack([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)], axis=-1)
    return east, north, positions(lon, lat, 1.0)


def velocity_and_lift(
    lon_rad: F8, lat_rad: F8, flight_path_angle_rad: F8, heading_rad: F8, bank_rad: F8
) -> tuple[F8, F8]:
    """Unit vectors of the velocity and of positive lift; bank turns it to the right."""
    east, north, up = east_north_up(lon_rad, lat_rad)
    s_head, c_head = np.sin(heading_rad)[:, None], np.cos(heading_rad)[:, None]
    s_fpa, c_fpa = np.sin(flight_path_angle_rad)[:, None], np.cos(flight_path_angle_rad)[:, None]
    s_bank, c_bank = np.sin(bank_rad)[:, None], np.cos(bank_rad)[:, None]
    level = s_head * east + c_head * north
    right = c_head * east - s_head * north
    velocity = c_fpa * level + s_fpa * up
    lifted = -s_fpa * level + c_fpa * up
    return velocity, c_bank * lifted + s_bank * right


def angle_between(lon_rad: F8, lat_rad: F8, lon_to_rad: F8 | float, lat_to_rad: F8 | float) -> F8:
    """Angle of the great circle between two places."""
    d_lon, d_lat = np.asarray(lon_to_rad) - lon_rad, np.asarray(lat_to_rad) - lat_rad
    h = np.sin(d_lat / 2.0) ** 2 + np.cos(lat_rad) * np.cos(lat_to_rad) * np.sin(d_lon / 2.0) ** 2
    return np.asarray(2.0 * np.arcsin(np.sqrt(np.clip(h, 0.0, 1.0))))


def to_go(
    lon_rad: F8, lat_rad: F8, target_rad: tuple[float, float], radius_m: float
) -> tuple[F8, F8]:
    """Range to a target (longitude, latitude), and crossrange: to the right of the great circle
    from the first place to the target."""
    target = np.array(target_rad)
    range_m = radius_m * angle_between(lon_rad, lat_rad, target[0], target[1])
    here = positions(lon_rad, lat_rad, 1.0)
    there = positions(target[:1], target[1:], 1.0)[0]
    normal = np.cross(here[0], there)
    length = float(np.linalg.norm(normal))
    if length == 0.0:
        return range_m, np.zeros_like(range_m)
    left = here @ (normal / length)
    return range_m, -radius_m * np.arcsin(np.clip(left, -1.0, 1.0))


def across(
    place_rad: tuple[float, float], heading_rad: float, target_rad: tuple[float, float]
) -> tuple[float, F8]:
    """By what angle a target lies to the right of the great circle from a place along a heading,
    and where on that circle it is abeam, as a unit vector; places are longitude and latitude."""
    lon, lat = np.array(place_rad[:1]), np.array(place_rad[1:])
    east, north, up = east_north_up(lon, lat)
    right = np.cos(heading_rad) * east[0] - np.sin(heading_rad) * north[0]
    there = positions(np.array(target_rad[:1]), np.array(target_rad[1:]), 1.0)[0]
    share = float(np.clip(there @ right, -1.0, 1.0))
    abeam = there - share * right
    length = float(np.linalg.norm(abeam))
    return float(np.arcsin(share)), abeam / length if length > 0.0 else up[0]


def arc(start: F8, end: F8, points: int = 40) -> F8:
    """Unit vectors along the great circle between two, the shorter way, one row each."""
    angle = float(np.arctan2(np.linalg.norm(np.cross(start, end)), start @ end))
    share = np.linspace(0.0, 1.0, points)[:, None]
    if not np.sin(angle) > 0.0:
        return np.repeat(start[None, :], points, axis=0)
    return np.asarray(
        (np.sin((1.0 - share) * angle) * start + np.sin(share * angle) * end) / np.sin(angle)
    )


def circle(lon_rad: float, lat_rad: float, radius_rad: float, points: int = 73) -> F8:
    """Longitudes and latitudes of the places at one distance from another, closed."""
    bearing = np.linspace(0.0, 2.0 * np.pi, points)
    s_lat = np.sin(lat_rad) * np.cos(radius_rad)
    s_lat = s_lat + np.cos(lat_rad) * np.sin(radius_rad) * np.cos(bearing)
    lat = np.arcsin(np.clip(s_lat, -1.0, 1.0))
    d_lon = np.arctan2(
        np.sin(bearing) * np.sin(radius_rad) * np.cos(lat_rad),
        np.cos(radius_rad) - np.sin(lat_rad) * np.sin(lat),
    )
    return np.stack([lon_rad + d_lon, lat], axis=-1)
