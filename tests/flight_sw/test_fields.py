"""Record types with ranges: the dtype they make, and what their check refuses."""

import math
from typing import Any

import numpy as np
import pytest

from flight_sw.errors import LoadError
from flight_sw.records.fields import UNBOUNDED, Field, RecordSpec

INNER = RecordSpec("inner", Field("gain", -1.0, 1.0))
SPEC = RecordSpec(
    "outer",
    Field("count", 1, 4, "rows in use", kind="u4"),
    Field("grid_m", 0.0, 100.0, "grid", shape=(4,), rows="count"),
    Field("free_m"),
    Field("inner", record=INNER),
)


@pytest.fixture
def record() -> Any:
    """A record with three rows in use."""
    values = np.zeros(1, SPEC.dtype)[0]
    values["count"] = 3
    values["grid_m"] = (1.0, 2.0, 3.0, 0.0)
    return values


def test_the_dtype_is_an_aligned_struct_of_the_fields() -> None:
    assert SPEC.dtype.names == ("count", "grid_m", "free_m", "inner")
    assert SPEC.dtype.isalignedstruct
    assert SPEC.dtype["grid_m"].shape == (4,)
    assert SPEC.dtype["inner"] == INNER.dtype
    assert SPEC.dtype["count"] == np.dtype("u4")


def test_a_record_in_range_passes(record: Any) -> None:
    SPEC.check(record, "load")


@pytest.mark.parametrize("value", [-1.0, 1.0])
def test_both_ends_of_a_range_belong_to_it(record: Any, value: float) -> None:
    record["inner"]["gain"] = value
    SPEC.check(record, "load")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.5, r"load\.inner\.gain is 1\.5, allowed -1 to 1"),
        (-1.5, r"load\.inner\.gain is -1\.5, allowed"),
        (math.nan, r"load\.inner\.gain is nan, allowed"),
        (math.inf, r"load\.inner\.gain is inf, allowed"),
    ],
)
def test_a_nested_field_is_named_with_its_path(record: Any, value: float, text: str) -> None:
    record["inner"]["gain"] = value
    with pytest.raises(LoadError, match=text):
        SPEC.check(record, "load")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 2.0 * UNBOUNDED])
def test_an_unbounded_field_must_still_be_finite(record: Any, value: float) -> None:
    record["free_m"] = value
    with pytest.raises(LoadError, match=r"load\.free_m is"):
        SPEC.check(record, "load")


def test_an_element_of_an_array_is_named_by_its_index(record: Any) -> None:
    record["grid_m"][3] = 101.0
    with pytest.raises(LoadError, match=r"load\.grid_m\[3\] is 101, allowed 0 to 100"):
        SPEC.check(record, "load")


@pytest.mark.parametrize("second", [1.0, 0.5, math.nan])
def test_rows_in_use_must_ascend_strictly(record: Any, second: float) -> None:
    record["grid_m"][1] = second
    with pytest.raises(LoadError, match=r"load\.grid_m\[1\] is .*must exceed \[0\] \(1\)"):
        SPEC.check(record, "load")


def test_the_last_row_in_use_must_ascend_and_the_first_out_of_use_need_not(record: Any) -> None:
    record["grid_m"][2] = 2.0
    with pytest.raises(LoadError, match=r"grid_m\[2\]"):
        SPEC.check(record, "load")
    record["grid_m"] = (1.0, 2.0, 3.0, 3.0)
    SPEC.check(record, "load")
    record["count"] = 4
    with pytest.raises(LoadError, match=r"grid_m\[3\]"):
        SPEC.check(record, "load")


def test_a_count_beyond_the_array_is_refused(record: Any) -> None:
    record["count"] = 5
    record["grid_m"] = (1.0, 2.0, 3.0, 4.0)
    with pytest.raises(LoadError, match=r"load\.count is 5, allowed 1 to 4"):
        SPEC.check(record, "load")


def test_ranges_for_a_foreign_record_must_match_its_fields() -> None:
    foreign = np.dtype([("a_m", "f8"), ("b_m", "f8")], align=True)
    assert RecordSpec.of("both", foreign, Field("a_m"), Field("b_m")).dtype == foreign
    for fields in (
        [Field("a_m")],
        [Field("b_m"), Field("a_m")],
        [Field("a_m"), Field("b_m", kind="f4")],
    ):
        with pytest.raises(TypeError, match="both"):
            RecordSpec.of("both", foreign, *fields)
