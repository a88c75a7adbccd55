"""What navigation makes of the truth: errors of known size, correlation, age and gaps."""

import math
from typing import Any

import numpy as np
import pytest

from flight_sw import icd
from flight_sw.errors import FlightError, MissionError
from sim_harness.flight.flight import refuse_beyond_the_bus
from sim_harness.flight.navigation_watch import NavigationWatch, held_values
from sim_harness.jit import kernel
from sim_harness.world import navigation
from sim_harness.world.assembly import truth_of, world_of
from sim_harness.world.missions import load_mission
from sim_harness.world.navigation import NAV_STATE, WHOLE_SET, measure, report_truth
from tests.conftest import UNCOMPILED
from tests.sim_harness.flights import EARTH_RADIUS_M, plain_mission

REPORTS = 2_000 if UNCOMPILED else 50_000
TRUE = {
    "t_s": 30.0, "lon_rad": 0.3, "lat_rad": 0.7, "alt_m": 6e4, "v_rel_mps": 6000.0,
    "flight_path_angle_rad": -0.02, "heading_rad": 1.2, "drag_mps2": 20.0, "lift_mps2": -8.0,
    "bank_rad": 1.0, "alpha_rad": 0.5, "heat_flux_wpm2": 1.5e6,
}  # fmt: skip
DEG = math.pi / 180.0


@kernel
def many(world, truth, nav_state, values, ramp_mps3, out, gaps):
    """Reports in a row while sensed drag rises at a rate: values a row, and what was withheld."""
    for i in range(len(out)):
        measure(world, truth, nav_state, values)
        for k in range(len(values)):
            out[i, k] = values[k]
        gaps[i] = nav_state["withheld"]
        truth["drag_mps2"] += ramp_mps3 * world["dt_s"]


class Reports:
    """A number of reports of one truth, by signal."""

    def __init__(
        self, n: int = REPORTS, seed: int = 1, ramp_mps3: float = 0.0, first: int = 0, **keys: Any
    ) -> None:
        mission = plain_mission(**{f"navigation__{k}": v for k, v in keys.items()})
        self.world, truth = world_of(mission), truth_of(mission)
        for name, value in TRUE.items():
            truth[name] = value
        self.state = np.zeros(1, NAV_STATE)
        self.state["seed"], self.state["reports"] = seed, first
        self.values = np.zeros((n, icd.N_VALUES))
        self.gaps = np.zeros(n, np.int64)
        self.exact = np.zeros(icd.N_VALUES)
        report_truth(truth[0], self.exact)
        work = np.zeros(icd.N_VALUES)
        many(self.world[0], truth[0], self.state[0], work, ramp_mps3, self.values, self.gaps)

    def errors(self, channel: str) -> np.ndarray:
        """Reported minus true, in the signal's unit."""
        index = getattr(navigation, channel)
        return self.values[:, index] - self.exact[index]


NOISES = {  # key: value, and the standard deviation on each channel it acts on, as reported
    "position_noise_m": (30.0, {"LAT": 30.0 / (EARTH_RADIUS_M + 6e4)}),
    "altitude_noise_m": (25.0, {"ALT": 25.0}),
    "speed_noise_mps": (0.4, {"V_REL": 0.4}),
    "path_angle_noise_deg": (0.05, {"FLIGHT_PATH_ANGLE": 0.05 * DEG}),
    "heading_noise_deg": (0.06, {"HEADING": 0.06 * DEG}),
    "accel_noise_mps2": (0.05, {"DRAG": 0.05, "LIFT": 0.05}),
    "attitude_noise_deg": (0.2, {"BANK": 0.2 * DEG, "ALPHA": 0.2 * DEG}),
    "heat_flux_noise_kwpm2": (5.0, {"HEAT_FLUX": 5e3}),
}
CHANNELS = ("LAT", "LON", "ALT", "V_REL", "FLIGHT_PATH_ANGLE", "HEADING", "DRAG", "LIFT", "BANK",
            "ALPHA", "HEAT_FLUX")  # fmt: skip


