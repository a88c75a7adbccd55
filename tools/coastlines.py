"""Writes tools/review/coastlines.txt from Natural Earth's land at 1:110 million.

`python -m tools.coastlines land-110m.json`, with the file of the npm package `world-atlas` (2.0.2),
a TopoJSON edition of Natural Earth 4.1.0. Natural Earth is in the public domain. Coordinates are
kept to a hundredth of a degree, 1.1 km at the equator, finer than the source is drawn.
"""

import hashlib
import json
import sys
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

from flight_sw.runtime import program
from flight_sw.runtime.streams import say, tell

OUT = Path(__file__).parent / "review" / "coastlines.txt"
STEPS_PER_DEG = 100

HEADER = """\
# Coastlines: Natural Earth 4.1.0, land, 1:110 million, public domain (naturalearthdata.com).
# Made by tools/coastlines.py from land-110m.json of the npm package world-atlas 2.0.2,
# SHA-256 {sha256}.
# A ring a line, closed: longitude,latitude in hundredths of a degree, then the steps to the next.
"""

Ring = list[tuple[int, int]]


def arc_points(topology: dict[str, Any], number: int) -> Ring:
    """The points of one arc in steps; ~number is the arc walked backwards."""
    scale, origin = topology["transform"]["scale"], topology["transform"]["translate"]
    arc = topology["arcs"][number if number >= 0 else ~number]
    lons, lats = (list(accumulate(point[axis] for point in arc)) for axis in (0, 1))
    points = [
        (
            round((lon * scale[0] + origin[0]) * STEPS_PER_DEG),
            round((lat * scale[1] + origin[1]) * STEPS_PER_DEG),
        )
        for lon, lat in zip(lons, lats, strict=True)
    ]
    return points if number >= 0 else points[::-1]


def rings(topology: dict[str, Any]) -> list[Ring]:
    """Every outline of the land, holes (inland seas) too; repeated points left out."""
    found = []
    for geometry in topology["objects"]["land"]["geometries"]:
        polygons = geometry["arcs"] if geometry["type"] == "MultiPolygon" else [geometry["arcs"]]
        for ring in (ring for polygon in polygons for ring in polygon):
            points = [point for number in ring for point in arc_points(topology, number)]
            found.append([p for i, p in enumerate(points) if i == 0 or p != points[i - 1]])
    return found


def text_of(content: bytes) -> str:
    """The file's text."""
    lines = []
    for ring in rings(json.loads(content)):
        steps = [ring[0]] + [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(ring)]
        lines.append(" ".join(f"{lon},{lat}" for lon, lat in steps))
    header = HEADER.format(sha256=hashlib.sha256(content).hexdigest())
    return header + "\n".join(lines) + "\n"


def main(arguments: list[str]) -> int:
    """Write the file from the one that is named."""
    if len(arguments) != 1:
        say("usage: python -m tools.coastlines land-110m.json")
        return 2
    OUT.write_text(text_of(Path(arguments[0]).read_bytes()), encoding="ascii")
    tell(OUT)
    return 0


if __name__ == "__main__":
    sys.exit(program.run("coastlines", lambda: main(sys.argv[1:])))
