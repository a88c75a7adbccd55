"""No axis spans less than its quantity is told apart by, and no number is a negative zero."""

import numpy as np
import pytest

from flight_sw.guidance import LAWS
from tools.campaign.tables import ROWS, shown
from tools.report.drawing import figure, spread_axis
from tools.report.words import column_numbers, number
from tools.review.signals import UNITS
from tools.spans import LEAST_SPAN, least_span, widened


@pytest.mark.parametrize("unit", [*LEAST_SPAN, "", "-"])
@pytest.mark.parametrize("middle", [-3.0, 0.0, 1e-14, 90.0, 6378.137])
def test_values_within_the_least_span_stand_in_the_middle_of_a_wider_axis(
    unit: str, middle: float
) -> None:
    least = least_span(unit, middle)
    values = middle + np.array([-0.4, 0.4]) * least
    ends = widened(*values, unit)
    assert ends is not None
    assert ends[0] <= values[0] < values[1] <= ends[1]
    assert ends[1] - ends[0] == pytest.approx(2.0 * least)


@pytest.mark.parametrize("unit", [*LEAST_SPAN, "-"])
def test_values_that_can_be_told_apart_leave_the_axis_as_it_is(unit: str) -> None:
    assert widened(5.0, 5.0 + 1.01 * least_span(unit), unit) is None


def test_every_unit_that_the_review_shows_has_its_least_span() -> None:
    assert {unit for _, unit in UNITS.values()} - {"deg/s²", "kg/m³"} <= set(LEAST_SPAN)


def test_an_axis_of_the_report_does_not_show_round_off() -> None:
    with figure(2.0) as (_, grid):
        axes = grid[0, 0]
        axes.plot([-4e-14, 0.0], [0.0, 12.0])
        spread_axis(axes, "x", "km")
        spread_axis(axes, "y", "km")
        assert axes.get_xlim() == (-LEAST_SPAN["km"], LEAST_SPAN["km"])
        assert axes.get_ylim()[1] > 12.0


@pytest.mark.parametrize("value", [-0.0, -1e-14, -4.9e-3])
def test_a_small_negative_number_has_no_sign_that_its_digits_do_not_show(value: float) -> None:
    assert shown(value) == "0.00"
    assert column_numbers([value, 100.0], 4)[0] in ("0.0", "0")
    assert not number(0.0 * value).startswith("-")


def test_a_campaign_table_has_each_metric_once() -> None:
    assert len({label for label, _, _ in ROWS}) == len({key for _, key, _ in ROWS}) == len(ROWS)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_a_law_says_of_its_own_telemetry_which_phase_forms_it(law) -> None:
    assert set(law.FIRST_PHASE) <= set(law.TELEMETRY)
    assert set(law.FIRST_PHASE.values()) <= set(range(1, len(law.PHASES)))
