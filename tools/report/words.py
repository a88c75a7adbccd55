"""Names of ours in words, their units as they are printed, and numbers to sensible digits."""

import math
import re
from typing import NamedTuple

import numpy as np

SYMBOLS = {
    "mj": "MJ", "kj": "kJ", "j": "J", "kw": "kW", "w": "W", "kpa": "kPa", "pa": "Pa", "km": "km",
    "m": "m", "kg": "kg", "deg": "deg", "rad": "rad", "hz": "Hz", "ms": "ms", "us": "µs", "s": "s",
    "g": "g", "k": "K",
}  # fmt: skip
_BASE = "|".join(sorted(SYMBOLS, key=len, reverse=True))
_PART = re.compile(rf"({_BASE})([2-9])?")
_UNIT = re.compile(rf"(1|(?:(?:{_BASE})[2-9]?)+?)((?:p(?:{_BASE})[2-9]?)*)")
_BELOW = re.compile(rf"p({_BASE})([2-9])?")
POWERS = {"2": "²", "3": "³", "4": "⁴"}
RATIO = "ratio"
DIGITS = 4
NONE = "\N{EN DASH}"  # in a cell that has no number


class Name(NamedTuple):
    """A key as people read it."""

    key: str
    title: str
    unit: str

    @property
    def label(self) -> str:
        """Title and unit."""
        return f"{self.title}, {self.unit}" if self.unit else self.title


def unit_text(ending: str) -> str:
    """`kwpm2` as kW/m²; empty where an ending is no unit."""
    parts = _UNIT.fullmatch(ending)
    if not parts:
        return ""
    above = " ".join(SYMBOLS[u] + POWERS.get(p, p) for u, p in _PART.findall(parts[1])) or "1"
    below = "".join(f"/{SYMBOLS[u]}{POWERS.get(p, p)}" for u, p in _BELOW.findall(parts[2]))
    return above + below


def name_of(key: str) -> Name:
    """`heat_flux_max_after_activation_kwpm2` as peak heat flux after activation, kW/m²."""
    words, _, ending = key.rpartition("_")
    unit = unit_text(ending) if words else ""
    title = words if unit else key
    share = title.endswith("_" + RATIO)
    title = title.removesuffix("_" + RATIO)
    title = re.sub(r"_over$", "_over_limit", title)
    if re.search(r"_max(_|$)", title):
        title = "peak_" + re.sub(r"_max(?=_|$)", "", title, count=1)
    return Name(key, title.replace("_", " ") + (" / limit" if share else ""), unit)


def key_name(key: str) -> Name:
    """A key of mission or design under its own name, with its unit."""
    words, _, ending = key.rpartition("_")
    unit = unit_text(ending) if words else ""
    return Name(key, words if unit else key, unit)


def number(value: float | int | None, digits: int = DIGITS) -> str:
    """A number to so many significant digits, whole ones of four and more as they are."""
    if value is None or not math.isfinite(value):
        return NONE if value is None or math.isnan(value) else ("∞" if value > 0 else "-∞")
    value = float(value)
    if value == round(value) and abs(value) < 1e9:
        return f"{value:z,.0f}"
    decimals = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    if abs(value) < 1e-4 or abs(value) >= 1e9:
        return f"{value:z.{digits - 1}e}"
    return f"{value:z,.{min(decimals, 6)}f}"


def column_numbers(values: "list[float | None]", digits: int = DIGITS) -> list[str]:
    """Numbers that stand together, to the same decimals: those that the largest asks for."""
    finite = [abs(v) for v in values if v is not None and math.isfinite(v)]
    largest = max(finite, default=0.0)
    if largest == 0.0 or largest >= 1e9 or largest < 1e-4:
        return [number(v, digits) for v in values]
    if all(float(v).is_integer() for v in finite):
        return [number(v) for v in values]
    decimals = min(max(digits - 1 - math.floor(math.log10(largest)), 0), 6)
    return [
        number(v)
        if v is None or not math.isfinite(v)
        else f"{np.round(v, decimals) + 0.0:z,.{decimals}f}"
        for v in values
    ]


def percent(share: float) -> str:
    """A share in percent, its digits kept where it is close to none or all."""
    if not math.isfinite(share):
        return NONE
    rest = min(share, 1.0 - share)
    decimals = (
        1 if rest >= 0.01 or rest <= 0.0 else min(max(-math.floor(math.log10(rest)) - 1, 1), 4)
    )
    return f"{100.0 * share:z.{decimals}f} %"
