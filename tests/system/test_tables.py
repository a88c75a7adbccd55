"""The tables of the paper: every set point, both laws, flown in memory through the bus frames.

The bars are those an honest reproduction reaches: the paper states neither aerodynamics nor end.
"""

import functools
import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from flight_sw.load_image import activate, image_bytes, parse_image
from sim_harness.flight.summary import summary_of
from tests.system.flights import MISSION, ROOT, Computer, World, built, flown

pytestmark = pytest.mark.jit_only

SET_POINTS = (1500.0, 1600.0, 1700.0, 1800.0, 1900.0)  # kW/m2
TABLES = {  # [MOOIJ18] Tables 1 and 2: heat load MJ/m2, ground range km
    "nominal": ((1353.3, 6703.1), (1297.8, 6103.8), (1278.8, 5743.1), (1250.9, 5541.6),
                (1229.4, 5390.2)),
    "lqy": ((1353.8, 6724.5), (1295.0, 6099.5), (1268.8, 5696.5), (1215.8, 5316.2),
            (1170.7, 5012.2)),
}  # fmt: skip
BARS = {"nominal": (0.02, 0.025), "lqy": (0.025, 0.035)}
OWN_BAR = 5e-4
"""Around our own values, which README shows: what the paper's bars are too wide to see.

Another processor's round-off stays within it; a change that leaves it is one of flight behaviour,
to be declared in CHANGELOG.md."""

ROW = re.compile(r"^\| 1,[5-9]00 \|(.*)\|$", re.MULTILINE)
LQY_RMS_BARS = (0.015, 0.02)
NATURAL_PEAK_KWPM2, PEAK_BAR_KWPM2 = 1700.5, 6.0
Summaries = Callable[[str, float], dict[str, Any]]
CASES = [(law, i) for law in TABLES for i in range(len(SET_POINTS))]


@pytest.fixture(scope="module")
def fly(tmp_path_factory: pytest.TempPathFactory) -> Summaries:
    """The summary of a flight by law and set point, flown once."""
    folder = tmp_path_factory.mktemp("loads")

    @functools.cache
    def summary(law: str, set_point: float) -> dict[str, Any]:
        made = built(law, heat_flux_max_kwpm2=set_point)
        return summary_of(flown(made, folder / f"{law}-{set_point:g}.load"))

    return summary


def errors(fly: Summaries, law: str, i: int) -> tuple[float, float]:
    """Relative differences of heat load and range from the paper."""
    summary = fly(law, SET_POINTS[i])
    heat_load, ground_range = TABLES[law][i]
    return (
        summary["heat_load_mjpm2"] / heat_load - 1.0,
        summary["ground_range_km"] / ground_range - 1.0,
    )


@pytest.mark.parametrize(("law", "i"), CASES)
def test_heat_load_and_range_are_those_of_the_paper(fly: Summaries, law: str, i: int) -> None:
    heat_load, ground_range = errors(fly, law, i)
    assert abs(heat_load) <= BARS[law][0]
    assert abs(ground_range) <= BARS[law][1]


def own(law: str, i: int) -> tuple[float, float]:
    """Heat load and range in README's tables of what was flown: Table 1, then Table 2."""
    rows = ROW.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(rows) == len(CASES)
    cells = [float(x.replace(",", "").rstrip(" %")) for x in rows[CASES.index((law, i))].split("|")]
    assert (cells[0], cells[3]) == TABLES[law][i]  # the paper's, in the same row
    return cells[1], cells[4]


@pytest.mark.parametrize(("law", "i"), CASES)
def test_heat_load_and_range_are_those_that_this_project_flies(
    fly: Summaries, law: str, i: int
) -> None:
    summary, (heat_load, ground_range) = fly(law, SET_POINTS[i]), own(law, i)
    assert summary["heat_load_mjpm2"] == pytest.approx(heat_load, rel=OWN_BAR)
    assert summary["ground_range_km"] == pytest.approx(ground_range, rel=OWN_BAR)


