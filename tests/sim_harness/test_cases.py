"""Cases of a mission file: what they may hold, what is refused, and what a case then says."""

from pathlib import Path
from typing import Any

import pytest

from flight_sw.errors import MissionError
from sim_harness.mission.case_keys import case_of
from sim_harness.mission.mission import SHIPPED, differences, read_mission
from tools.overrides import prepare

SITES = """
[[waypoints]]
name = "first"
longitude_deg = 10.0
latitude_deg = 1.0

[[waypoints]]
name = "second"
longitude_deg = 20.0
latitude_deg = 2.0

[[no_fly_zones]]
longitude_deg = 30.0
latitude_deg = 3.0
radius_km = 300.0
"""
OTHER_SITES = """
[cases.north]
title = "other places"
[[cases.north.waypoints]]
name = "northern"
longitude_deg = 40.0
latitude_deg = 50.0
[[cases.north.no_fly_zones]]
longitude_deg = 41.0
latitude_deg = 51.0
radius_km = 100.0
[[cases.north.no_fly_zones]]
longitude_deg = 42.0
latitude_deg = 52.0
radius_km = 200.0

[cases.none]
title = "no places at all"
waypoints = []
no_fly_zones = []
"""


def mission_file(folder: Path, more: str) -> str:
    """The shipped mission with tables added before its cases, under another name."""
    path = folder / "own.toml"
    text = (SHIPPED / "rlv.toml").read_text(encoding="utf-8")
    path.write_text(text + more, encoding="utf-8")
    return str(path)


def with_case(folder: Path, lines: str) -> str:
    return mission_file(folder, f'\n[cases.own]\ntitle = "one\'s own"\n{lines}\n')


def refusal(path: str, **more: Any) -> str:
    with pytest.raises(MissionError) as refused:
        read_mission(path, **more)
    return str(refused.value)


def test_the_five_cases_are_those_of_table_1_of_the_source() -> None:
    cases = read_mission("rlv").cases
    latitudes_deg = [case.keys["entry.latitude_deg"] for case in cases.values()]
    assert latitudes_deg == [20.0, 15.0, 0.0, -10.0, -15.0]
    assert list(cases) == [f"case-{number}" for number in range(1, 6)]
    assert cases["case-4"].title == "latitude -10 deg"


@pytest.mark.parametrize(("lines", "words"), [
    ("entry.latitud_deg = 1.0",
     "own.toml: cases.own.entry.latitud_deg is not a known key, nearest is entry.latitude_deg"),
    ("entry.latitude_deg = 91.0",
     "own.toml, case own: entry.latitude_deg is 91, allowed -90 to 90 deg"),
    ("entry.latitude_deg = nan", "entry.latitude_deg is nan, allowed -90 to 90 deg"),
    ('entry.latitude_deg = "5"', 'entry.latitude_deg is "5", allowed -90 to 90 deg'),
    ("entry.latitude_deg = true", "entry.latitude_deg is true, allowed -90 to 90 deg"),
    ("latitude_deg = 5.0", "cases.own.latitude_deg is ambiguous, allowed entry.latitude_deg"),
    ("entry = 5.0", "cases.own.entry is not a known key"),
    ("entry = {}", "cases.own.entry is an empty table, allowed one with values"),
    ('guidance.law = "lqy"', "cases.own.guidance.law is not a case's to change"),
    ('name = "other"', "cases.own.name is not a case's to change"),
    ('law = "lqy"', "cases.own.law is not a case's to change"),
    ('dispersions.table2.sampling = "sobol"',
     "cases.own.dispersions.table2.sampling is not a known key"),
    ("design.plan.steps_a_frame = 3.0", "cases.own.design.plan.steps_a_frame is not a known key"),
    ("mass_kg = 9e4\nvehicle.mass_kg = 8e4", "cases.own.vehicle.mass_kg is given twice"),
    ("waypoints = 5.0", "own.toml, case own: waypoints is 5, allowed a list"),
    ("waypoints = [{ longitude_deg = 1.0 }]",
     "own.toml, case own: waypoints 1.latitude_deg is missing, allowed -90 to 90 deg"),
    ("entry.altitude_km = 20.0\nend.altitude_km = 30.0",
     "own.toml, case own: end.altitude_km is 30.0, allowed below entry.altitude_km 20.0"),
])  # fmt: skip
def test_a_bad_case_is_refused_whichever_is_flown(lines: str, words: str, tmp_path: Path) -> None:
    told = refusal(with_case(tmp_path, lines))
    assert words in told and "\n" not in told