@pytest.fixture(scope="module")
def noisy() -> Reports:
    return Reports(**{key: value for key, (value, _) in NOISES.items()})


def test_without_errors_reports_are_the_truth() -> None:
    for keys in ({}, {"model": "exact"}):
        reports = Reports(n=5, **keys)
        assert np.array_equal(reports.values, np.tile(reports.exact, (5, 1)))
        assert reports.state["saturations"].sum() == 0
    assert reports.exact[navigation.LIFT] == 8.0  # by its magnitude


@pytest.mark.parametrize("key", NOISES)
def test_noise_has_the_size_that_the_key_says(key: str, noisy: Reports) -> None:
    for channel, sigma in NOISES[key][1].items():
        error = noisy.errors(channel)
        assert abs(error.mean()) < 4.0 * sigma / math.sqrt(REPORTS)
        assert error.std() == pytest.approx(sigma, rel=4.0 / math.sqrt(2.0 * REPORTS))


def test_position_noise_is_as_wide_to_the_east_as_to_the_north(noisy: Reports) -> None:
    east_m = noisy.errors("LON") * math.cos(TRUE["lat_rad"]) * (EARTH_RADIUS_M + 6e4)
    assert east_m.std() == pytest.approx(30.0, rel=4.0 / math.sqrt(2.0 * REPORTS))


def test_noise_of_channels_and_reports_is_independent(noisy: Reports) -> None:
    errors = np.array([noisy.errors(channel) for channel in CHANNELS])
    bar = 4.5 / math.sqrt(REPORTS)
    assert np.abs(np.corrcoef(errors)[np.triu_indices(len(errors), 1)]).max() < bar
    for error in errors:
        assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < bar


def test_noise_depends_on_seed_and_report_alone(noisy: Reports) -> None:
    keys = {key: value for key, (value, _) in NOISES.items()}
    late = Reports(n=10, first=1000, **keys)
    assert np.array_equal(late.values, noisy.values[1000:1010])
    other = Reports(n=10, seed=2, **keys)
    assert not np.any(other.values[:, navigation.DRAG] == noisy.values[:10, navigation.DRAG])
    drag_alone = Reports(n=10, accel_noise_mps2=0.05)
    assert np.array_equal(drag_alone.errors("DRAG"), noisy.errors("DRAG")[:10])


def test_correlated_noise_falls_to_one_over_e_in_its_time_and_keeps_its_size() -> None:
    """0.5 s at 50 Hz: 25 reports; the sample's correlation is uncertain by its length."""
    reports = Reports(accel_noise_mps2=0.05, accel_correlation_s=0.5)
    error = reports.errors("DRAG")
    independent = REPORTS / 50.0
    assert error.std() == pytest.approx(0.05, rel=4.0 / math.sqrt(2.0 * independent))
    for lag, expected in ((1, math.exp(-1 / 25)), (25, math.exp(-1.0)), (250, 0.0)):
        found = np.corrcoef(error[lag:], error[:-lag])[0, 1]
        assert found == pytest.approx(expected, abs=4.0 / math.sqrt(independent))


def test_correlated_noise_is_as_large_at_the_first_report_as_later() -> None:
    first = [
        Reports(n=1, seed=seed, altitude_noise_m=10.0, state_correlation_s=30.0).errors("ALT")[0]
        for seed in range(400)
    ]
    assert np.std(first) == pytest.approx(10.0, rel=4.0 / math.sqrt(800.0))