@pytest.mark.parametrize("i", [0, 2, 4])
def test_without_its_lead_the_inner_loop_flies_otherwise_than_this_project(i: int) -> None:
    """So that the bars around our own values see what the paper's do not."""
    made = built("lqy", heat_flux_max_kwpm2=SET_POINTS[i])
    body = made.image.body.copy()
    assert body["law"]["inner_loop"]["lead_s"] > 0.0
    body["law"]["inner_loop"]["lead_s"] = 0.0
    image = parse_image(image_bytes("lqy", MISSION, body), "lqy")
    world = World(made._replace(image=image, load=activate(image)), 46_000)
    world.fly(Computer(world.made), 46_000)
    flown, values = world.harness["truth"][0], own("lqy", i)
    off = (flown["heat_load_jpm2"] / 1e6 / values[0] - 1.0,
           flown["ground_range_m"] / 1e3 / values[1] - 1.0)  # fmt: skip
    assert max(map(abs, off)) > 2.0 * OWN_BAR, off


def test_the_lqy_table_is_met_on_the_whole(fly: Summaries) -> None:
    found = np.array([errors(fly, "lqy", i) for i in range(len(SET_POINTS))])
    rms = np.sqrt((found**2).mean(axis=0))
    assert rms[0] <= LQY_RMS_BARS[0]
    assert rms[1] <= LQY_RMS_BARS[1]


@pytest.mark.parametrize("law", list(TABLES))
@pytest.mark.parametrize("quantity", ["heat_load_mjpm2", "ground_range_km", "flight_time_s"])
def test_a_higher_set_point_means_less_heat_and_less_range(
    fly: Summaries, law: str, quantity: str
) -> None:
    values = [fly(law, set_point)[quantity] for set_point in SET_POINTS]
    assert values == sorted(values, reverse=True)
    assert len(set(values)) == len(values)


@pytest.mark.parametrize("quantity", ["heat_load_mjpm2", "ground_range_km"])
def test_the_inner_loop_lowers_heat_and_range_where_the_paper_says_so(
    fly: Summaries, quantity: str
) -> None:
    for set_point in SET_POINTS:
        ratio = fly("lqy", set_point)[quantity] / fly("nominal", set_point)[quantity]
        if set_point >= 1700.0:
            assert ratio < 1.0, set_point
        else:
            assert ratio == pytest.approx(1.0, abs=0.015), set_point


def test_the_inner_loop_keeps_the_heat_flux_nearer_to_its_limit(fly: Summaries) -> None:
    for set_point in SET_POINTS[:3]:  # above, the constant is scaled and the limit never reached
        error = {law: fly(law, set_point)["heat_flux_error_mjpm2"] for law in TABLES}
        assert error["lqy"] < 0.5 * error["nominal"], set_point


@pytest.mark.parametrize("law", list(TABLES))
def test_the_natural_peak_is_the_papers(fly: Summaries, law: str) -> None:
    # A set point above the peak leaves everything before it untouched.
    peak = fly(law, 1900.0)["heat_flux_max_before_activation_kwpm2"]
    assert peak == pytest.approx(NATURAL_PEAK_KWPM2, abs=PEAK_BAR_KWPM2)


@pytest.mark.parametrize(("law", "i"), CASES)
def test_flights_end_as_planned_with_nothing_refused(fly: Summaries, law: str, i: int) -> None:
    summary = fly(law, SET_POINTS[i])
    assert summary["outcome"] == "end condition"
    assert summary["final_speed_mps"] == pytest.approx(2379.0, abs=0.5)
    assert summary["frames_rejected"] == 0
    assert summary["incomplete_sets"] == 0
    assert summary["without_fix_s"] == 0.0
    assert summary["load_factor_over_s"] == 0.0  # below 5 g
    assert summary["bank_reversals"] == 0
    assert (
        summary["frames_sent"] == 7 * summary["minor_frames"] + 2
    )  # one set a cycle, two requests


def test_the_tracked_part_of_the_flight_looks_as_the_reproduction_tells() -> None:
    world = World(built("lqy"), 46_000)
    world.fly(Computer(world.made), 46_000)
    truth = world.truth
    speed, bank_deg = truth["v_rel_mps"], np.degrees(truth["bank_rad"])
    settled = (speed < 7350.0) & (speed > 5000.0)  # to where the load limit takes over
    assert np.abs(truth["heat_flux_wpm2"][settled] / 1.7e6 - 1.0).max() < 0.05
    # About 85 to 95 deg at first, a minimum of 60 deg or more.
    assert 60.0 < bank_deg[settled].min() < 75.0
    assert 80.0 < bank_deg[settled & (speed > 7200.0)].mean() < 95.0
    assert truth["load_factor_g"].max() < 5.0
    # A bank of one sign turns the vehicle from east to south and almost to west.
    assert abs(math.degrees(truth["heading_rad"][-1])) == pytest.approx(180.0, abs=10.0)
