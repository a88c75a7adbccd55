"""The guidance laws, a folder a family: every package in this one is a family, and has LAWS.

A law module has DESIGN and STATE (RecordSpec), PHASES and TELEMETRY (names), FIRST_PHASE (of
telemetry that is not formed from the beginning), and a kernel `step(load, state, nav, out) ->
status`. The law a computer runs is chosen by the type of its load: `law_step` is resolved when the
minor frame is compiled, so that a computer holds one law's code.

A law that has work to do before it flies has a kernel `coast(load, state, nav, has_fix, out)`
besides, which is called in every minor frame of COAST, and COAST_TELEMETRY, the names that it forms
there. EVENTS says of which telemetry the ground logs the changes (records.events.Event, by name).

What the ground designs for a family lies under the same name in tools/gains.
"""

import importlib
import pkgutil
from types import ModuleType
from typing import Any

from numba.extending import overload

from flight_sw.errors import LoadError
from flight_sw.records.types_ import Record


def _families() -> dict[str, ModuleType]:
    """The packages in this folder, by name."""
    names = sorted(found.name for found in pkgutil.iter_modules(__path__) if found.ispkg)
    return {name: importlib.import_module(f"{__name__}.{name}") for name in names}


FAMILIES = _families()


def _numbered() -> dict[int, tuple[str, ModuleType]]:
    """Name and module of every law by its number; two with one of either are an error."""
    found: dict[int, tuple[str, ModuleType]] = {}
    for family in FAMILIES.values():
        for name, (number, module) in family.LAWS.items():
            if number in found or name in {other for other, _ in found.values()}:
                raise ImportError(
                    f"{family.__name__}: law '{name}', number {number}, is there twice"
                )
            found[number] = name, module
    return found


_NUMBERED = _numbered()
NUMBERS = {name: number for number, (name, _) in sorted(_NUMBERED.items())}
"""What FSW_BOOT sends for each law."""
LAWS: dict[str, ModuleType] = {name: module for _, (name, module) in sorted(_NUMBERED.items())}

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


def law_coast(load: Record, state: Record, nav: Record, has_fix: bool, out: Record) -> None:
    """What the law does in a minor frame of COAST; most do nothing."""
    coast = getattr(_law_of(load.dtype.names), "coast", None)
    if coast is not None:
        coast(load, state, nav, has_fix, out)


@overload(law_coast)
def _law_coast(load: Any, state: Any, nav: Any, has_fix: Any, out: Any) -> Any:
    chosen = getattr(_law_of(load.fields), "coast", None)
    if chosen is None:

        def nothing(load: Record, state: Record, nav: Record, has_fix: Any, out: Record) -> None:
            return None

        return nothing

    def compiled(load: Record, state: Record, nav: Record, has_fix: Any, out: Record) -> None:
        chosen(load, state, nav, has_fix, out)

    return compiled
