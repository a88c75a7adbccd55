"""Slow twin of the drag-tracking laws: the paper's equations over the reference's own rows.

The reference is read by a spline through its rows' drag alone, so that slope and bend are the
twin's own; f is the paper's with the corrected sign; the observer is integrated in small steps.
"""

import math
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from tests.flight_sw.guidance.drag.test_drag_dynamics import printed_f
from tests.flight_sw.guidance.heat_flux.adaptive_twin import observed
from tests.flight_sw.mars_cases import LIFT_TO_DRAG, MU, RADIUS_M, SCALE_M, model_drag

Values = dict[str, Any]


class DragTwin:
    """[YANHE] Eq. 14 or 24 at one fix."""

    def __init__(self, law: Any) -> None:
        tracking = law["tracking"]
        n = int(tracking["reference"]["n_rows"])
        self.reference = CubicSpline(
            tracking["reference"]["grid"][:n], tracking["reference"]["drag_mps2"][:n]
        )
        self.k_drag, self.k_rate = float(tracking["k_drag_1ps2"]), float(tracking["k_rate_1ps"])
        self.floor = float(tracking["authority_min_mps4"])

    def at(self, nav: Values) -> float:
        """Jacobi energy over a planet at rest, zero at the sphere."""
        r = RADIUS_M + nav["alt_m"]
        return float(0.5 * nav["v_rel_mps"] ** 2 + MU / RADIUS_M - MU / r)

    def reference_drag(self, nav: Values) -> float:
        """D*."""
        return float(self.reference(self.at(nav)))

    def log_rate(self, nav: Values, drag: float) -> float:
        """[YANHE] Eq. 8."""
        v, s = nav["v_rel_mps"], math.sin(nav["flight_path_angle_rad"])
        g = MU / (RADIUS_M + nav["alt_m"]) ** 2
        return -v * s / SCALE_M - 2.0 * drag / v - 2.0 * g * s / v

    def control(
        self, nav: Values, drag: float, rate: float | None = None, error_rate: float | None = None,
        lift: float | None = None,
    ) -> float:  # fmt: skip
        """u before its limits, for a drag rate or the rate of the drag error."""
        v, gamma = nav["v_rel_mps"], nav["flight_path_angle_rad"]
        r = RADIUS_M + nav["alt_m"]
        g = MU / r**2
        slope, bend = (float(self.reference(self.at(nav), k)) for k in (1, 2))
        of_energy = -v * drag
        rate_ref = slope * of_energy
        if rate is None:
            rate = rate_ref + (error_rate or 0.0)
        v_rate = -drag - g * math.sin(gamma)
        accel_ref = bend * of_energy**2 - slope * (v_rate * drag + v * rate)
        lift = LIFT_TO_DRAG * drag if lift is None else lift
        g0 = -(v / SCALE_M + 2.0 * g / v) * lift * drag * math.cos(gamma) / v
        f = printed_f(v, g, drag, gamma, r, -1.0)
        feedback = self.k_drag * (drag - self.reference_drag(nav)) + self.k_rate * (rate - rate_ref)
        return (accel_ref - f) / g0 + feedback / max(abs(g0), self.floor)


class ErrorTwin(DragTwin):
    """Eq. 25 on the drag error, step by step."""

    def __init__(self, law: Any, l1: float, l2: float, eps_s: float) -> None:
        super().__init__(law)
        self.choice = {"l1": l1, "l2": l2, "eps_s": eps_s}
        self.memory: Values = {}

    def step(self, nav: Values, dt: float) -> float:
        """u of the next step; measurements are held between steps."""
        error = nav["drag_mps2"] - self.reference_drag(nav)
        if not self.memory:
            self.memory = {"value": error, "value_rate": 0.0}
        else:
            value, rate = observed(self.memory, self.choice, dt)
            self.memory |= {"value": value, "value_rate": rate}
        x2 = self.memory["value_rate"]
        self.memory |= {
            "measured": error, "value_accel": -self.k_drag * error - self.k_rate * x2
        }  # fmt: skip
        return self.control(nav, nav["drag_mps2"], error_rate=x2)


def ratio(nav: Values) -> float:
    """Sensed over modelled drag."""
    return float(nav["drag_mps2"] / model_drag(nav["alt_m"], nav["v_rel_mps"]))


def cosine_of(bank_rad: float) -> float:
    """For a comparison that does not blow up where the bank is at its end."""
    return float(np.cos(bank_rad))
