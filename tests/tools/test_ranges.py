"""One quantity has one range: in mission and design files, in the load image, and on the bus."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flight_sw import icd
from flight_sw.errors import AeroshellError, DesignError, LoadError, MissionError
from flight_sw.guidance import LAWS
from flight_sw.load_image import body_spec
from flight_sw.records.fields import Field, RecordSpec
from sim_harness.mission.errors import annotation_at
from sim_harness.mission.mission import Mission, find, leaf_keys, read_toml
from sim_harness.mission.quantities import Quantity, Section, Series
from sim_harness.world.missions import load_mission
from tools.gains.body import fill_body
from tools.gains.design import Design, design_of, read_tree
from tools.overrides import with_values

GAINS = Path(__file__).parents[2] / "gains"
MISSIONS = ("hyperion-1", "mars-lander")
IN_SI = (
    ("_kwpm2", "_wpm2", 1e3),
    ("_degps2", "_radps2", math.pi / 180.0),
    ("_degps", "_radps", math.pi / 180.0),
    ("_deg", "_rad", math.pi / 180.0),
    ("_km", "_m", 1e3),
    ("", "", 1.0),
)
OTHER_QUANTITIES = {  # names that stand for another thing on the other side
    ("navigation_flight", "rate_hz"),
    ("wind", "sigma_top_km"),
}
NOT_BUS_SPEEDS = {"planet", "wind", "navigation", "heating", "atmosphere"}


def numbers(section: type[Section], raw: Any) -> Iterator[tuple[str, Quantity]]:
    """Every key of a file that takes one number, with its quantity."""
    for key in leaf_keys(section, raw):
        *parents, leaf = key.split(".")
        model = annotation_at(section, raw, tuple(parents)) if parents else section
        marks = model.model_fields[leaf].metadata
        for mark in marks:
            if isinstance(mark, Quantity) and not isinstance(mark, Series):
                yield key, mark


def fields_of(spec: RecordSpec) -> Iterator[Field]:
    """All fields of a record and of the records in it."""
    for field in spec.fields:
        if field.record is None:
            yield field
        else:
            yield from fields_of(field.record)


LOAD_FIELDS = {field.name: field for law in LAWS for field in fields_of(body_spec(law))}


def in_load(key: str) -> tuple[Field, float] | None:
    """The load's field of the same name, units turned to SI, and the unit in SI."""
    leaf = key.rsplit(".", 1)[-1]
    for unit, si, factor in IN_SI:
        name = leaf.removesuffix(unit) + si
        if leaf.endswith(unit) and name in LOAD_FIELDS:
            return LOAD_FIELDS[name], factor
    return None


def shared() -> list[tuple[str, Quantity, Field, float]]:
    """Keys of missions and designs whose quantity is a field of a load as well."""
    found = []
    for mission in MISSIONS:
        tree = read_tree(GAINS / mission / "design.toml")
        keys = [*numbers(Mission, read_toml(find(mission))), *numbers(Design, tree)]
        for key, quantity in keys:
            if (match := in_load(key)) is not None:
                found.append((key, quantity, *match))
    return found


SHARED = shared()


def test_there_are_many_quantities_that_file_and_load_share() -> None:
    assert len({key for key, *_ in SHARED}) >= 40


@pytest.mark.parametrize(("key", "quantity", "field", "si"), SHARED, ids=[s[0] for s in SHARED])
def test_a_file_and_a_load_allow_the_same(
    key: str, quantity: Quantity, field: Field, si: float
) -> None:
    low, high = quantity.low * si, quantity.high * si
    assert (low, high) == pytest.approx((field.low, field.high), rel=1e-11)


BUS = [
    ("entry.altitude_km", ("NAV_VERTICAL", "alt_m"), 1e3),
    ("target.altitude_km", ("NAV_VERTICAL", "alt_m"), 1e3),
    ("end.altitude_km", ("NAV_VERTICAL", "alt_m"), 1e3),
    ("entry.speed_mps", ("NAV_VERTICAL", "v_rel_mps"), 1.0),
    ("target.speed_mps", ("NAV_VERTICAL", "v_rel_mps"), 1.0),
    ("end.speed_mps", ("NAV_VERTICAL", "v_rel_mps"), 1.0),
    ("modes.terminal_speed_mps", ("NAV_VERTICAL", "v_rel_mps"), 1.0),
    ("drag.active_drag_mps2", ("NAV_AERO", "drag_mps2"), 1.0),
    ("drag.observed_drag_mps2", ("NAV_AERO", "drag_mps2"), 1.0),
    ("entry.longitude_deg", ("NAV_POSITION", "lon_rad"), math.pi / 180.0),
    ("entry.latitude_deg", ("NAV_POSITION", "lat_rad"), math.pi / 180.0),
    ("entry.flight_path_angle_deg", ("NAV_DIRECTION", "flight_path_angle_rad"), math.pi / 180.0),
    ("entry.bank_deg", ("NAV_ATTITUDE", "bank_rad"), math.pi / 180.0),
    ("entry.angle_of_attack_deg", ("NAV_ATTITUDE", "alpha_rad"), math.pi / 180.0),
    ("limits.bank.high_deg", ("FSW_COMMAND", "bank_cmd_rad"), math.pi / 180.0),
    ("limits.alpha.low_deg", ("FSW_COMMAND", "alpha_cmd_rad"), math.pi / 180.0),
    ("end.time_max_s", ("NAV_TIME", "t_s"), 1.0),
]