@pytest.mark.parametrize(
    ("key", "value", "channel", "error"),
    [
        ("altitude_bias_m", -120.0, "ALT", -120.0),
        ("speed_bias_mps", 3.0, "V_REL", 3.0),
        ("path_angle_bias_deg", 0.3, "FLIGHT_PATH_ANGLE", 0.3 * DEG),
        ("heading_bias_deg", -0.3, "HEADING", -0.3 * DEG),
        ("drag_bias_mps2", 0.02, "DRAG", 0.02),
        ("lift_bias_mps2", -0.02, "LIFT", -0.02),
        ("bank_bias_deg", 1.0, "BANK", 1.0 * DEG),
        ("alpha_bias_deg", -1.0, "ALPHA", -1.0 * DEG),
        ("heat_flux_bias_kwpm2", 7.0, "HEAT_FLUX", 7e3),
        ("accel_scale_factor", 1.01, "DRAG", 0.2),
        ("accel_scale_factor", 1.01, "LIFT", 0.08),
        ("heat_flux_scale_factor", 0.98, "HEAT_FLUX", -3e4),
    ],
)
def test_a_constant_error_acts_on_its_channel_alone(
    key: str, value: float, channel: str, error: float
) -> None:
    reports = Reports(n=3, **{key: value})
    assert reports.errors(channel) == pytest.approx(error, rel=1e-9, abs=1e-12)
    touched = {name for name in CHANNELS if np.any(reports.errors(name) != 0.0)}
    assert channel in touched
    assert touched <= {"DRAG", "LIFT"} if key == "accel_scale_factor" else touched == {channel}


def test_a_constant_error_of_position_is_that_far_on_the_sphere() -> None:
    reports = Reports(n=1, north_bias_m=3000.0, east_bias_m=4000.0)
    lat, lon = TRUE["lat_rad"], TRUE["lon_rad"]
    lat_2, lon_2 = reports.values[0, navigation.LAT], reports.values[0, navigation.LON]
    a = math.sin((lat_2 - lat) / 2) ** 2
    a += math.cos(lat) * math.cos(lat_2) * math.sin((lon_2 - lon) / 2) ** 2
    away_m = 2.0 * (EARTH_RADIUS_M + 6e4) * math.asin(math.sqrt(a))
    assert away_m == pytest.approx(5000.0, abs=3.0)  # the parallels converge over 3 km
    assert lat_2 > lat
    assert lon_2 > lon


def test_angles_stay_angles() -> None:
    reports = Reports(n=1, heading_bias_deg=150.0, bank_bias_deg=-170.0)
    assert reports.values[0, navigation.HEADING] == pytest.approx(1.2 + 150 * DEG - math.tau)
    assert reports.values[0, navigation.BANK] == pytest.approx(1.0 - 170 * DEG)
    assert reports.state["saturations"].sum() == 0


def test_a_sensor_with_lag_is_late_by_its_time_on_a_ramp() -> None:
    """A first-order lag sampled exactly: late by dt / (1 - exp(-dt/T)) - dt, near T - dt/2."""
    reports = Reports(n=600, ramp_mps3=2.0, accel_lag_s=0.4)
    truth = TRUE["drag_mps2"] + 2.0 * 0.02 * np.arange(600)
    late_s = (truth - reports.values[:, navigation.DRAG])[-1] / 2.0
    assert late_s == pytest.approx(0.02 / -math.expm1(-0.05) - 0.02, rel=1e-6)
    assert late_s == pytest.approx(0.4 - 0.01, abs=1e-4)
    assert reports.errors("LIFT") == pytest.approx(0.0)


def test_latency_reports_what_was_true_some_reports_ago_with_the_time_of_now() -> None:
    reports = Reports(n=30, ramp_mps3=2.0, latency_s=0.1)
    truth = TRUE["drag_mps2"] + 2.0 * 0.02 * np.arange(30)
    drag = reports.values[:, navigation.DRAG]
    assert drag[5:] == pytest.approx(truth[:-5], rel=1e-14)
    assert np.all(drag[:5] == truth[0])
    assert np.all(reports.values[:, navigation.TIME] == TRUE["t_s"])


def test_latency_beyond_what_is_kept_is_refused() -> None:
    mission = plain_mission(navigation__latency_s=1.26)
    assert world_of(mission)["navigation"]["latency_reports"] == 63
    with pytest.raises(MissionError, match=r"latency_s is 1.3, allowed up to 63 reports, 1.26 s"):
        load_mission("hyperion-1", {"latency_s": 1.3})


