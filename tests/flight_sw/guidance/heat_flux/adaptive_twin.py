"""Slow twin of the adaptive laws, beside that of the laws they stand on (guidance_twin.py).

[MOOIJ18] Eqs. 33-41 with one error and no reference model, and what docs/laws/heat_flux.md adds.
The observer is integrated by itself, in small steps of its differential equation.
"""

import math

from tests.flight_sw.guidance.heat_flux.guidance_twin import (
    MU,
    RADIUS_M,
    LqyTwin,
    Values,
    areas_m2,
    density,
)

OBSERVER_STEPS = 400  # midpoint rule, in a period


def observed(memory: Values, choice: Values, dt: float) -> tuple[float, float]:
    """Value and rate of the observer after a period of the last measurement, held."""
    value, rate = memory["value"], memory["value_rate"]
    h = dt / OBSERVER_STEPS
    first, second = choice["l1"] / choice["eps_s"], choice["l2"] / choice["eps_s"] ** 2
    for _ in range(OBSERVER_STEPS):
        off = memory["measured"] - value
        middle = value + h / 2 * (rate + first * off)
        rate_middle = rate + h / 2 * (memory["value_accel"] + second * off)
        off = memory["measured"] - middle
        value += h * (rate_middle + first * off)
        rate += h * (memory["value_accel"] + second * off)
    return value, rate


class SagTwin:
    """Outer loop over the nominal guidance, and where wanted over the inner loop."""

    def __init__(
        self, design: Values, memory: Values, observer: Values, *, has_inner_loop: bool
    ) -> None:
        self.tracking, self.memory, self.observer = design["tracking"], memory, observer
        self.has_inner_loop = has_inner_loop
        self.loop = LqyTwin(design, memory)
        self.design = design["nominal"]

    def _model_rate(self, nav: Values, q: float) -> float:
        """Time derivative of sqrt(rho) V^3."""
        inner = self.memory["nominal"]
        v, gamma, r = nav["v_rel_mps"], nav["flight_path_angle_rad"], RADIUS_M + nav["alt_m"]
        drag_m2 = areas_m2(inner["alpha_rad"])[0] * (1 + inner["drag_excess_ratio"])
        drag = density(nav["alt_m"]) * v**2 / 2 * drag_m2 / 450.0
        v_dot = -drag - MU / r**2 * math.sin(gamma)
        return q * (3 * v_dot / v - v * math.sin(gamma) / (2 * self.design["scale_height_m"]))

    def _sense(self, nav: Values, dt: float) -> Values:
        """The fix that guidance sees: its heat flux observed where an observer runs."""
        m = self.memory
        if self.tracking["rate_source"] == 2:
            seen = m["observer"]
            value, rate = observed(seen, self.observer, dt)
            m["nominal"]["heat_flux_prev_wpm2"] = value - rate * dt
            seen.update(value=value, value_rate=rate, measured=nav["heat_flux_wpm2"])
            seen["t_s"] = nav["t_s"]
            nav = {**nav, "heat_flux_wpm2": value}
        m["heat_flux_wpm2"] = nav["heat_flux_wpm2"]
        return nav

    def _expect(self, nav: Values, dt: float) -> None:
        m = self.memory
        rate = m["heat_flux_rate_wpm2ps"] = self._model_rate(nav, nav["heat_flux_wpm2"])
        if self.tracking["rate_source"] == 2:
            last = m["model_rate_wpm2ps"] if m["model_started"] else rate
            m["observer"]["value_accel"] = (rate - last) / dt
            m["heat_flux_rate_wpm2ps"] = m["observer"]["value_rate"]
        m["model_started"], m["model_rate_wpm2ps"] = 1, rate

    def _hand_over(self, nav: Values) -> None:
        """Choose the integral with which the path law alone flies the bank of all three."""
        m, inner, d = self.memory, self.memory["nominal"], self.design
        k_i = d["k_gamma_i_mps3prad"] + nav["v_rel_mps"] * d["k_gamma_i_1ps2"]
        if k_i == 0:
            return
        whole = inner["bank_rad"] + m["correction_rad"] + m["adaptive_rad"]
        whole = max(0.0, min(math.pi, whole))
        path = max(0.0, min(math.pi, inner["path_bank_rad"] + whole - inner["bank_rad"]))
        lift_m2 = areas_m2(inner["alpha_rad"])[1] * (1 + inner["lift_excess_ratio"])
        lift = density(nav["alt_m"]) * nav["v_rel_mps"] ** 2 / 2 * lift_m2 / 450.0
        wanted, had = lift * math.cos(path), lift * math.cos(inner["path_bank_rad"])
        inner["gamma_integral_rads"] += (wanted - had) / k_i
        inner["bank_rad"], inner["released_s"] = whole, self.loop.loop["decay_s"]

    def _adapt(self, name: str, error: float, rate: float | None, dt: float) -> float:
        """Command of one tracker; without a rate that of the last error.  Eqs. 33-41"""
        design, memory = self.tracking[name], self.memory[name]
        k_i = memory["gain_integral_ratio"] if memory["started"] else design["k_initial_ratio"]
        if rate is None:
            rate = (error - memory["error_prev_rad"]) / dt if memory["started"] else 0.0
        memory["started"], memory["error_prev_rad"] = 1, error
        most = design["error_max_rad"]
        e = max(-most, min(most, error + design["rate_s"] * rate))
        k_i = k_i * (1 - design["leak_1ps"] * dt) + design["t_i_1prad2ps"] * e**2 * dt
        k_i = min(k_i, design["gain_max_ratio"])
        k = min(k_i + design["t_p_1prad2"] * e**2, design["gain_max_ratio"])
        memory.update(error_rad=e, gain_integral_ratio=k_i, gain_ratio=k)
        return float(k * e)

    def _outer(self, nav: Values, dt: float) -> float:
        inner, loop = self.memory["nominal"], self.loop
        k_heat, k_load = loop.gains(nav)
        error = nav["heat_flux_wpm2"] - self.design["heat_flux_max_wpm2"]
        guarded = inner["released"] and loop.loop["guard_ratio"]
        share = 0.0 if guarded else loop.share(error)
        rate = -k_heat * share * self.memory["heat_flux_rate_wpm2ps"]
        by_heat = self._adapt(
            "heat_flux",
            -k_heat * share * error,
            None if self.tracking["rate_source"] == 0 else rate,
            dt,
        )
        excess_g = max(0.0, inner["load_factor_g"] - self.design["load_factor_max_g"])
        return max(by_heat, self._adapt("load", -k_load * excess_g, None, dt), key=abs)

    def step(self, nav: Values, dt: float) -> tuple[float, int]:
        """One step: the bank command and 1 where a cosine saturated."""
        m, inner = self.memory, self.memory["nominal"]
        nav = self._sense(nav, dt)
        before = inner["released"]
        if self.tracking["holds_integral"]:
            error = nav["heat_flux_wpm2"] - self.design["heat_flux_max_wpm2"]
            active = inner["phase"] >= 2 and not before and self.loop.share(error) > 0
            inner["gamma_held"] = int(active)
        code = self.loop.nominal.step(nav, dt)
        self._expect(nav, dt)
        if self.tracking["hands_over"] and inner["released"] and not before:
            self._hand_over(nav)
        if inner["phase"] < 2:
            return inner["bank_rad"], code
        if self.has_inner_loop:
            self.loop.correct(nav)
        m["adaptive_rad"] = self._outer(nav, dt)
        bank = inner["bank_rad"] + m["correction_rad"] + m["adaptive_rad"]
        return max(0.0, min(math.pi, bank)), code
