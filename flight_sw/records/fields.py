"""Record types with an allowed range for every field: one list gives the dtype and the checks."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from flight_sw.errors import LoadError
from flight_sw.records.types_ import Record

UNBOUNDED = 1e30  # larger than any physical value here: such a field is only checked to be finite


class Field(NamedTuple):
    """One field of a record: a number, an array of them, or another record."""

    name: str
    low: float = -UNBOUNDED
    high: float = UNBOUNDED
    why: str = ""
    kind: str | np.dtype[np.void] = "f8"
    shape: tuple[int, ...] = ()
    rows: str = ""
    """Name of the field that counts the rows in use: they must be strictly ascending."""
    record: "RecordSpec | None" = None


Rule = Callable[[Record], str]
"""What must hold between fields of a record: the complaint, empty if it holds."""


class RecordSpec:
    """A named list of fields, its numpy dtype, and a check of a record against ranges and rules."""

    def __init__(self, name: str, *fields: Field, rules: tuple[Rule, ...] = ()) -> None:
        self.name = name
        self.fields = fields
        self.rules = rules
        self.dtype: np.dtype[np.void] = np.dtype(
            [(f.name, f.record.dtype if f.record else np.dtype(f.kind), f.shape) for f in fields],
            align=True,
        )

    @classmethod
    def of(
        cls, name: str, dtype: np.dtype[np.void], *fields: Field, rules: tuple[Rule, ...] = ()
    ) -> "RecordSpec":
        """Ranges for a record type that is defined elsewhere."""
        spec = cls(name, *fields, rules=rules)
        if spec.dtype != dtype:
            raise TypeError(f"{name}: fields {spec.dtype} are not those of {dtype}")
        return spec

    def check(self, record: Record, where: str) -> None:
        """Raise LoadError for the first field that is not finite, in range and ascending.

        The rules are asked last: they may rely on the ranges.
        """
        for field in self.fields:
            path = f"{where}.{field.name}"
            if field.record is not None:
                field.record.check(record[field.name], path)
                continue
            values = np.atleast_1d(np.asarray(record[field.name], dtype=np.float64)).ravel()
            if field.rows:
                self._check_rows(record, field, values, path)
            for i, value in enumerate(values):
                if not field.low <= value <= field.high:
                    place = path if values.size == 1 else f"{path}[{i}]"
                    raise LoadError(
                        f"{place} is {value:g}, allowed {field.low:g} to {field.high:g}"
                    )
        for rule in self.rules:
            if complaint := rule(record):
                raise LoadError(f"{where}.{complaint}")

    @staticmethod
    def _check_rows(record: Record, field: Field, values: np.ndarray, path: str) -> None:
        rows = int(record[field.rows])
        for i in range(1, min(rows, values.size)):
            if not values[i] > values[i - 1]:
                raise LoadError(
                    f"{path}[{i}] is {values[i]:g}, must exceed [{i - 1}] ({values[i - 1]:g})"
                )
