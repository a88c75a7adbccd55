"""Loads and fixes of the Mars lander that the tests of its laws share."""

import functools
from typing import Any

import numpy as np

from flight_sw.guidance import law_module, law_step
from flight_sw.load_image import parse_image
from flight_sw.records.dictionary import GUIDANCE, NAV
from tests.system.flights import ROOT
from tools.gains.design import Design, design_of, read_tree

DESIGN_PATH = ROOT / "gains" / "mars-lander" / "design.toml"

MU, RADIUS_M, SCALE_M, RHO0, BETA, LIFT_TO_DRAG = 4.2828e13, 3397e3, 9354.0, 0.0158, 115.0, 0.18
"""[YANHE] Section 4 and the air of docs/equations.md: what the twin flies in."""


def design() -> Design:
    """The shipped design."""
    return design_of(read_tree(DESIGN_PATH), DESIGN_PATH.name)


@functools.cache
def _body(law: str, printed: bool) -> Any:
    """The committed load's body: a nominal flight solved uncompiled takes minutes."""
    path = DESIGN_PATH.parent / f"{law}.load"
    body = parse_image(path.read_bytes(), law).body.copy()
    if printed:
        body["law"]["tracking"]["authority_min_mps4"] = 0.0
        body["law"]["tracking"]["uses_sensed_lift"] = 0
        if "watch" in (body["law"].dtype.names or ()):
            for name in ("observes", "uses_estimate", "knows_flown_bank"):
                body["law"]["watch"][name] = 0
    return body


class Case:
    """One law with its records, the load its own to change."""

    def __init__(self, law: str, printed: bool = False) -> None:
        self.body = _body(law, printed).copy()
        self.state = np.zeros(1, law_module(law).STATE.dtype)
        self.nav = np.zeros(1, NAV)
        self.out = np.zeros(1, GUIDANCE)

    @property
    def law(self) -> Any:
        """The law's design."""
        return self.body[0]["law"]

    def step(self, **nav: float) -> int:
        """One guidance step at a fix with these fields changed."""
        for name, value in nav.items():
            self.nav[name] = value
        return int(law_step(self.body[0], self.state[0], self.nav[0], self.out[0]))

    @property
    def telemetry(self) -> dict[str, float]:
        """What the last step told, by name."""
        names = law_module(next(n for n in LAWS if LAWS[n] == self.state.dtype)).TELEMETRY
        return dict(zip(names, map(float, self.out[0]["telemetry"]), strict=False))


LAWS = {n: law_module(n).STATE.dtype for n in ("drag-state", "drag-observer", "range-predictor")}


def model_drag(alt_m: float, v_mps: float) -> float:
    """Drag of the nominal vehicle."""
    return float(0.5 * RHO0 * np.exp(-alt_m / SCALE_M) * v_mps**2 / BETA)


def fix_near(case: Case, row: int, share: float = 1.0, **more: float) -> dict[str, float]:
    """A fix near a row of the reference: its energy split as a flight does, its drag a share."""
    reference = case.law["tracking"]["reference"]
    wanted, energy = float(reference["drag_mps2"][row]), float(reference["grid"][row])
    low, high = 5e3, 120e3
    for _ in range(80):
        alt = 0.5 * (low + high)
        v = (2.0 * max(energy - MU * alt / (RADIUS_M * (RADIUS_M + alt)), 1.0)) ** 0.5
        low, high = (alt, high) if model_drag(alt, v) > wanted else (low, alt)
    fix = {
        "alt_m": alt, "v_rel_mps": v,
        "drag_mps2": share * wanted, "lift_mps2": LIFT_TO_DRAG * share * wanted,
        "flight_path_angle_rad": -0.1, "heading_rad": np.pi / 2, "lat_rad": 0.0,
        "lon_rad": float(reference["range_m"][row]) / RADIUS_M, "t_s": 0.0, "bank_rad": 0.9,
    }  # fmt: skip
    return {**fix, **more}
