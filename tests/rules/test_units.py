"""Every real number in a record names its unit, or stands on the list of pure numbers.

Integers count, number, mask or switch something and need none; quantities in integers (`t_ns`,
`nav_timeout_cycles`) say theirs by the same endings.
"""

import ast
import importlib
import re
from pathlib import Path

import numpy as np
import pytest

from tests.rules.sources import ROOT, name_of, python_files, tree_of

BASES = ("ns", "us", "ms", "s", "m", "kg", "rad", "pa", "w", "j", "hz", "g", "k(?![a-z])")
"""SI and radians. `g` is the standard acceleration, for load factors alone; `k` is kelvin, and no
prefix: nothing may follow it."""
COUNTED = ("cycles", "frames", "samples", "bytes", "bits", "count", "ratio", "exponent", "index")
"""Endings that say of a pure number what it is."""
PURE = {
    # aerodynamic coefficients and the grids they stand on
    "mach", "cl", "cd", "lift_coefficient", "drag_coefficient", "lift_table", "drag_table",
    "n1", "n2", "a1", "a2",
    # planet
    "j2",
    # logarithm of a density in kg/m3
    "ln_rho",
    # share of an error taken in one frame
    "lag_gain",
    # a share of a value that goes into a value, and what an observer is given: any unit
    "value_from_value", "rate_from_rate", "value_from_measured", "value_from_newest",
    "value", "value_rate", "value_accel", "measured",
    # of a channel of navigation, in its unit; noise in standard deviations
    "bias", "sigma", "slope", "lagged", "noise", "ring",
    # share of a noise that is left a report later
    "memory",
    # k in q = k rho^m V^n and rho V^n itself: their units depend on the exponents
    "coefficient", "factor_si", "tracking_constant",
    # of a drag profile: the unit depends on what it is indexed by
    "grid", "bend", "index_rate",
    # of polynomials in angle of attack and Mach number
    "cl_powers", "cd_powers", "lift_powers", "drag_powers",
    # vectors and matrices over states and controls: each element has the unit of its own
    "x", "x_rate", "rate", "by_state", "by_control", "state", "start", "slopes", "k_alpha",
    "k_bank", "by_knot", "by_knot_rate",
    # of a planner: squares and weighted errors, and what they change by
    "error", "jacobian", "rows", "merit", "best_error", "best_jacobian", "target_error", "excess",
    "target_error_max", "excess_max", "excess_rate", "excess_by_knot", "excess_by_knot_rate",
    # places on the axis of a profile
    "index", "breaks",
    # in the unit of the signal or of the telemetry number
    "scale", "offset", "low", "high", "telemetry", "values", "received",
}  # fmt: skip
"""Numbers without a unit, and those whose unit another field tells."""

PURE_BEGINNINGS = ("sin_", "cos_", "tan_")

_BASE = "|".join(BASES)
UNIT = re.compile(rf"(?:1|(?:(?:{_BASE})\d?)+)?(?:p(?:{_BASE})\d?)*")


def has_unit(name: str) -> bool:
    """True for `quantity_unit` with a unit of the bases above (`kgpm3`, `radm2pw`) or with none."""
    if name.startswith(PURE_BEGINNINGS):
        return True
    quantity, _, ending = name.rpartition("_")
    if not quantity or not ending:
        return False
    return ending in COUNTED or UNIT.fullmatch(ending) is not None


SOURCES = [p for p in python_files("flight_sw", "sim_harness") if p.stem != "__main__"]


def module_name(path: Path) -> str:
    """Dotted name of a source file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def names_assigned_in(path: Path) -> set[str]:
    """Module globals that the file itself assigns, so not those it imports."""
    found = set()
    for node in tree_of(path).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        found |= {target.id for target in targets if isinstance(target, ast.Name)}
    return found


def records_in(path: Path) -> dict[str, np.dtype]:
    """The record types that a file defines: dtypes, and what carries one as `.dtype`."""
    module = importlib.import_module(module_name(path))
    found = {}
    for name in sorted(names_assigned_in(path)):
        value = getattr(module, name, None)
        dtype = value if isinstance(value, np.dtype) else getattr(value, "dtype", None)
        if isinstance(dtype, np.dtype) and dtype.names and not isinstance(value, np.ndarray):
            found[name] = dtype
    return found


def real_fields(dtype: np.dtype) -> list[str]:
    """Names of the fields of floating point, arrays of them included."""
    return [n for n in dtype.names or () if dtype[n].base.kind == "f"]


def fields_without_unit(dtype: np.dtype) -> list[str]:
    """Names of real fields that say neither a unit nor that they have none."""
    return [n for n in real_fields(dtype) if n not in PURE and not has_unit(n)]


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_every_field_of_every_record_names_its_unit(path: Path) -> None:
    wrong = {name: fields_without_unit(dtype) for name, dtype in records_in(path).items()}
    assert {name: fields for name, fields in wrong.items() if fields} == {}


def test_the_list_of_pure_names_holds_none_that_no_record_has() -> None:
    records = [dtype for path in SOURCES for dtype in records_in(path).values()]
    assert sorted(PURE - {name for dtype in records for name in real_fields(dtype)}) == []


@pytest.mark.parametrize(
    "name",
    ["alt_m", "v_rel_mps", "rho_kgpm3", "mu_m3ps2", "heat_flux_wpm2", "k_drag_s2pm", "rate_1ps",
     "k_heat_flux_radm2pw", "load_factor_g", "nav_timeout_cycles", "sin_bank", "buckets_pm",
     "heat_load_jpm2"],
)  # fmt: skip
def test_a_unit_is_recognised(name: str) -> None:
    assert has_unit(name)


@pytest.mark.parametrize(
    "name", ["alt", "speed", "m", "alt_km", "bank_deg", "flux_kwpm2", "rho", "q_", "bank_rate"]
)
def test_a_missing_or_foreign_unit_is_seen(name: str) -> None:
    assert not has_unit(name)
