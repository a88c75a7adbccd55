"""The high-gain observer: closed forms, an integrated twin, and input it must not believe."""

import functools
import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flight_sw.errors import LoadError
from flight_sw.estimation.observers import DESIGN, STATE, expect, observe
from flight_sw.records import status
from tools.gains.observer import discrete, fill_observer
from tools.gains.schema import Observer

EPS_S = 0.481  # [YANHE] section 4
PERIOD_S = 0.02
PAPER = Observer(eps_s=EPS_S, l1=2.0, l2=1.0)


class Watch:
    """An observer with its records."""

    def __init__(self, choice: Observer = PAPER, period_s: float = PERIOD_S) -> None:
        self.design = np.zeros(1, DESIGN.dtype)
        self.report = fill_observer(self.design[0], choice, period_s)
        self.state = np.zeros(1, STATE.dtype)
        self.period_s = period_s
        self.steps = 0

    def __getitem__(self, name: str) -> Any:
        return self.state[name][0]

    def step(self, measured: float, accel: float = 0.0, after: int = 1) -> int:
        """One guidance step, some periods after the last."""
        self.steps += after
        code = observe(self.design[0], self.state[0], self.steps * self.period_s, measured)
        expect(self.state[0], accel)
        return int(code)


@pytest.mark.parametrize("period_s", [0.001, 0.02, 0.25, 1.0])
def test_matrices_of_a_double_pole_are_its_closed_form(period_s: float) -> None:
    """(A + I/eps) is nilpotent: exp(A t) = exp(-t/eps) (I + (A + I/eps) t)."""
    fall = math.exp(-period_s / EPS_S)
    u = period_s / EPS_S
    transition = fall * np.array([[1.0 - u, period_s], [-u / EPS_S, 1.0 + u]])
    matrix = discrete(PAPER, period_s)
    assert matrix[:, :2] == pytest.approx(transition, rel=1e-12, abs=1e-15)
    # A constant measurement leaves (1, 0) where it is; the model's input is the integral of exp(As)
    assert matrix[:, 2] == pytest.approx([1.0, 0.0] - transition[:, 0], rel=1e-9, abs=1e-13)
    of_model = [EPS_S**2 * (1.0 - fall * (1.0 + u)), EPS_S * (2.0 - fall * (2.0 + u))]
    assert matrix[:, 4] == pytest.approx(of_model, rel=1e-6, abs=1e-13)
    assert list(matrix[:, 3]) == [0.0, 0.0]


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize(("l1", "l2"), [(2.0, 1.0), (3.0, 1.0), (1.0, 2.0), (1.98, 3.0)])
def test_steps_are_the_differential_equation(l1: float, l2: float, hold: Any) -> None:
    eps_s, period_s = 0.3, 0.1
    watch = Watch(Observer(eps_s=eps_s, l1=l1, l2=l2, hold=hold), period_s)
    rng = np.random.default_rng(20260401)
    measured, accel = float(rng.normal(0.0, 5.0)), 0.0
    x = np.array([measured, 0.0])

    def motion(t: float, s: np.ndarray, y: float, slope: float, model: float) -> list[float]:
        error = y + slope * t - s[0]
        return [s[1] + l1 / eps_s * error, model + l2 / eps_s**2 * error]

    watch.step(measured, accel)
    for _ in range(12):
        newest = float(rng.normal(0.0, 5.0))
        slope = (newest - measured) / period_s if hold == "first" else 0.0
        inputs = (measured, slope, accel)
        flown = solve_ivp(motion, (0.0, period_s), x, args=inputs, rtol=1e-11, atol=1e-12)
        x = flown.y[:, -1]
        measured, accel = newest, float(rng.normal(0.0, 5.0))
        watch.step(measured, accel)
        assert [watch["value"], watch["value_rate"]] == pytest.approx(x, rel=1e-7, abs=1e-8)


