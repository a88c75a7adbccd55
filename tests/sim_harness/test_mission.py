"""Missions load, and what cannot be flown is refused in one sentence that names file and key."""

import math
import tomllib

import numpy as np
import pytest

from flight_sw.errors import MissionError
from flight_sw.model.atmosphere import density
from sim_harness.mission import reference as mission_reference
from sim_harness.mission.mission import SHIPPED, Mission, list_missions
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.missions import load_mission
from sim_harness.world.records import OUTCOMES
from tests.sim_harness.flights import fly

TEXT = (SHIPPED / "hyperion-1.toml").read_text(encoding="utf-8")


@pytest.fixture
def own(tmp_path):
    """Writes hyperion-1 with a piece of its text exchanged, returns the path."""

    def write(old: str = "", new: str = ""):
        assert old in TEXT
        path = tmp_path / "own.toml"
        path.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
        return path

    return write


def refusal_of(path, overrides=None) -> str:
    with pytest.raises(MissionError) as caught:
        load_mission(path, overrides)
    return str(caught.value)


def test_hyperion_is_the_papers_vehicle_in_si():
    mission = load_mission("hyperion-1")
    world, truth = world_of(mission)[0], truth_of(mission)[0]
    assert world["dt_s"] == 0.02
    assert world["planet"]["g0_mps2"] == 9.81
    assert world["aerodynamics"]["mass_kg"] == 450.0
    assert truth["alt_m"] == pytest.approx(119_810.0)
    assert truth["v_rel_mps"] == 7782.5
    assert math.degrees(truth["lon_rad"]) == pytest.approx(-119.5)
    assert math.degrees(truth["lat_rad"]) == pytest.approx(7.56)
    assert math.degrees(truth["flight_path_angle_rad"]) == pytest.approx(-2.87)
    assert math.degrees(truth["heading_rad"]) == pytest.approx(90.18)
    assert math.degrees(truth["alpha_rad"]) == pytest.approx(45.0)
    # [MOOIJ18] Eq. 7 as 1.9495e-4 sqrt(rho/R_N) V^3
    want = 1.9495e-4 * math.sqrt(truth["rho_kgpm3"] / 0.238) * 7782.5**3
    assert truth["heat_flux_wpm2"] == pytest.approx(want, rel=1e-4)


def test_every_shipped_mission_loads_under_its_name():
    found = list_missions()
    assert "hyperion-1" in [shipped.name for shipped in found]
    for shipped in found:
        mission = load_mission(shipped.name)
        assert mission.name == shipped.name
        assert mission.title == shipped.title
        assert world_of(mission).flags.writeable is False


@pytest.mark.jit_only
def test_a_mission_of_ones_own_flies_from_its_path(own):
    mission = load_mission(own("mass_kg = 450.0", "mass_kg = 900.0"))
    world, truth = world_of(mission), truth_of(mission)
    assert world["aerodynamics"]["mass_kg"][0] == 900.0
    assert OUTCOMES[fly(world, truth, 0.0, math.radians(45.0), 100_000)] == "end condition"


def test_gains_folder_is_relative_to_the_mission_file(own):
    path = own('law = "lqy"', 'law = "lqy"\ngains = "my/gains"')
    assert load_mission(path).gains_folder == path.parent / "my" / "gains"
    assert load_mission("hyperion-1").gains_folder.parts[-2:] == ("gains", "hyperion-1")


MASS_ALLOWED = "allowed 0.001 to 10000000 kg"