@pytest.mark.parametrize("length_s", [0.0, 0.1])
def test_drop_outs_are_as_many_and_as_long_as_the_keys_say(length_s: float) -> None:
    reports = Reports(dropout_ratio=0.05, dropout_s=length_s)
    gone = reports.gaps != 0
    length = max(round(length_s / 0.02), 1)
    expected = 0.05 * length / (1.0 - 0.05 + 0.05 * length)
    assert gone.mean() == pytest.approx(expected, abs=4.0 * math.sqrt(expected * length / REPORTS))
    assert set(reports.gaps[gone]) == {WHOLE_SET}
    assert reports.state["dropouts"] == gone.sum()
    runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], gone.astype(int), [0]]))))[::2]
    assert set(runs[:-1] % length) == {0}  # one may follow on another
    assert runs.min() == length


def test_a_drop_out_of_a_message_takes_each_of_them_as_often() -> None:
    reports = Reports(dropout_ratio=0.2, dropout_of="message")
    found, counts = np.unique(reports.gaps[reports.gaps != 0], return_counts=True)
    assert list(found) == [1, 2, 4, 8, 16, 32]
    assert counts == pytest.approx(counts.mean(), rel=5.0 / math.sqrt(counts.mean()))


def test_what_a_signal_cannot_carry_is_held_at_its_end_and_counted() -> None:
    reports = Reports(
        n=4, drag_bias_mps2=-30.0, altitude_bias_m=9e5, path_angle_bias_deg=-90.0,
        heat_flux_scale_factor=10.0, speed_bias_mps=9000.0,
    )  # fmt: skip
    expected = {"DRAG": 0.0, "ALT": 334e3, "FLIGHT_PATH_ANGLE": -1.5707964, "HEAT_FLUX": 1.34e7,
                "V_REL": 13_400.0}  # fmt: skip
    for channel, value in expected.items():
        assert np.all(reports.values[:, getattr(navigation, channel)] == value)
    names = {"ALT": "alt_m", "FLIGHT_PATH_ANGLE": "flight_path_angle_rad",
             "HEAT_FLUX": "heat_flux_wpm2", "V_REL": "v_rel_mps"}  # fmt: skip
    assert held_values(reports.state[0]) == dict.fromkeys(names.values(), 4)
    assert reports.state["cut_off"] == 4  # drag below nothing is noise, not a signal too small


def test_each_signal_that_is_held_is_told_once() -> None:
    watch = NavigationWatch()
    assert watch.look(Reports(n=4).state[0]) == []
    high = Reports(n=4, altitude_bias_m=9e5).state
    assert watch.look(high[0]) == [
        "navigation: alt_m is beyond what NAV_VERTICAL carries, -1000 to 334000, and is held at "
        "its end"
    ]
    assert watch.look(high[0]) == []
    both = Reports(n=4, altitude_bias_m=9e5, speed_bias_mps=9000.0).state
    assert [said.split()[1] for said in watch.look(both[0])] == ["v_rel_mps"]


def test_an_entry_state_that_the_bus_cannot_carry_is_refused_with_its_signal() -> None:
    mission = load_mission(
        "hyperion-1",
        {"entry.frame": "inertial", "entry.speed_mps": 13_300.0, "heading_deg": -90.0},
    )  # westwards: over the planet, which turns eastwards, it is faster
    with pytest.raises(
        FlightError, match=r"v_rel_mps is 137\d\d.*, allowed 0 to 13400 by NAV_VERT"
    ):
        refuse_beyond_the_bus(mission, truth_of(mission)[0])


def test_model_exact_refuses_an_error() -> None:
    with pytest.raises(MissionError, match=r"accel_noise_mps2 is 0.05, allowed 0 with model exact"):
        load_mission("hyperion-1", {"navigation.model": "exact", "accel_noise_mps2": 0.05})