@pytest.mark.parametrize(("more", "words"), [
    ('\n[cases."No Name"]\ntitle = "x"\n', 'cases.No Name is no name, allowed lower-case letters'),
    ("\n[cases.own]\nentry.latitude_deg = 5.0\n", "cases.own.title is missing, allowed a text"),
    ("\n[cases.own]\ntitle = 5\n", "cases.own.title is 5, allowed a text"),
    ("\n[cases]\nown = 5\n", "cases.own is 5, allowed a table"),
])  # fmt: skip
def test_a_case_without_name_title_or_table_is_refused(
    more: str, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "own.toml"
    text = (SHIPPED / "hyperion-1.toml").read_text(encoding="utf-8")
    path.write_text(text + more, encoding="utf-8")
    assert words in refusal(str(path))


def test_cases_that_are_no_table_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    text = (SHIPPED / "hyperion-1.toml").read_text(encoding="utf-8")
    path.write_text("cases = 5\n" + text, encoding="utf-8")
    assert "own.toml: cases is 5, allowed a table" in refusal(str(path))


@pytest.mark.parametrize(("mission", "name", "words"), [
    ("rlv", "case-9", 'case "case-9" is not one of rlv, nearest is case-'),
    ("rlv", "", 'case "" is not one of rlv; allowed case-1, case-2, case-3, case-4, case-5'),
    ("hyperion-1", "case-1", 'case "case-1" is not one of hyperion-1; its file has no [cases]'),
])  # fmt: skip
def test_an_unknown_case_is_refused_by_name(mission: str, name: str, words: str) -> None:
    found = read_mission(mission)
    with pytest.raises(MissionError) as refused:
        case_of(found.cases, name, found.name)
    assert words in str(refused.value)


def test_a_case_is_what_set_would_have_made() -> None:
    of_case = prepare("rlv", None, [], None, "case-5")
    by_set = prepare("rlv", None, ["entry.latitude_deg=-15"], None)
    assert of_case.mission == by_set.mission
    assert of_case.load_image == by_set.load_image
    assert (of_case.case, by_set.case) == ("case-5", None)
    assert of_case.comparable is by_set.comparable is False


def test_what_is_set_after_a_case_wins() -> None:
    found = prepare("rlv", None, ["entry.latitude_deg=7", "mass_kg=90000"], None, "case-1").mission
    assert (found.entry.latitude_deg, found.vehicle.mass_kg) == (7.0, 90000.0)


def gains_of(tmp_path: Path, lines: str) -> str:
    """A mission of one's own that flies the shipped gains, with a case."""
    path = Path(with_case(tmp_path, lines))
    text = path.read_text(encoding="utf-8")
    gains = Path(__file__).parents[2] / "gains" / "rlv"
    law = 'law = "planned-lqr"'
    path.write_text(text.replace(law, f'{law}\ngains = "{gains}"'), encoding="utf-8")
    return str(path)


def test_a_limit_in_a_case_is_told_to_the_computer(tmp_path: Path) -> None:
    path = gains_of(tmp_path, "limits.heat_flux_max_kwpm2 = 690.0")
    of_case = prepare(path, None, [], None, "own")
    by_set = prepare(path, None, ["heat_flux_max_kwpm2=690"], None)
    shipped = prepare(path, None, [], None)
    assert of_case.remade and of_case.load_image == by_set.load_image != shipped.load_image


def test_a_model_of_a_case_takes_its_keys_along_and_gives_way_to_one_that_is_set(
    tmp_path: Path,
) -> None:
    path = gains_of(
        tmp_path,
        'atmosphere = { model = "exponential", density_ref_kgpm3 = 1.2, scale_height_m = 7000.0, '
        "sound_speed_mps = 300.0, density_factor = 1.1 }",
    )
    case = prepare(path, None, [], None, "own").mission.atmosphere
    assert (case.model, case.density_factor) == ("exponential", 1.1)
    back = prepare(path, None, ["atmosphere.model=us76"], None, "own").mission.atmosphere
    assert (back.model, back.density_factor) == ("us76", 1.1)


def test_a_list_of_tables_is_replaced_whole_and_told_as_a_difference(tmp_path: Path) -> None:
    path = Path(gains_of(tmp_path, ""))
    path.write_text(path.read_text(encoding="utf-8") + SITES + OTHER_SITES, encoding="utf-8")
    own, north, none = (
        prepare(str(path), None, [], None, c).mission for c in ("own", "north", "none")
    )
    assert [w.name for w in own.waypoints] == ["first", "second"]
    assert [w.name for w in north.waypoints] == ["northern"]
    assert [z.radius_km for z in north.no_fly_zones] == [100.0, 200.0]
    assert (none.waypoints, none.no_fly_zones) == ([], [])
    assert differences(own) == {}
    assert differences(none) == {"waypoints": [], "no_fly_zones": []}
    again = read_mission(path, differences(north))
    assert again.waypoints == north.waypoints and again.no_fly_zones == north.no_fly_zones


def test_a_list_of_numbers_is_replaced_whole(tmp_path: Path) -> None:
    lines = "lift_powers = [[-0.2], [0.03]]"
    found = prepare(gains_of(tmp_path, lines), None, [], None, "own").mission
    assert found.vehicle.aerodynamics.model_dump()["lift_powers"] == ((-0.2,), (0.03,))
    assert differences(found) == {"vehicle.aerodynamics.lift_powers": ((-0.2,), (0.03,))}
