"""The coastlines of the Earth, as lines and as a picture of land and sea.

Natural Earth, 1:110 million, public domain; tools/coastlines.py made the file.
"""

import functools
from pathlib import Path

import numpy as np
import numpy.typing as npt

F8 = npt.NDArray[np.float64]
FILE = Path(__file__).parent / "coastlines.txt"
STEPS_PER_DEG = 100.0
SEAM_DEG = 0.02  # what lies so near to 180 degrees was cut there by the map's edge


@functools.cache
def rings() -> tuple[F8, ...]:
    """Closed outlines of the land: longitude and latitude in degrees, one row a point."""
    found = []
    for line in FILE.read_text(encoding="ascii").splitlines():
        if not line.startswith("#"):
            steps = np.array([pair.split(",") for pair in line.split()], dtype=np.int64)
            found.append(np.cumsum(steps, axis=0) / STEPS_PER_DEG)
    return tuple(found)


def _unwrapped() -> list[F8]:
    """The outlines with longitudes that run on past 180 degrees; one around a pole goes by it."""
    found = []
    for ring in rings():
        lon = np.unwrap(ring[:, 0], period=360.0)
        points = np.stack([lon, ring[:, 1]], axis=-1)
        if abs(lon[-1] - lon[0]) > 180.0:
            pole = np.copysign(90.0, ring[:, 1].mean())
            points = np.vstack([points, [lon[-1], pole], [lon[0], pole], points[0]])
        found.append(points)
    return found


def land(width: int, height: int) -> npt.NDArray[np.bool_]:
    """Where land is, in a picture from 180 deg west to east and from north to south."""
    outlines = _unwrapped()
    turns = (np.array([turn, 0.0]) for turn in (-360.0, 0.0, 360.0))
    edges = np.concatenate(
        [
            np.concatenate([ring[:-1] + turn, ring[1:] + turn], axis=1)
            for turn in turns
            for ring in outlines
        ]
    )
    lons = (np.arange(width) + 0.5) * 360.0 / width - 180.0
    picture = np.zeros((height, width), bool)
    for row in range(height):
        lat = 90.0 - (row + 0.5) * 180.0 / height
        crossed = edges[(edges[:, 1] <= lat) != (edges[:, 3] <= lat)]
        lon_a, lat_a, lon_b, lat_b = crossed.T
        at = lon_a + (lat - lat_a) / (lat_b - lat_a) * (lon_b - lon_a)
        picture[row] = np.searchsorted(np.sort(at), lons) % 2 == 1  # inside: an odd number passed
    return picture


def shore_lines() -> list[F8]:
    """The outlines without the seam at 180 degrees, which is no coast."""
    found: list[F8] = []
    for ring in rings():
        jumps = np.abs(np.diff(ring[:, 0])) > 180.0
        on_seam = np.abs(np.abs(ring[:, 0]) - 180.0) < SEAM_DEG
        cut = jumps | (on_seam[:-1] & on_seam[1:])
        found += [piece for piece in np.split(ring, np.flatnonzero(cut) + 1) if len(piece) > 1]
    return found