@pytest.mark.parametrize("rate_hz", [4, 50, 1000])
def test_poles_are_those_of_the_design_at_every_rate(rate_hz: int) -> None:
    watch = Watch(period_s=1.0 / rate_hz)
    assert np.array(watch.report["poles_radps"]) == pytest.approx(
        np.array([[-1.0 / EPS_S, 0.0]] * 2), abs=1e-6
    )
    design = watch.design[0]
    transition = discrete(PAPER, 1.0 / rate_hz)[:, :2]
    expected = math.exp(-1.0 / rate_hz / EPS_S)
    assert np.trace(transition) == pytest.approx(2.0 * expected, rel=1e-12)
    assert design["value_from_value"] + design["rate_from_rate"] == np.trace(transition)
    assert np.linalg.det(transition) == pytest.approx(expected**2, rel=1e-10)


def test_started_at_the_first_measurement_it_does_not_peak() -> None:
    watch = Watch()
    for _ in range(200):
        watch.step(7.0)
        assert (watch["value"], watch["value_rate"]) == (7.0, pytest.approx(0.0, abs=1e-12))


def test_started_at_zero_it_peaks_at_the_closed_form() -> None:
    watch = Watch(period_s=0.001)
    watch.step(0.0)
    first = 7.0
    peak, peak_s = 0.0, 0.0
    watch.step(first)  # taken now, acts from the next step on
    start = watch.steps
    for _ in range(3000):
        watch.step(first)
        if watch["value_rate"] > peak:
            peak, peak_s = float(watch["value_rate"]), (watch.steps - start) * 0.001
    assert peak == pytest.approx(first / (math.e * EPS_S), rel=1e-5)
    assert peak_s == pytest.approx(EPS_S, abs=0.001)


def drag_mps2(t_s: float) -> tuple[float, float, float]:
    """A pulse of drag like that of an entry, with its two derivatives: 120 m/s2, width 25 s."""
    x = (t_s - 60.0) / 25.0
    d = 120.0 * math.exp(-x * x)
    return d, -2.0 * x / 25.0 * d, (4.0 * x * x - 2.0) / 625.0 * d


