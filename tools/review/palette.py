"""Colours: of the roles of a line, of flights laid over each other, of states."""

from typing import NamedTuple

Rgba = tuple[int, int, int, int]


def _rgb(text: str) -> Rgba:
    red, green, blue = bytes.fromhex(text)
    return red, green, blue, 255


LIMIT = _rgb("f2545b")
SOFT_LIMITS = {
    "heat flux": _rgb("f2545b"),
    "load factor": _rgb("f79d5c"),
    "dynamic pressure": _rgb("d98ce0"),
    "equilibrium glide": _rgb("5fd3a3"),
}
AXIS_RGBA = _rgb("a9b2bd")
GRID_RGBA = (70, 78, 88, 255)
TEXT = _rgb("dfe5ec")
TARGET = _rgb("ffe66d")
ZONE = _rgb("f2545b")
COAST_RGBA = _rgb("9fb8a0")
GRATICULE_RGBA = (96, 124, 150, 110)
FLIGHTS = tuple(
    _rgb(text)
    for text in (
        "4cc9f0", "ffb703", "8ac926", "ff6b9d", "b28dff", "ff924c", "52d1b8", "d4d4d4",
        "6f9cff", "e9d758",
    )
)  # fmt: skip
PLANNED = _rgb("8f5bff")
COMMANDED, SATURATED, LIFT, VELOCITY = _rgb("ffb703"), _rgb("ff3df0"), _rgb("8ac926"), TEXT
OTHERS = (*FLIGHTS[1:], FLIGHTS[0])

STATES: dict[str, Rgba] = {
    "STANDBY": (104, 112, 122, 255),
    "COAST": _rgb("3a78b5"),
    "ENTRY": _rgb("2f9e5b"),
    "TERMINAL": _rgb("c98a1b"),
    "SAFE": _rgb("d1373f"),
    "off": (74, 82, 92, 255),
    "on": _rgb("2f9e5b"),
    "saturated": _rgb("c026b3"),
    "free": (74, 82, 92, 255),
    "lost": _rgb("d1373f"),
    "OK": _rgb("2f9e5b"),
}
PHASES = tuple(_rgb(t) for t in ("5b6bb5", "2f8f9e", "8a5bb5", "b5745b", "5b9e6a", "9e8f2f"))


def mixed(colour: Rgba, other: Rgba, share: float) -> Rgba:
    """A colour with a share of another."""
    red, green, blue = (
        round(a + (b - a) * share) for a, b in zip(colour[:3], other[:3], strict=True)
    )
    return red, green, blue, colour[3]


def faded(colour: Rgba, alpha: int) -> Rgba:
    """A colour that lets shine through."""
    return colour[0], colour[1], colour[2], alpha


class Palette(NamedTuple):
    """The colours of one flight."""

    flown: Rgba
    commanded: Rgba
    margin: Rgba
    is_alone: bool
    planned: Rgba = PLANNED

    def plan_of(self, number: int) -> Rgba:
        """Of a planned track; of further ones ever darker."""
        return mixed(self.planned, (0, 0, 0, 255), min(0.3 * number, 0.6))

    def other(self, number: int) -> Rgba:
        """Of a further line in the same plot."""
        if self.is_alone:
            return OTHERS[number % len(OTHERS)]
        return mixed(self.flown, (255, 255, 255, 255), 0.3 + 0.25 * (number % 3))


def palette(number: int, flights: int) -> Palette:
    """A single flight has a colour a role; several have a hue each."""
    flown = FLIGHTS[number % len(FLIGHTS)]
    if flights == 1:
        return Palette(flown, COMMANDED, faded(flown, 60), True)
    lighter = mixed(flown, (255, 255, 255, 255), 0.55)
    return Palette(flown, lighter, faded(flown, 40), False, mixed(flown, (128, 128, 128, 255), 0.6))