@pytest.mark.parametrize(("key", "signal", "si"), BUS, ids=[b[0] for b in BUS])
def test_no_file_allows_what_the_bus_cannot_carry(
    key: str, signal: tuple[str, str], si: float
) -> None:
    mission = "mars-lander"  # it has a target
    tree = read_tree(GAINS / mission / "design.toml")
    known = dict([*numbers(Mission, read_toml(find(mission))), *numbers(Design, tree)])
    low, high = icd.signal_range(*signal)
    quantity = known[key]
    assert quantity.high * si <= high
    assert quantity.low * si >= low or quantity.low == -math.inf  # -inf: no such end


def ends(section: type[Section], raw: Any) -> list[tuple[str, float]]:
    """Every key with either end of its range."""
    return [
        (key, end)
        for key, quantity in numbers(section, raw)
        for end in (quantity.low, quantity.high)
        if math.isfinite(end)
    ]


@pytest.mark.parametrize(("key", "end"), ends(Mission, read_toml(find("hyperion-1"))))
def test_a_load_takes_whatever_a_mission_may_say(key: str, end: float) -> None:
    design = design_of(read_tree(GAINS / "hyperion-1" / "design.toml"), "design.toml")
    try:
        mission = load_mission("hyperion-1", {key: end})
        body = fill_body("nominal", design, mission).body
    except (MissionError, DesignError):
        return  # refused by a rule between keys, in a sentence of the file
    body_spec("nominal").check(body[0], "load")


@pytest.mark.parametrize(
    ("key", "end"), ends(Design, read_tree(GAINS / "hyperion-1" / "design.toml"))
)
def test_a_load_takes_whatever_a_design_may_say(key: str, end: float) -> None:
    mission = load_mission("hyperion-1")
    tree = read_tree(GAINS / "hyperion-1" / "design.toml")
    try:
        body = fill_body(
            "nominal", design_of(with_values(tree, {key: end}), "design"), mission
        ).body
    except DesignError:
        return
    body_spec("nominal").check(body[0], "load")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"planet.radius_km": 1e6}, "planet.radius_km is 1000000, allowed 100 to 100000 km"),
        ({"planet.mu_m3ps2": 1e8}, "planet.mu_m3ps2 is 100000000, allowed 1000000000 to 1e+18"),
        ({"vehicle.reference_area_m2": 1e6}, "allowed 1e-06 to 100000 m2"),
        ({"limits.load_factor_max_g": 1e4}, "allowed 0.1 to 1000 g, or inf"),
        ({"entry.altitude_km": 400.0}, "entry.altitude_km is 400, allowed 1 to 334 km"),
        ({"entry.speed_mps": 50e3}, "entry.speed_mps is 50000, allowed 10 to 13400 m/s"),
        ({"heating.coefficient": 1e15, "heating.speed_ref_mps": 1.0}, "W/m2 at 1 kg/m3"),
        ({"vehicle.aerodynamics.n2": -50.0}, "gives C_D"),
    ],
)
def test_a_value_beyond_its_range_is_refused_by_the_mission(
    settings: dict[str, float], said: str
) -> None:
    with pytest.raises(MissionError, match=None) as refused:
        load_mission("hyperion-1", settings)
    assert said in str(refused.value)


def test_a_limit_may_be_infinite_and_nothing_else_beyond_its_range() -> None:
    assert load_mission("hyperion-1", {"limits.load_factor_max_g": math.inf})
    for value in (-math.inf, math.nan, 1e31):
        with pytest.raises(AeroshellError):
            load_mission("hyperion-1", {"limits.load_factor_max_g": value})


def test_a_load_beyond_the_shared_range_is_refused_too() -> None:
    design = design_of(read_tree(GAINS / "hyperion-1" / "design.toml"), "design.toml")
    body = fill_body("nominal", design, load_mission("hyperion-1")).body
    body["onboard"]["planet"]["radius_m"] = np.nextafter(1e8, 2e8)
    with pytest.raises(LoadError, match="radius_m"):
        body_spec("nominal").check(body[0], "load")
