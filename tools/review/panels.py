"""What is plotted over time: each panel one unit, its lines, and the limit that goes with them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from flight_sw.icd import Message, Signal
from tools.review.signals import PURE, shown, truth_name
from tools.review.stage import part

ENTRY, TRAJECTORY, GUIDANCE = "Entry", "Trajectory", "Guidance"
BUS, FLIGHTS = "Bus and timing", "Flights"

TELEMETRY_PREFIX = "TM_"
HEALTH_PREFIX = "RX_HEALTH_"
TIMING = "FSW_TIMING"
PROTECTION = ("e2e_crc", "e2e_counter")
NO_REFUSAL = ("heard", "ticked")  # what was judged, and who closed the cycle


class Line(NamedTuple):
    """One line: a field of the truth, or a signal of a message."""

    name: str
    field: str
    message: str = ""
    is_flown: bool = False
    is_commanded: bool = False


class Panel(NamedTuple):
    """One plot."""

    tab: str
    path: str
    title: str
    unit: str
    lines: tuple[Line, ...]
    limit: str = ""
    """Which of the path limits: `heat_flux`, `load_factor`, `dynamic_pressure`."""

    @property
    def heading(self) -> str:
        """Title with the unit, over mission time."""
        unit = "" if self.unit == PURE else f", {self.unit}"
        return f"{self.title}{unit}, over time"


def _truth(tab: str, field: str, limit: str = "") -> Panel:
    show = shown(field)
    title = show.title[:1].upper() + show.title[1:]
    line = Line("flown", field, is_flown=True)
    return Panel(tab, f"plots/{part(show.title)}", title, show.unit, (line,), limit)


def _angle(axis: str, title: str) -> Panel:
    return Panel(
        ENTRY,
        f"plots/{part(title)}",
        f"{title[:1].upper()}{title[1:]}",
        "deg",
        (
            Line("commanded", f"{axis}_cmd_rad", "FSW_COMMAND", is_commanded=True),
            Line("flown", f"{axis}_rad", is_flown=True),
        ),
    )


PANELS: tuple[Panel, ...] = (
    _truth(ENTRY, "heat_flux_wpm2", "heat_flux"),
    _truth(ENTRY, "load_factor_g", "load_factor"),
    _angle("bank", "bank"),
    _angle("alpha", "angle of attack"),
    _truth(TRAJECTORY, "alt_m"),
    _truth(TRAJECTORY, "v_rel_mps"),
    _truth(TRAJECTORY, "flight_path_angle_rad"),
    _truth(TRAJECTORY, "heading_rad"),
    _truth(TRAJECTORY, "drag_mps2"),
    _truth(TRAJECTORY, "dynamic_pressure_pa", "dynamic_pressure"),
    _truth(TRAJECTORY, "mach"),
    _truth(TRAJECTORY, "heat_load_jpm2"),
    _truth(TRAJECTORY, "ground_range_m"),
)

TO_GO: tuple[Panel, ...] = (
    _truth(ENTRY, "range_to_go_m"),
    _truth(TRAJECTORY, "crossrange_to_go_m"),
)
IDLE = ("plots/heat_flux", "plots/heat_load", "plots/angle_of_attack")
"""Panels that are left out where a mission has nothing of the kind: zero from first to last."""

SATURATION = {
    "plots/bank": ("bank_saturated", "bank"),
    "plots/angle_of_attack": ("alpha_saturated", "alpha"),
}
"""Panels where saturation is marked: the flag of FSW_STATUS, and the axis."""


def unit_of(name: str) -> str:
    """The unit in which a signal is shown."""
    return shown(name).unit


def is_state(message: Message, signal: Signal) -> bool:
    """Whether a law telemeters a state by it, whose values have names: no quantity to plot."""
    return message.name.startswith(TELEMETRY_PREFIX) and bool(signal.names)


def telemetry_panels(messages: Sequence[Message], truth_fields: Sequence[str]) -> list[Panel]:
    """A panel for each quantity that the law telemeters, with the truth beside what is about it."""
    by_quantity: dict[str, list[Line]] = {}
    for message in messages:
        if not message.name.startswith(TELEMETRY_PREFIX):
            continue
        for signal in message.signals:
            if signal.name not in PROTECTION and not is_state(message, signal):
                line = Line(shown(signal.name).title, signal.name, message.name)
                by_quantity.setdefault(truth_name(signal.name), []).append(line)
    found = []
    for quantity, lines in by_quantity.items():
        show = shown(quantity)
        if quantity in truth_fields:
            lines.append(Line("flown", quantity, is_flown=True))
        title = show.title if len(lines) > 1 else lines[0].name
        title = title[:1].upper() + title[1:]
        path = f"guidance/{part(quantity)}"
        found.append(Panel(GUIDANCE, path, title, show.unit, tuple(lines)))
    return found


def bus_panels(messages: Sequence[Message]) -> list[Panel]:
    """What the computer counted of the bus, and how it kept time."""
    refused = [
        Line(signal.name.replace("_", " "), signal.name, message.name)
        for message in messages
        if message.name.startswith(HEALTH_PREFIX)
        for signal in message.signals
        if signal.name not in (*PROTECTION, *NO_REFUSAL)
    ]
    panels = [
        Panel(BUS, "bus/frames", "Frames on the bus, 1/s", PURE, (Line("frames", "frames"),)),
        Panel(BUS, "bus/load", "Worst-case bus load, %", PURE, (Line("load", "bus_load"),)),
    ]
    if refused:
        title = "Frames refused or missed by the flight computer, and believed after all, count"
        panels.append(Panel(BUS, "bus/refused", title, PURE, tuple(refused)))
    for message in messages:
        if message.name == TIMING:
            names = [s.name for s in message.signals if s.name not in PROTECTION]
            for unit in dict.fromkeys(unit_of(name) for name in names):
                mine = [name for name in names if unit_of(name) == unit]
                lines = tuple(Line(shown(name).title, name, TIMING) for name in mine)
                what = "Punctuality of the flight computer"
                suffix = ", count" if unit == PURE else ""
                path = f"bus/timing_{part(unit)}"
                panels.append(Panel(BUS, path, what + suffix, unit, lines))
    return panels


LIMIT_UNITS: Mapping[str, str] = {
    "heat_flux": "heat_flux_wpm2",
    "load_factor": "load_factor_g",
    "dynamic_pressure": "dynamic_pressure_pa",
}
"""Field of PathLimits that a panel's limit is."""
