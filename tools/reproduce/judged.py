"""Rows of a reproduction: what a paper prints, what is flown here, and the bar between them."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

Progress = Callable[[str], None]
"""Told what is being flown."""


@dataclass(frozen=True)
class Row:
    """One number beside the paper's."""

    quantity: str
    here: float | None
    unit: str = ""
    paper: str = ""
    deviation: str = ""
    bar: str = ""
    holds: bool | None = None
    """None: reported, not judged."""


@dataclass
class Part:
    """One table or batch of a paper."""

    title: str
    attribution: str
    """What the deviations come from."""
    rows: list[Row] = field(default_factory=list)


@dataclass(frozen=True)
class Reproduction:
    """All that was flown for one paper."""

    paper: str
    parts: list[Part]
    quick: bool

    @property
    def judged(self) -> list[Row]:
        """The rows that have a bar."""
        return [row for part in self.parts for row in part.rows if row.holds is not None]

    @property
    def verdict(self) -> str:
        """The last line: how many of how many hold."""
        held = sum(bool(row.holds) for row in self.judged)
        return f"{held} of {len(self.judged)} hold"

    @property
    def all_hold(self) -> bool:
        """Whether no bar was missed."""
        return all(row.holds for row in self.judged)

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return {
            "paper": self.paper,
            "quick": self.quick,
            "parts": [asdict(part) for part in self.parts],
            "hold": sum(bool(row.holds) for row in self.judged),
            "judged": len(self.judged),
            "verdict": self.verdict,
        }


def share(here: float, paper: float) -> float:
    """Relative deviation."""
    return here / paper - 1.0


def near(quantity: str, here: float, paper: float, unit: str, bar_ratio: float | None) -> Row:
    """A number that is to lie within a share of the paper's; without a bar it is reported."""
    off = share(here, paper)
    return Row(
        quantity,
        here,
        unit,
        f"{paper:z,.10g}",
        f"{off:+z.1%}",
        "" if bar_ratio is None else f"within {bar_ratio:z.1%}",
        None if bar_ratio is None else abs(off) <= bar_ratio,
    )


def close(quantity: str, here: float, paper: float, unit: str, bar: float) -> Row:
    """A number that is to lie within a distance of the paper's."""
    off = here - paper
    return Row(
        quantity, here, unit, f"{paper:z,.10g}", f"{off:+z.3g}", f"within {bar:g}", abs(off) <= bar
    )


def at_most(quantity: str, here: float, most: float, unit: str = "", paper: str = "") -> Row:
    """A number that is to be no larger than a bar."""
    return Row(quantity, here, unit, paper, "", f"at most {most:g}", here <= most)


def at_least(quantity: str, here: float, least: float, unit: str = "", paper: str = "") -> Row:
    """A number that is to be no smaller than a bar."""
    return Row(quantity, here, unit, paper, "", f"at least {least:g}", here >= least)


def claim(quantity: str, holds: bool, paper: str = "") -> Row:
    """A statement that is true or not."""
    return Row(quantity, None, "", paper, "", "is so", holds)


def told(quantity: str, here: float, unit: str = "", paper: str = "") -> Row:
    """A number that is reported and not judged."""
    return Row(quantity, here, unit, paper)


def rms(values: list[float]) -> float:
    """Root mean square."""
    return math.sqrt(sum(v * v for v in values) / len(values))
