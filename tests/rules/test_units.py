"""Every field of every record names its unit, or stands on the list of pure numbers."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest

from tests.rules.sources import ROOT, python_files

BASES = ("ns", "us", "ms", "s", "m", "kg", "rad", "pa", "w", "j", "hz", "g", "k(?![a-z])")
"""SI and radians. `g` is the standard acceleration, for load factors alone; `k` is kelvin, and no
prefix: nothing may follow it."""
COUNTED = ("cycles", "frames", "samples", "bytes", "bits", "count", "ratio", "exponent", "index")
"""Endings that say of a pure number what it is."""
PURE = {
    # struct can_frame
    "can_id", "dlc", "pad", "res0", "len8_dlc", "data",
    # codes and switches
    "phase", "mode", "law", "status", "tracking", "started", "released", "gamma_started", "armed",
    "fix_valid", "valid", "seq",
    # tables: grid sizes and dimensionless columns
    "n", "n_rows", "n_alpha", "n_mach", "mach", "cl", "cd",
    # a law's own reports, units by name in its TELEMETRY
    "telemetry",
    # k in q = k rho^m V^n and rho V^n itself: their units depend on the exponents
    "coefficient", "tracking_constant",
    # counters
    "falling",
}  # fmt: skip

_BASE = "|".join(BASES)
UNIT = re.compile(rf"(?:1|(?:(?:{_BASE})\d?)+)?(?:p(?:{_BASE})\d?)*")


def has_unit(name: str) -> bool:
    """True for `quantity_unit` with a unit of the bases above, such as `kgpm3` or `radm2pw`."""
    quantity, _, ending = name.rpartition("_")
    if not quantity or not ending:
        return False
    return ending in COUNTED or UNIT.fullmatch(ending) is not None


def module_name(path: Path) -> str:
    """Dotted name of a source file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = [
    module_name(path)
    for path in python_files("flight_sw", "sim_harness")
    if path.stem != "__main__"
]


def records_in(module: str) -> dict[str, np.dtype]:
    """The record types among a module's globals: dtypes, and what carries one as `.dtype`."""
    found = {}
    for name, value in vars(importlib.import_module(module)).items():
        dtype = value if isinstance(value, np.dtype) else getattr(value, "dtype", None)
        if isinstance(dtype, np.dtype) and dtype.names and not isinstance(value, np.ndarray):
            found[name] = dtype
    return found


def fields_without_unit(dtype: np.dtype) -> list[str]:
    """Names of number fields that say neither a unit nor that they have none."""
    assert dtype.fields is not None
    numbers = [n for n in dtype.fields if dtype.fields[n][0].base.names is None]
    return [n for n in numbers if n not in PURE and not has_unit(n)]


@pytest.mark.parametrize("module", MODULES)
def test_every_field_of_every_record_names_its_unit(module: str) -> None:
    wrong = {name: fields_without_unit(dtype) for name, dtype in records_in(module).items()}
    assert {name: fields for name, fields in wrong.items() if fields} == {}


def test_the_list_of_pure_names_holds_none_that_no_record_has() -> None:
    records = [dtype for module in MODULES for dtype in records_in(module).values()]
    assert sorted(PURE - {name for dtype in records for name in dtype.names or ()}) == []


@pytest.mark.parametrize(
    "name",
    ["alt_m", "v_rel_mps", "rho_kgpm3", "mu_m3ps2", "heat_flux_wpm2", "k_drag_s2pm", "rate_1ps",
     "k_heat_flux_radm2pw", "load_factor_g", "nav_timeout_cycles", "heat_load_jpm2"],
)  # fmt: skip
def test_a_unit_is_recognised(name: str) -> None:
    assert has_unit(name)


@pytest.mark.parametrize(
    "name", ["alt", "speed", "m", "alt_km", "bank_deg", "flux_kwpm2", "rho", "q_", "bank_rate"]
)
def test_a_missing_or_foreign_unit_is_seen(name: str) -> None:
    assert not has_unit(name)