@pytest.mark.parametrize(
    "old, new, sentence",
    [
        ("mass_kg = 450.0", "mass_kg = -3", f"vehicle.mass_kg is -3, {MASS_ALLOWED}"),
        ("mass_kg = 450.0", "mass_kg = nan", f"vehicle.mass_kg is nan, {MASS_ALLOWED}"),
        ("mass_kg = 450.0", "mass_kg = inf", f"vehicle.mass_kg is inf, {MASS_ALLOWED}"),
        ("mass_kg = 450.0", 'mass_kg = "450"', f'vehicle.mass_kg is "450", {MASS_ALLOWED}'),
        ("mass_kg = 450.0", "mass_kg = true", f"vehicle.mass_kg is true, {MASS_ALLOWED}"),
        ("mass_kg = 450.0", "", f"vehicle.mass_kg is missing, {MASS_ALLOWED}"),
        (
            "reference_area_m2 = 1.0",
            "reference_area_m2 = 1.0\nmas_kg = 1.0",
            "vehicle.mas_kg is not a known key, nearest is mass_kg; "
            "allowed mass_kg, reference_area_m2, side_lift_ratio, aerodynamics",
        ),
        (
            'model = "us76"',
            'model = "us77"',
            'atmosphere.model is "us77", nearest is us76; allowed exponential, us76, table',
        ),
        (
            'model = "us76"',
            "",
            "atmosphere.model is missing; allowed exponential, us76, table",
        ),
        (
            'model = "us76"',
            'model = "us76"\nscale_height_m = 7e3',
            "atmosphere.scale_height_m is not a known key; allowed density_factor, "
            "density_sigma_ground_ratio, density_sigma_top_ratio, density_sigma_top_km, "
            "density_correlation_km, model",
        ),
        ("n1 = 0.7976", "n1 = 1e3", "vehicle.aerodynamics.n1 is 1000, allowed -100 to 100"),
        ('"relative"', '"local"', 'entry.frame is "local", allowed relative, inertial'),
        (
            'model = "errors"',
            'model = "noisy"',
            'navigation.model is "noisy", allowed exact, errors',
        ),
        (
            'model = "errors"',
            "accel_noise_mps2 = -1.0",
            "navigation.accel_noise_mps2 is -1, allowed 0 to 1000 m/s2",
        ),
        ('"hyperion-1"', '"Hyper"', 'name is "Hyper", allowed lower-case letters, digits, . _ -'),
        (
            "low_deg = 0.0",
            "low_deg = 95.0",
            "actuators.alpha.low_deg is 95, allowed below high_deg 90",
        ),
        (
            "low_deg = 0.0",
            "low_deg = 50.0",
            "entry.angle_of_attack_deg is 45.0, allowed 50.0 to 90.0 deg by actuators.alpha",
        ),
        (
            "altitude_km = 0.0",
            "altitude_km = 130.0",
            "end.altitude_km is 130.0, allowed below entry.altitude_km 119.81",
        ),
    ],
)
def test_wrong_value_is_refused_in_one_sentence(own, old, new, sentence):
    assert refusal_of(own(old, new)) == f"own.toml: {sentence}"


def test_each_of_several_errors_has_its_sentence(own):
    lines = refusal_of(own("radius_km = 6378.137", "radius_km = 1\nj3 = 1")).split("\n")
    assert [line.split(" is ")[0] for line in lines] == [
        "own.toml: planet.radius_km",
        "own.toml: planet.j3",
    ]


def test_broken_toml_names_the_line(own):
    assert "own.toml: is not TOML: " in refusal_of(own("[planet]", "[planet"))
    assert "(at line" in refusal_of(own("[planet]", "[planet"))


