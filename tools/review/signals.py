"""How a signal is shown: its name in words, its unit, and the factor from SI to that unit."""

import math
import re
from typing import NamedTuple

UNITS: dict[str, tuple[float, str]] = {
    "rad": (math.degrees(1.0), "deg"),
    "rads": (math.degrees(1.0), "deg s"),
    "radps": (math.degrees(1.0), "deg/s"),
    "radps2": (math.degrees(1.0), "deg/s²"),
    "wpm2": (1e-3, "kW/m²"),
    "wpm2ps": (1e-3, "kW/m²/s"),
    "jpm2": (1e-6, "MJ/m²"),
    "jpkg": (1e-6, "MJ/kg"),
    "pa": (1e-3, "kPa"),
    "m": (1e-3, "km"),
    "mps": (1.0, "m/s"),
    "mps2": (1.0, "m/s²"),
    "mps3": (1.0, "m/s³"),
    "kgpm3": (1.0, "kg/m³"),
    "g": (1.0, "g"),
    "s": (1.0, "s"),
    "us": (1.0, "µs"),
    "hz": (1.0, "Hz"),
}
"""The unit at the end of a name: factor and unit to show."""

PURE = "-"
WORDS = {
    "cmd": "commanded", "alt": "altitude", "v rel": "speed", "v error": "speed error",
    "alpha": "angle of attack", "lat": "latitude", "lon": "longitude", "est": "estimated",
    "ref": "reference", "rho": "density",
}  # fmt: skip
QUALIFIERS = {
    "cmd", "est", "estimated", "estimate", "ref", "reference", "nominal", "observed", "obs",
    "measured", "filtered", "model", "plan", "planned", "predicted", "hat", "used",
}  # fmt: skip
"""Words that say which value of a quantity is meant: without them the name is that of the truth."""


class Shown(NamedTuple):
    """A signal as people read it."""

    title: str
    unit: str
    factor: float

    @property
    def label(self) -> str:
        """Title and unit."""
        return self.title if self.unit == PURE else f"{self.title}, {self.unit}"


def shown(name: str) -> Shown:
    """A name of ours, `heat_flux_error_wpm2`, as `heat flux error`, kW/m², 1e-3."""
    quantity, _, ending = name.rpartition("_")
    factor, unit = UNITS.get(ending, (1.0, PURE)) if quantity else (1.0, PURE)
    words = (quantity if unit != PURE else name).replace("_", " ")
    for short, long in WORDS.items():
        words = re.sub(rf"\b{short}\b", long, words)
    return Shown(words, unit, factor)


def truth_name(name: str) -> str:
    """The field of the truth that a telemetered value is about: its name without qualifiers."""
    return "_".join(word for word in name.split("_") if word not in QUALIFIERS)
