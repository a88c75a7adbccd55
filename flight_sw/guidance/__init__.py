"""The guidance laws: a module each, and the one place that lists them.

A law module has DESIGN and STATE (RecordSpec), PHASES and TELEMETRY (names), FIRST_PHASE (of
telemetry that is not formed from the beginning), and a kernel `step(load, state, nav, out) ->
status`. The law a computer runs is chosen by the type of its load:
`law_step` is resolved when the minor frame is compiled, so that a computer holds one law's code.
"""

from types import ModuleType
from typing import Any

from numba.extending import overload

from flight_sw.errors import LoadError
from flight_sw.guidance.drag import by_observer as drag_observer
from flight_sw.guidance.drag import by_state as drag_state
from flight_sw.guidance.drag import range_predictor
from flight_sw.guidance.heat_flux import integrated, lqy, nominal, sag
from flight_sw.records.types_ import Record

LAWS: dict[str, ModuleType] = {
    "nominal": nominal,
    "lqy": lqy,
    "drag-state": drag_state,
    "drag-observer": drag_observer,
    "range-predictor": range_predictor,
    "sag": sag,
    "integrated": integrated,
}

MARKER = "law_is_"
"""A load's record type has one field of this name and its law's: two laws never share a type."""


def law_module(name: str) -> ModuleType:
    """The module of a law by its name."""
    if name not in LAWS:
        raise LoadError(f"law is '{name}', this computer has {', '.join(LAWS)}")
    return LAWS[name]


def _law_of(fields: Any) -> ModuleType:
    (name,) = (f.removeprefix(MARKER) for f in fields if f.startswith(MARKER))
    return LAWS[name]


def law_step(load: Record, state: Record, nav: Record, out: Record) -> int:
    """One step of the law that the load was designed for."""
    return int(_law_of(load.dtype.names).step(load, state, nav, out))


@overload(law_step)
def _law_step(load: Any, state: Any, nav: Any, out: Any) -> Any:
    chosen = _law_of(load.fields).step

    def compiled(load: Record, state: Record, nav: Record, out: Record) -> int:
        return chosen(load, state, nav, out)

    return compiled
