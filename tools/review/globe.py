"""The planet, and what stands on it: coastlines, track, lift, target, way-points, zones. In km."""

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tools.review.coastlines import land, shore_lines
from tools.review.geometry import (
    across,
    arc,
    circle,
    east_north_up,
    positions,
    velocity_and_lift,
)
from tools.review.palette import (
    AXIS_RGBA,
    COAST_RGBA,
    GRATICULE_RGBA,
    LIFT,
    TARGET,
    VELOCITY,
    ZONE,
    Palette,
    faded,
)
from tools.review.stage import Stage, part
from tools.tracks import Track

F8 = npt.NDArray[np.float64]
Rows = npt.NDArray[np.void]

PATH = "globe"
GRID_DEG = 15
TEXTURE = (1440, 720)
MESH = (144, 72)
LIFTED = 1.0006  # of the radius: lines on the ground are drawn just above it
LIFT_EVERY_S = 20.0
MOVING_HZ = 2.0
LIFT_SHARE, VELOCITY_SHARE, COMB_SHARE = 0.045, 0.06, 0.025  # of the radius
TRACK_POINTS = 3000
AHEAD_RAD = 0.8  # of a flight that has not been flown
NAME_AWAY = 0.1  # of the radius, beyond the end of a line that it names
CROSSRANGE_MIN_KM = 1.0  # less is not drawn
EYE_UP, EYE_ASIDE = 0.8, 0.45  # of the length of the track

SEA, LAND = (24, 46, 72), (58, 78, 62)
BODIES = {  # mean radius in km: name, colour
    "Earth": (6371.0, SEA),
    "Mars": (3389.5, (122, 66, 44)),
}
UNKNOWN_BODY = ("the planet", (84, 84, 92))
SAME_BODY = 0.02

POSITION = ("lon_rad", "lat_rad", "alt_m")
ATTITUDE = ("flight_path_angle_rad", "heading_rad", "bank_rad")


class Body(NamedTuple):
    """A planet as it is drawn."""

    name: str
    radius_km: float
    colour: tuple[int, int, int]


def body_of(radius_m: float) -> Body:
    """Which planet has this radius."""
    radius_km = radius_m / 1e3
    for name, (mean_km, colour) in BODIES.items():
        if abs(radius_km - mean_km) < SAME_BODY * mean_km:
            return Body(name, radius_km, colour)
    return Body(UNKNOWN_BODY[0], radius_km, UNKNOWN_BODY[1])


def picture(body: Body) -> npt.NDArray[np.uint8]:
    """The planet's surface from 180 deg west to east, north up."""
    width, height = TEXTURE
    pixels = np.empty((height, width, 3), np.uint8)
    pixels[:] = body.colour
    if body.name == "Earth":
        pixels[land(width, height)] = LAND
    return pixels


def sphere(radius_km: float) -> dict[str, npt.NDArray[Any]]:
    """Vertices, triangles, normals and places on the picture."""
    columns, rows = MESH
    u, v = np.meshgrid(np.linspace(0.0, 1.0, columns + 1), np.linspace(0.0, 1.0, rows + 1))
    lon, lat = (u * 2.0 - 1.0) * math.pi, (0.5 - v) * math.pi
    normals = positions(lon, lat, 1.0).reshape(-1, 3)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = corner + columns + 1
    triangles = np.concatenate(
        [
            np.stack([corner, below, corner + 1], axis=-1),
            np.stack([corner + 1, below, below + 1], axis=-1),
        ]
    )
    return {
        "vertex_positions": (normals * radius_km).astype(np.float32),
        "triangle_indices": triangles.astype(np.uint32),
        "vertex_normals": normals.astype(np.float32),
        "vertex_texcoords": np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32),
    }


