"""Kinds of values in the project's TOML files: numbers with unit and range, lists, texts, tables.

A quantity refuses NaN, text and values outside its range; infinity only passes where the range ends
in it.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from flight_sw import icd
from flight_sw.records.fields import RecordSpec
from sim_harness.mission.documents import quoted, short

INF = math.inf
NAME_PATTERN = re.compile(r"[a-z0-9][a-z0-9._-]*")
NAME_ALLOWED = "lower-case letters, digits, . _ -"


def refusal(text: str) -> PydanticCustomError:
    """An error whose text continues the sentence `file: key ...`, or the key if it starts with a
    dot."""
    return PydanticCustomError("refused", "{text}", {"text": text})


def plain(value: object) -> str:
    """A value as the mission file would show it, cut where it is long."""
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.12g}"
    return "null" if value is None else short(str(value))


def number_of(value: object) -> float:
    """What TOML calls a number, as a float; anything else as no number."""
    if not is_number(value):
        return math.nan
    try:
        return float(value)  # type: ignore[arg-type]
    except OverflowError:  # an integer beyond all floats, which is not infinity
        return math.nan


def is_number(value: object) -> bool:
    """True for what TOML calls an integer or a float."""
    return isinstance(value, int | float) and not isinstance(value, bool)


@dataclass(frozen=True)
class Quantity:
    """Unit, allowed range and meaning of a number in a mission file."""

    unit: str
    low: float
    high: float
    meaning: str
    or_inf: bool = field(default=False, kw_only=True)
    """Infinity is allowed beyond the range: there is no limit."""

    @property
    def span(self) -> str:
        """The range of one number in words."""
        unit = "" if self.unit == "-" else f" {self.unit}"
        return f"{self.low:.12g} to {self.high:.12g}{unit}{', or inf' if self.or_inf else ''}"

    def holds(self, value: float) -> bool:
        """Whether a number is allowed."""
        return self.low <= value <= self.high or (self.or_inf and value == INF)

    @property
    def allowed(self) -> str:
        """What may be written."""
        return self.span

    def check(self, value: object) -> float:
        """The value as a float, or a refusal."""
        number = number_of(value)
        if not self.holds(number):
            raise refusal(f"is {plain(value)}, allowed {self.allowed}")
        return number

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.check)


@dataclass(frozen=True)
class Series(Quantity):
    """A list of numbers, each in range; strictly ascending if it is a grid."""

    length_max: int = 512
    length_min: int = 1
    ascending: bool = False

    @property
    def allowed(self) -> str:
        """Range of each number and of their count."""
        order = ", strictly ascending" if self.ascending else ""
        counts = f"{self.length_min} to {self.length_max}"
        return f"a list of {counts} numbers, each {self.span}{order}"

    def check_list(self, value: object) -> tuple[float, ...]:
        """The values as floats, or a refusal that names the first bad one."""
        if not isinstance(value, list | tuple):
            raise refusal(f"is {plain(value)}, allowed {self.allowed}")
        if not self.length_min <= len(value) <= self.length_max:
            raise refusal(f"has {len(value)} values, allowed {self.allowed}")
        for i, item in enumerate(value):
            if not self.holds(number_of(item)):
                raise refusal(f"value {i + 1} is {plain(item)}, allowed {self.allowed}")
            if self.ascending and i > 0 and not item > value[i - 1]:
                raise refusal(
                    f"value {i + 1} is {plain(item)}, allowed above {plain(value[i - 1])}"
                )
        return tuple(number_of(item) for item in value)

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.check_list)


SI = {
    "km": 1e3,
    "kW/m2": 1e3,
    "kPa": 1e3,
    "deg": math.pi / 180.0,
    "deg/s": math.pi / 180.0,
    "deg/s2": math.pi / 180.0,
}
"""A unit of the files in SI; units that are not named are those of the records."""
DIGITS = 12  # of a range's ends in a file's unit: beyond what a conversion there and back changes


def in_unit(value_si: float, unit: str) -> float:
    """A value in SI as a file states it."""
    return float(f"{value_si / SI.get(unit, 1.0):.{DIGITS}g}")


def span_of(spec: RecordSpec, name: str, unit: str) -> tuple[float, float]:
    """The range of a field of the flight computer's load, in a file's unit."""
    found = next(known for known in spec.fields if known.name == name)
    return in_unit(found.low, unit), in_unit(found.high, unit)


def loaded(spec: RecordSpec, name: str, unit: str, meaning: str, or_inf: bool = False) -> Quantity:
    """A quantity that goes into the flight computer's load: its range is that of the field."""
    return Quantity(unit, *span_of(spec, name, unit), meaning, or_inf=or_inf)


def carried(message: str, signal: str, unit: str, meaning: str) -> Quantity:
    """A quantity that navigation reports: its range is that of the signal."""
    low, high = icd.signal_range(message, signal)
    return Quantity(unit, in_unit(low, unit), in_unit(high, unit), meaning)


@dataclass(frozen=True)
class Text:
    """A text with a test of its form."""

    meaning: str
    allowed: str = "a text"
    fits: Callable[[str], bool] = bool

    def check(self, value: object) -> str:
        """The text, or a refusal."""
        if not isinstance(value, str) or not self.fits(value):
            raise refusal(f"is {plain(value)}, allowed {self.allowed}")
        return value

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.check)


@dataclass(frozen=True)
class Meaning:
    """What a choice between words is about."""

    meaning: str


def is_name(text: str) -> bool:
    """True for what can name a mission, a law or a folder."""
    return NAME_PATTERN.fullmatch(text) is not None


@dataclass(frozen=True)
class Rows(Series):
    """A list of lists of numbers."""

    @property
    def allowed(self) -> str:
        """Range of each number and of their counts."""
        return f"1 to {self.length_max} lists of numbers, each {self.span}"

    def check_rows(self, value: object) -> tuple[tuple[float, ...], ...]:
        """The rows, or a refusal."""
        rows = Series(self.unit, self.low, self.high, self.meaning, self.length_max)
        lists = (list, tuple)
        if not isinstance(value, lists) or not all(isinstance(row, lists) for row in value):
            raise refusal(f"is not a list of lists, allowed {self.allowed}")
        if not 1 <= len(value) <= self.length_max:
            raise refusal(f"has {len(value)} lists, allowed {self.allowed}")
        return tuple(rows.check_list(row) for row in value)

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.check_rows)


class Section(BaseModel):
    """A table of the mission file."""

    model_config = ConfigDict(frozen=True, extra="forbid")