@functools.cache
def rates_along_a_pulse(rate_hz: int, hold: Any) -> np.ndarray:
    """Estimated rate minus the true one, every half second, once the start is forgotten."""
    watch = Watch(Observer(eps_s=EPS_S, l1=2.0, l2=1.0, hold=hold), 1.0 / rate_hz)
    errors = []
    for step in range(120 * rate_hz):
        d, d_rate, d_accel = drag_mps2(step / rate_hz)
        watch.step(d, d_accel)
        if step % (rate_hz // 2) == 0 and step >= 15 * rate_hz:
            errors.append(watch["value_rate"] - d_rate)
    return np.array(errors)


def test_rate_lags_by_its_closed_form_without_a_model_and_not_with_it() -> None:
    """Constant second derivative a: the rate lags by a l1 eps / l2."""
    for modelled, lag_s in ((False, 2.0 * EPS_S), (True, 0.0)):
        watch = Watch(period_s=0.001)
        for step in range(10_000):
            t_s = step * 0.001
            watch.step(1.5 * t_s * t_s, 3.0 if modelled else 0.0)
        assert watch["value_rate"] - 3.0 * 9.999 == pytest.approx(-3.0 * lag_s, abs=3.0 * 0.001)


@pytest.mark.parametrize("rate_hz", [50, 10, 4])
def test_every_rate_from_4_hz_follows_a_pulse_of_drag(rate_hz: int) -> None:
    """A held measurement is half a period old and ripples; D' is 4.12 m/s3 at most, D'' 0.384."""
    fast = rates_along_a_pulse(1000, "zero")
    assert np.abs(fast).max() < 0.384 * 0.0006
    period_s = 1.0 / rate_hz
    bar_mps3 = 0.384 * period_s / 2.0 + 4.12 * period_s**2 / (12.0 * EPS_S**2)
    held = np.abs(rates_along_a_pulse(rate_hz, "zero") - fast).max()
    assert 0.6 * bar_mps3 < held < bar_mps3
    assert np.abs(rates_along_a_pulse(rate_hz, "first") - fast).max() < 0.2 * held


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_noise_of_the_rate_is_what_the_provenance_says(hold: Any) -> None:
    watch = Watch(Observer(eps_s=EPS_S, l1=2.0, l2=1.0, hold=hold))
    rng = np.random.default_rng(20260402)
    rates = []
    for _ in range(20_000):
        watch.step(float(rng.normal()))
        rates.append(watch["value_rate"])
    # Correlated over 2 eps, 50 samples: 400 independent ones, 3.5 %
    assert np.std(rates) == pytest.approx(watch.report["rate_noise_1ps"], rel=0.1)


def test_noise_of_the_rate_is_the_area_under_its_response() -> None:
    """White noise through G(s) = s / (1 + eps s)^2: variance = density / (4 eps^3)."""
    watch = Watch(period_s=0.001)
    expected = math.sqrt(0.001 / (4.0 * EPS_S**3))
    assert watch.report["rate_noise_1ps"] == pytest.approx(expected, rel=1e-4)


def test_missed_steps_are_coasted_on_the_model() -> None:
    watch, whole = Watch(), Watch()
    for step in range(100):
        t_s = step * PERIOD_S
        for each in (watch, whole):
            each.step(1.5 * t_s * t_s, 3.0)
    t_s = 104 * PERIOD_S
    watch.step(1.5 * t_s * t_s, 3.0, after=5)
    for step in range(100, 105):
        whole.step(1.5 * (step * PERIOD_S) ** 2, 3.0)
    assert watch["coasted_count"] == 4
    assert watch["value_rate"] == pytest.approx(whole["value_rate"], abs=3.0 * PERIOD_S)
    assert watch["value"] == pytest.approx(whole["value"], abs=0.02)
    assert watch["starts_count"] == 1


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("missed", [1, 3, 8])
def test_the_last_measurement_is_held_a_period_then_the_model_makes_a_parabola(
    hold: Any, missed: int
) -> None:
    """The newest belongs to the end of the gap: nothing of it may reach the estimate."""
    eps_s, period_s, accel = 0.3, 0.1, 7.0
    watch = Watch(Observer(eps_s=eps_s, l1=2.0, l2=1.0, hold=hold), period_s)
    watch.step(3.0, accel)
    watch.step(4.0, accel)
    before = float(watch["value"]), float(watch["value_rate"])

    def motion(_: float, s: np.ndarray) -> list[float]:
        error = 4.0 - s[0]
        return [s[1] + 2.0 / eps_s * error, accel + error / eps_s**2]

    value, rate = solve_ivp(motion, (0.0, period_s), before, rtol=1e-11, atol=1e-12).y[:, -1]
    watch.step(1e4, accel, after=1 + missed)
    t_s = missed * period_s
    assert watch["value"] == pytest.approx(value + rate * t_s + accel * t_s**2 / 2.0, rel=1e-8)
    assert watch["value_rate"] == pytest.approx(rate + accel * t_s, rel=1e-8)
    assert watch["measured"] == 1e4


def test_after_a_long_gap_it_starts_afresh() -> None:
    watch = Watch(Observer(eps_s=EPS_S, l1=2.0, l2=1.0, coast_max_s=0.2))
    for measured in (1.0, 2.0, 3.0):
        watch.step(measured)
    watch.step(4.0, after=11)
    assert watch["starts_count"] == 1
    watch.step(50.0, after=12)
    assert watch["starts_count"] == 2
    assert (watch["value"], watch["value_rate"]) == (50.0, 0.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_measurement_that_is_not_finite_changes_nothing_and_counts(bad: float) -> None:
    watch = Watch()
    for measured in (1.0, 2.0, 3.0):
        watch.step(measured, 0.5)
    before = watch.state.copy()
    assert watch.step(bad, 0.5) == status.NONFINITE
    before["refused_count"] += 1
    assert watch.state.tobytes() == before.tobytes()
    assert expect(watch.state[0], bad) == status.NONFINITE
    assert (watch["value_accel"], watch["refused_count"]) == (0.5, 2)
    assert observe(watch.design[0], watch.state[0], bad, 1.0) == status.NONFINITE
    assert watch.step(4.0) == status.OK
    assert watch["coasted_count"] == 1


def test_a_step_twice_or_back_in_time_changes_nothing_and_counts() -> None:
    watch = Watch()
    for measured in (1.0, 2.0, 3.0):
        watch.step(measured)
    before = watch["value_rate"]
    assert watch.step(99.0, after=0) == status.DOMAIN
    assert watch.step(99.0, after=-1) == status.DOMAIN
    assert (watch["value_rate"], watch["refused_count"]) == (before, 2)


def test_an_estimate_that_overflows_starts_afresh() -> None:
    watch = Watch(Observer(eps_s=EPS_S, l1=2.0, l2=1.0, coast_max_s=100.0), period_s=1.0)
    watch.step(1.0, 1.7e308)
    assert watch.step(2.0, 0.0, after=50) == status.NONFINITE
    assert (watch["value"], watch["value_rate"], watch["starts_count"]) == (2.0, 0.0, 2)
    assert watch.step(2.0) == status.OK


@pytest.mark.parametrize(
    ("field", "value", "complaint"),
    [
        ("value_from_measured", 0.5, "do not balance"),
        ("value_from_rate_s", 100.0, "poles inside"),
        ("value_from_rate_s", math.nan, "allowed"),
        ("period_s", 0.0, "allowed"),
    ],
)
def test_a_damaged_design_is_refused(field: str, value: float, complaint: str) -> None:
    design = Watch().design
    DESIGN.check(design[0], "observer")
    design[field] = value
    with pytest.raises(LoadError, match=complaint):
        DESIGN.check(design[0], "observer")


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize(
    "field",
    [
        "value_from_measured",
        "value_from_newest",
        "rate_from_measured_1ps",
        "rate_from_newest_1ps",
    ],
)
def test_a_measurement_counts_as_much_at_the_end_of_a_period_as_at_its_beginning(
    hold: Any, field: str
) -> None:
    """Each input alone unbalances a design, and the other takes it up."""
    design = Watch(Observer(eps_s=0.3, l1=2.0, l2=1.0, hold=hold), 0.1).design
    DESIGN.check(design[0], "observer")
    design[field] += 0.25
    with pytest.raises(LoadError, match="do not balance"):
        DESIGN.check(design[0], "observer")
    pairs = {"measured": "newest", "newest": "measured"}
    (this,) = (word for word in pairs if word in field)
    design[field.replace(this, pairs[this])] -= 0.25
    DESIGN.check(design[0], "observer")


def balanced(transition: np.ndarray) -> Any:
    """A design with this transition, which a constant measurement leaves at rest."""
    design = np.zeros(1, DESIGN.dtype)
    design["period_s"] = 0.5
    (design["value_from_value"], design["value_from_rate_s"]) = transition[0]
    (design["rate_from_value_1ps"], design["rate_from_rate"]) = transition[1]
    design["value_from_measured"] = 1.0 - transition[0, 0]
    design["rate_from_measured_1ps"] = -transition[1, 0]
    return design[0]


@pytest.mark.parametrize(
    ("transition", "is_stable"),
    [
        ([[0.9, 0.5], [-0.02, 0.9]], True),  # a pair near 1
        ([[-0.9, 0.5], [-0.02, -0.9]], True),  # and near -1
        ([[0.5, 0.0], [0.0, -0.5]], True),
        ([[0.0, 1.0], [-0.99, 0.0]], True),  # moduli of 0.995, on the imaginary axis
        ([[0.0, 1.0], [-1.01, 0.0]], False),
        ([[1.0, 0.5], [0.0, 0.5]], False),  # a pole at 1: it never comes to the measurement
        ([[-1.0, 0.5], [0.0, 0.5]], False),
        ([[0.99, 0.5], [-0.1, 0.99]], False),  # moduli of 1.015
    ],
)
def test_an_observer_with_a_pole_on_or_beyond_the_unit_circle_is_refused(
    transition: list[list[float]], is_stable: bool
) -> None:
    matrix = np.array(transition)
    assert (np.abs(np.linalg.eigvals(matrix)).max() < 1.0) == is_stable
    if is_stable:
        DESIGN.check(balanced(matrix), "observer")
    else:
        with pytest.raises(LoadError, match="allowed poles inside 1"):
            DESIGN.check(balanced(matrix), "observer")