def graticule(radius_km: float) -> list[F8]:
    """Meridians and parallels."""
    lats, lons = np.radians(np.linspace(-90, 90, 91)), np.radians(np.linspace(-180, 180, 181))
    lines = [
        positions(np.full_like(lats, math.radians(lon)), lats, radius_km)
        for lon in range(-180, 180, GRID_DEG)
    ]
    lines += [
        positions(lons, np.full_like(lons, math.radians(lat)), radius_km)
        for lat in range(-90 + GRID_DEG, 90, GRID_DEG)
    ]
    return lines


def draw_body(stage: Stage, body: Body) -> None:
    """The sphere with coastlines, where it is the Earth, and a grid of 15 degrees."""
    rr = stage.rr
    stage.still(PATH, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    mesh = rr.Mesh3D(**sphere(body.radius_km), albedo_texture=picture(body))
    stage.still(f"{PATH}/{part(body.name)}", mesh)
    above = body.radius_km * LIFTED
    grid = rr.LineStrips3D(
        graticule(above), colors=[GRATICULE_RGBA], radii=rr.Radius.ui_points(0.35)
    )
    stage.still(f"{PATH}/graticule", grid)
    if body.name == "Earth":
        shores = [
            positions(np.radians(line[:, 0]), np.radians(line[:, 1]), above)
            for line in shore_lines()
        ]
        coast = rr.LineStrips3D(shores, colors=[COAST_RGBA], radii=rr.Radius.ui_points(0.6))
        stage.still(f"{PATH}/coastlines", coast)


def track_km(truth: Rows, radius_km: float) -> F8:
    """Where the vehicle was, one row a sample."""
    return positions(truth["lon_rad"], truth["lat_rad"], radius_km + truth["alt_m"] / 1e3)


def draw_track(stage: Stage, label: str, truth: Rows, body: Body, look: Palette) -> None:
    """Track, its shadow on the ground, and the lift at equal steps of time."""
    rr, path = stage.rr, f"{PATH}/flights/{part(label)}"
    thin = truth[:: max(len(truth) // TRACK_POINTS, 1)]
    line = track_km(thin, body.radius_km)
    track = rr.LineStrips3D([line], colors=[look.flown], radii=rr.Radius.ui_points(1.4))
    stage.still(f"{path}/track", track)
    ground = positions(thin["lon_rad"], thin["lat_rad"], body.radius_km * LIFTED)
    shadow = rr.LineStrips3D(
        [ground], colors=[faded(look.flown, 110)], radii=rr.Radius.ui_points(0.8)
    )
    stage.still(f"{path}/ground_track", shadow)
    if set(ATTITUDE) <= set(truth.dtype.names or ()):
        steps = np.arange(truth["t_s"][0], truth["t_s"][-1], LIFT_EVERY_S)
        comb = truth[np.searchsorted(truth["t_s"], steps)]
        origins = track_km(comb, body.radius_km)
        _, lift = _directions(comb)
        teeth = np.stack([origins, origins + lift * COMB_SHARE * body.radius_km], axis=1)
        colour = faded(LIFT if look.is_alone else look.commanded, 190)
        lines = rr.LineStrips3D(teeth, colors=[colour], radii=rr.Radius.ui_points(0.6))
        stage.still(f"{path}/lift_comb", lines)


def draw_planned(
    stage: Stage, label: str, tracks: tuple[Track, ...], body: Body, look: Palette
) -> None:
    """What was meant: beneath the track that was flown, and wider."""
    rr = stage.rr
    for number, track in enumerate(tracks):
        if not set(POSITION) <= track.path.keys():
            continue
        path = f"{PATH}/flights/{part(label)}/{part(track.name)}"
        lon, lat, alt_m = (np.asarray(track.path[name]) for name in POSITION)
        line = positions(lon, lat, body.radius_km + alt_m / 1e3)
        ground = positions(lon, lat, np.full_like(lon, body.radius_km * LIFTED))
        colour = look.plan_of(number)
        drawn = rr.LineStrips3D([line], colors=[colour], radii=rr.Radius.ui_points(2.8))
        stage.still(path, drawn)
        shadow = rr.LineStrips3D(
            [ground], colors=[faded(colour, 110)], radii=rr.Radius.ui_points(1.6)
        )
        stage.still(f"{path}/ground_track", shadow)


def draw_crossrange(
    stage: Stage, label: str, truth: Rows, target_rad: tuple[float, float], body: Body
) -> None:
    """The great circle on that the flight began, and how far across it the target lies."""
    rr, first, yellow = stage.rr, truth[0], TARGET
    here = float(first["lon_rad"]), float(first["lat_rad"])
    right_rad, abeam = across(here, float(first["heading_rad"]), target_rad)
    km = abs(right_rad) * body.radius_km
    if km < CROSSRANGE_MIN_KM:
        return
    start = positions(np.array(here[:1]), np.array(here[1:]), 1.0)[0]
    end = positions(np.array(target_rad[:1]), np.array(target_rad[1:]), 1.0)[0]
    lines = [arc(start, abeam), arc(abeam, end)]
    above = body.radius_km * LIFTED
    path = f"{PATH}/flights/{part(label)}/crossrange"
    drawn = rr.LineStrips3D(
        [line * above for line in lines],
        colors=[faded(AXIS_RGBA, 150), faded(yellow, 220)],
        radii=rr.Radius.ui_points(0.9),
    )
    stage.still(path, drawn)
    name = rr.Points3D(
        (abeam - NAME_AWAY * (end - abeam) / np.linalg.norm(end - abeam))[None, :] * above,
        colors=[yellow],
        labels=[f"crossrange {km:z,.0f} km {'right' if right_rad > 0.0 else 'left'}"],
        show_labels=True,
        radii=rr.Radius.ui_points(0.01),
    )
    stage.still(f"{path}/name", name)


def _directions(truth: Rows) -> tuple[F8, F8]:
    fields = ("lon_rad", "lat_rad", "flight_path_angle_rad", "heading_rad", "bank_rad")
    velocity, lift = velocity_and_lift(*(truth[name] for name in fields))
    if "lift_mps2" in (truth.dtype.names or ()):
        lift = lift * np.where(truth["lift_mps2"] < 0.0, -1.0, 1.0)[:, None]
    return velocity, lift


def draw_vehicle(stage: Stage, label: str, truth: Rows, body: Body, look: Palette) -> None:
    """The vehicle as it moves, with the directions of its velocity and its lift."""
    path = f"{PATH}/flights/{part(label)}"
    rr = stage.rr
    t_s, sites = truth["t_s"], track_km(truth, body.radius_km)
    stage.dots_3d(f"{path}/vehicle", t_s, sites)
    dot = rr.Points3D.from_fields(colors=[look.flown], radii=rr.Radius.ui_points(5.0))
    stage.still(f"{path}/vehicle", dot)
    if not set(ATTITUDE) <= set(truth.dtype.names or ()):
        return
    velocity, lift = _directions(truth)
    arrows = {
        "velocity": (velocity * VELOCITY_SHARE, VELOCITY),
        "lift": (lift * LIFT_SHARE, LIFT if look.is_alone else look.commanded),
    }
    for name, (vectors, colour) in arrows.items():
        stage.arrows(f"{path}/{name}", t_s, sites, vectors * body.radius_km)
        style = rr.Arrows3D.from_fields(
            colors=[colour], radii=rr.Radius.ui_points(1.6), labels=[name], show_labels=False
        )
        stage.still(f"{path}/{name}", style)


class Site(NamedTuple):
    """A place or a region that the mission names, in radians."""

    kind: str
    name: str
    lon_rad: float
    lat_rad: float
    outline: F8 | None
    """Longitudes and latitudes of its edge, closed."""


def sites_of(tables: Mapping[str, Any], radius_km: float) -> list[Site]:
    """Target, way-points and no-fly zones of a mission file; what is no place is passed over."""
    found = []
    for kind, key in (("target", "target"), ("way-point", "waypoints"), ("zone", "no_fly_zones")):
        entries = tables.get(key, [])
        entries = [entries] if isinstance(entries, dict) else entries
        for number, entry in enumerate(entries if isinstance(entries, list) else [], start=1):
            name = kind if key == "target" else f"{kind} {number}"
            found += list(_place(kind, name, entry, radius_km))
    return found


def _place(kind: str, name: str, entry: Any, radius_km: float) -> Iterator[Site]:
    """A point, a circle of `radius_km`, or a polygon given by lists of its corners."""
    if not isinstance(entry, dict):
        return
    lon: Any = entry.get("longitude_deg")
    lat: Any = entry.get("latitude_deg")
    name = str(entry.get("name") or name)
    try:
        lons, lats = np.radians(np.atleast_1d(lon)), np.radians(np.atleast_1d(lat))
        reach_km = float(entry.get("radius_km", 0.0))
    except (TypeError, ValueError):
        return
    if len(lons) != len(lats) or not len(lons) or not np.isfinite([*lons, *lats]).all():
        return
    outline = None
    if len(lons) > 2:
        outline = np.stack([np.append(lons, lons[0]), np.append(lats, lats[0])], axis=-1)
    elif reach_km > 0.0:
        outline = circle(lons[0], lats[0], reach_km / radius_km)
    yield Site(kind, name, float(lons.mean()), float(lats.mean()), outline)


def draw_sites(stage: Stage, sites: list[Site], body: Body) -> None:
    """Target, way-points and zones with their names."""
    rr = stage.rr
    drawn: list[str] = []
    for site in sites:
        path = f"{PATH}/{site.kind}s/{part(site.name)}"
        drawn.append(path)
        path += f"_{n}" if (n := drawn.count(path)) > 1 else ""
        colour = ZONE if site.kind == "zone" else TARGET
        at = positions(np.array([site.lon_rad]), np.array([site.lat_rad]), body.radius_km)
        size = 0.01 if site.kind == "zone" else 6.0
        dot = rr.Points3D(
            at * LIFTED,
            colors=[colour],
            labels=[site.name],
            show_labels=True,
            radii=rr.Radius.ui_points(size),
        )
        stage.still(path, dot)
        if site.outline is not None:
            lons, lats = site.outline[:, 0], site.outline[:, 1]
            edge = positions(lons, lats, body.radius_km * LIFTED)
            line = rr.LineStrips3D([edge], colors=[colour], radii=rr.Radius.ui_points(1.4))
            stage.still(f"{path}/outline", line)


def track_ahead(truth: Rows, body: Body) -> F8:
    """The great circle that lies ahead of a state: where a flight from there may well go."""
    here = track_km(truth[:1], body.radius_km)[0]
    east, north, _ = east_north_up(truth["lon_rad"][:1], truth["lat_rad"][:1])
    heading = float(truth["heading_rad"][0])
    ahead = (math.sin(heading) * east[0] + math.cos(heading) * north[0]) * np.linalg.norm(here)
    angle = np.linspace(0.0, AHEAD_RAD, 20)[:, None]
    return np.asarray(np.cos(angle) * here + np.sin(angle) * ahead)


def eye(track: F8, body: Body) -> tuple[F8, F8, F8]:
    """Where to look from, what at, and what is up: the whole track from its side."""
    chord = track[-1] - track[0]
    between = track[0] + track[-1]
    half_way = float(np.linalg.norm(between))
    up = (between if half_way > 0.0 else track[0]) / (half_way or float(np.linalg.norm(track[0])))
    middle = up * float(np.linalg.norm(track[len(track) // 2]))
    along = chord - (chord @ up) * up
    length = float(np.linalg.norm(along))
    along = along / length if length > 0.0 else np.cross(up, [0.0, 0.0, 1.0])
    right = np.cross(along, up)
    if right[2] > 0.0:  # look northwards: what is left on a map is left here
        right = -right
    away = max(length, 0.08 * body.radius_km)
    position = middle + EYE_UP * away * up + EYE_ASIDE * away * right
    return position, middle, up