def test_unreadable_files_are_refused(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_bytes(b"name = '\xff'")
    assert refusal_of(path) == "bad.toml: is not UTF-8 text at byte 8"
    assert "does not exist" in refusal_of(tmp_path / "none.toml")
    assert "does not exist or is not a file" in refusal_of(f"{tmp_path}/")


def test_unknown_name_lists_what_is_shipped_and_the_nearest():
    text = refusal_of("hyperoin-1")
    assert text.startswith('mission "hyperoin-1" is not shipped, nearest is hyperion-1; allowed ')


AIR = 'model = "table"\naltitude_km = {}\ndensity_kgpm3 = {}\nsound_speed_mps = [300, 300, 300]'


@pytest.mark.parametrize(
    "alts, rhos, sentence",
    [
        ("[0, 50, 40]", "[1, 0.1, 1e-4]", "atmosphere.altitude_km value 3 is 40, allowed above 50"),
        (
            "[0, 50, 140]",
            "[1, 0.1]",
            "atmosphere has lists of [2, 3] values, allowed lists of one length",
        ),
        (
            "[0, 50, 140]",
            "[1, -1, 1e-4]",
            "atmosphere.density_kgpm3 value 2 is -1, "
            "allowed a list of 2 to 512 numbers, each 1e-30 to 1000 kg/m3",
        ),
        (
            "[0, 50, 100]",
            "[1, 0.1, 1e-4]",
            "entry.altitude_km is 119.81, allowed up to the top of the atmosphere's table, 100 km",
        ),
        (
            "[0, 50, 140]",
            "3",
            "atmosphere.density_kgpm3 is 3, "
            "allowed a list of 2 to 512 numbers, each 1e-30 to 1000 kg/m3",
        ),
    ],
)
def test_wrong_air_table_is_refused(own, alts, rhos, sentence):
    assert refusal_of(own('model = "us76"', AIR.format(alts, rhos))) == f"own.toml: {sentence}"


def test_air_may_come_from_a_csv_file_beside_the_mission(own):
    path = own('model = "us76"', 'model = "table"\ncsv = "air.csv"')
    rows = "altitude_km,density_kgpm3,temperature_k\n0,1.225,288.15\n80,1.8e-5,200\n150,2e-9,600\n"
    (path.parent / "air.csv").write_text(rows)
    air = world_of(load_mission(path))[0]["atmosphere"]
    assert air["n"] == 3
    assert math.sqrt(air["sound_speed_sq_m2ps2"][0]) == pytest.approx(340.294, abs=0.001)


@pytest.mark.parametrize(
    "rows, sentence",
    [
        (
            "altitude,rho\n",
            "air.csv: header is altitude,rho, "
            "allowed columns altitude_km, density_kgpm3, sound_speed_mps, temperature_k",
        ),
        (
            "altitude_km,density_kgpm3,temperature_k\n0,1,300\n50,x,3\n",
            'air.csv: line 3, density_kgpm3 is "x", allowed a number',
        ),
        (
            "altitude_km,density_kgpm3,temperature_k\n0,1,300\n50,1\n",
            "air.csv: line 3 has 2 values, allowed 3",
        ),
        (
            "altitude_km,density_kgpm3,temperature_k\n0,1,300\n150,nan,300\n",
            "air.csv: column density_kgpm3 value 2 is nan, "
            "allowed a list of 2 to 512 numbers, each 1e-30 to 1000 kg/m3",
        ),
    ],
)
def test_wrong_csv_is_refused(own, rows, sentence):
    path = own('model = "us76"', 'model = "table"\ncsv = "air.csv"')
    (path.parent / "air.csv").write_text(rows)
    assert refusal_of(path) == sentence


def test_aerodynamic_table_must_be_rectangular(own):
    start, end = TEXT.index('model = "newtonian"'), TEXT.index("[heating]")
    new = 'model = "table"\nangle_of_attack_deg = [0, 10]\nmach = [5]\n'
    new += "lift_coefficient = [[1], [2]]\ndrag_coefficient = [[1, 2], [2, 3]]\n"
    assert refusal_of(own(TEXT[start:end], new)) == (
        "own.toml: vehicle.aerodynamics.drag_coefficient has 2 rows of [2] values, "
        "allowed 2 rows of 1"
    )


def test_override_takes_leaf_or_dotted_key_and_text():
    mission = load_mission(
        "hyperion-1",
        {"heat_flux_max_kwpm2": "1800", "actuators.bank.rate_max_degps": 20.0, "law": "nominal"},
    )
    assert mission.limits.heat_flux_max_kwpm2 == 1800.0
    assert world_of(mission)["bank"]["rate_max_radps"][0] == pytest.approx(math.radians(20.0))
    assert mission.guidance.law == "nominal"


def test_override_of_a_model_brings_its_keys():
    mission = load_mission(
        "hyperion-1",
        {
            "atmosphere.density_ref_kgpm3": 1.225,
            "scale_height_m": 7050.0,
            "sound_speed_mps": 300.0,
            "atmosphere.model": "exponential",
        },
    )
    assert world_of(mission)["atmosphere"]["n"][0] == 2


def test_override_of_a_model_drops_what_the_other_model_said():
    shipped = {"atmosphere.model": "table", "csv": "mars-gram-average.csv", "density_factor": 1.1}
    mission = load_mission("mars-lander", {**shipped, "gas_constant_jpkgk": 188.92})
    air = world_of(mission)["atmosphere"][0]
    assert density(air, 30e3) == pytest.approx(7.659e-4, rel=1e-9)  # a row of the profile
    assert mission.atmosphere.density_factor == 1.1  # both models have it
    with pytest.raises(MissionError, match=r"scale_height_m is not a known key"):
        load_mission("mars-lander", {**shipped, "scale_height_m": 9000.0})


@pytest.mark.parametrize(
    "key, value, beginning",
    [
        (
            "heat_flux_max_kwpm",
            1.0,
            "heat_flux_max_kwpm is not a known key, nearest is limits.heat_flux_max_kwpm2; "
            "allowed are ",
        ),
        (
            "altitude_km",
            3.0,
            "altitude_km is ambiguous, allowed entry.altitude_km, target.altitude_km, "
            "end.altitude_km",
        ),
        (
            "mass_kg",
            "heavy",
            f'hyperion-1.toml with overrides: vehicle.mass_kg is "heavy", {MASS_ALLOWED}',
        ),
        (
            "heat_flux_max_kwpm2",
            "nan",
            "hyperion-1.toml with overrides: limits.heat_flux_max_kwpm2 is nan, "
            "allowed 1 to 1000000 kW/m2, or inf",
        ),
        ("planet", 3.0, "planet is not a known key"),
    ],
)
def test_wrong_override_is_refused(key, value, beginning):
    assert refusal_of("hyperion-1", {key: value}).startswith(beginning)


def test_inertial_entry_is_the_same_flight_as_the_relative_one():
    relative = truth_of(load_mission("hyperion-1"))[0]
    radius_m = 6_378_137.0 + 119_810.0
    lat, fpa, heading = relative["lat_rad"], math.radians(-2.87), math.radians(90.18)
    up, along = 7782.5 * math.sin(fpa), 7782.5 * math.cos(fpa)
    north = along * math.cos(heading)
    east = along * math.sin(heading) + 7.292115e-5 * radius_m * math.cos(lat)
    inertial = truth_of(
        load_mission(
            "hyperion-1",
            {
                "frame": "inertial",
                "entry.speed_mps": math.sqrt(up * up + north * north + east * east),
                "flight_path_angle_deg": math.degrees(math.atan2(up, math.hypot(north, east))),
                "heading_deg": math.degrees(math.atan2(east, north)),
            },
        )
    )[0]
    for name in ("v_rel_mps", "flight_path_angle_rad", "heading_rad"):
        assert inertial[name] == pytest.approx(relative[name], rel=1e-12)


def test_the_reference_of_keys_is_up_to_date():
    page = mission_reference.PAGE.read_text(encoding="utf-8")
    assert mission_reference.page(page) == page


@pytest.mark.jit_only
def test_the_example_in_the_documentation_flies(tmp_path):
    page = mission_reference.PAGE.read_text(encoding="utf-8")
    example = page.split("```toml\n")[1].split("```")[0]
    (tmp_path / "air.csv").write_text(
        "altitude_km,density_kgpm3,temperature_k\n0,1.225,288\n80,1.8e-5,199\n130,8.2e-9,469\n"
    )
    path = tmp_path / "capsule.toml"
    path.write_text(example, encoding="utf-8")
    mission = load_mission(path)
    world, truth = world_of(mission), truth_of(mission)
    assert OUTCOMES[fly(world, truth, 0.5, 0.0, 100_000)] == "end condition"
    assert truth["alt_m"][0] == pytest.approx(10e3, abs=20.0)


def test_a_mission_cannot_be_changed_after_loading():
    mission = load_mission("hyperion-1")
    with pytest.raises(ValueError, match="frozen"):
        mission.name = "other"  # type: ignore[misc]


def test_raw_shipped_file_has_no_key_left_to_default_silently():
    raw = tomllib.loads(TEXT)
    places = {"target", "waypoints", "no_fly_zones", "cases"}  # [MOOIJ18] names none
    assert set(raw) == set(Mission.model_fields) - places
    assert np.isinf(raw["actuators"]["bank"]["rate_max_degps"])
