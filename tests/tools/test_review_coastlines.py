"""Coastlines: what is land, and that the maker reads TopoJSON right."""

import json

import numpy as np
import pytest

from tools.coastlines import text_of
from tools.review.coastlines import land, rings, shore_lines

LAND_SHARE = 0.292  # of the Earth's surface
LAND_TOLERANCE = 0.01  # lakes and small islands are not in a map of 1:110 million
PLACES = {
    "Munich": (11.6, 48.1, True), "Denver": (-105.0, 39.7, True), "Perth": (117.0, -32.0, True),
    "South Pole": (0.0, -89.9, True), "Chukotka beyond 180 E": (-178.5, 67.5, True),
    "Point Nemo": (-123.4, -48.9, False), "North Pole": (0.0, 89.9, False),
    "Gulf of Guinea": (0.0, 0.0, False), "Caspian Sea": (50.6, 42.0, False),
}  # fmt: skip
PICTURE = land(1440, 720)


@pytest.mark.parametrize("name", PLACES)
def test_land_is_land_and_sea_is_sea(name: str) -> None:
    lon, lat, is_land = PLACES[name]
    assert PICTURE[int((90.0 - lat) * 4), int((lon + 180.0) * 4)] == is_land


def test_as_much_of_the_surface_is_land_as_there_is() -> None:
    rows = np.cos(np.radians(90.0 - (np.arange(720) + 0.5) / 4.0))
    share = (PICTURE.mean(axis=1) * rows).sum() / rows.sum()
    assert share == pytest.approx(LAND_SHARE, abs=LAND_TOLERANCE)


def test_outlines_are_closed_and_on_the_sphere() -> None:
    assert len(list(rings())) > 100
    for ring in rings():
        assert ring[0].tolist() == pytest.approx(ring[-1].tolist())
        assert np.abs(ring[:, 0]).max() <= 180.0
        assert np.abs(ring[:, 1]).max() <= 90.0


def test_no_shore_line_jumps_over_the_map() -> None:
    assert max(np.abs(np.diff(line[:, 0])).max() for line in shore_lines()) < 30.0


def test_arcs_are_walked_both_ways_and_joined() -> None:
    square = {
        "transform": {"scale": [0.5, 0.25], "translate": [-10.0, 20.0]},
        "arcs": [[[0, 0], [4, 0], [0, 4]], [[0, 0], [0, 4], [4, 0]]],
        "objects": {"land": {"geometries": [{"type": "Polygon", "arcs": [[0, -2]]}]}},
    }
    lines = [line for line in text_of(json.dumps(square).encode()).splitlines() if line[0] != "#"]
    assert lines == ["-1000,2000 200,0 0,100 -200,0 0,-100"]
