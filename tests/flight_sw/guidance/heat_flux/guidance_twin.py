"""Slow twin of the guidance laws: plain floats, written from the paper's equations.

[MOOIJ18] Eqs. 7-23 and 28-32 with the corrections and additions that docs/laws/heat_flux.md lists;
exponential air, the Newtonian coefficients of the mission file, memory in a dictionary named as the
law's state.
"""

import math
from fractions import Fraction
from typing import Any

import numpy as np

from flight_sw.records.types_ import Record

RHO0_KGPM3, AIR_SCALE_M = 1.225, 7050.0
NEWTONIAN = {"n1": 0.7976, "n2": 1.5954, "a1": 0.0795, "a2": 0.9108}  # hyperion-1.toml, m2
MASS_KG, RADIUS_M, MU, OMEGA, G0 = 450.0, 6378137.0, 3.986004418e14, 7.292115e-5, 9.81
SIN_GAMMA_LIMIT = 0.99
HEATING = {"m": 0.5, "n": 3.0}  # [MOOIJ18] Eq. 7, as the mission has it

Values = dict[str, Any]


def values_of(record: Record) -> Values:
    """A record's numbers by name; nested records become nested dictionaries."""
    return {
        name: values_of(record[name])
        if record.dtype[name].names
        else np.array(record[name]).tolist()
        for name in record.dtype.names
    }


def areas_m2(alpha_rad: float) -> tuple[float, float]:
    """CD S and CL S, Newtonian."""
    s, c = math.sin(alpha_rad), math.cos(alpha_rad)
    normal = NEWTONIAN["n1"] * s**2 + NEWTONIAN["n2"] * s * c
    axial = NEWTONIAN["a1"] * c**2 + NEWTONIAN["a2"] * s**2
    return normal * s + axial * c, normal * c - axial * s


def density(alt_m: float) -> float:
    """Exponential air."""
    return RHO0_KGPM3 * math.exp(-alt_m / AIR_SCALE_M)


def quintic(x: Any) -> Any:
    """The paper's smooth step, held outside 0 to 1; exact for a fraction."""
    x = min(max(x, 0), 1)
    return 6 * x**5 - 15 * x**4 + 10 * x**3


def path_command(
    c_n: float, n: float, v: float, k: float, g: float, h_s: float
) -> tuple[float, float]:
    """Eq. 12 corrected, and Eq. 13 as it stands in the paper."""
    sine = -c_n * (n / v ** (n - 2)) * (h_s / (2 * k)) / (v**2 + n * g * h_s)
    sine = max(-SIN_GAMMA_LIMIT, min(SIN_GAMMA_LIMIT, sine))
    gamma = math.asin(sine)
    above = 2 * n**2 * k * h_s * (v ** (n - 1) + g * h_s * (n - 2) * v ** (n - 3))
    below = (2 * k * v ** (n - 2) * (v**2 + g * n * h_s)) ** 2
    return gamma, c_n / math.cos(gamma) * above / below


class NominalTwin:
    """Nominal guidance: `design` and `memory` as the law's records name them."""

    def __init__(self, design: Values, memory: Values) -> None:
        self.design, self.memory = design, memory

    def _may_be_over(self, nav: Values) -> bool:
        """Whether the model's q = k rho^m V^n, or a slow mean of the sensed one, agrees."""
        d, m = self.design, self.memory
        if d["peak_by"] == 0:
            return True
        v, sine = nav["v_rel_mps"], math.sin(nav["flight_path_angle_rad"])
        g = MU / (RADIUS_M + nav["alt_m"]) ** 2
        braking = nav.get("drag_mps2", 0.0) + g * sine
        rise = -HEATING["m"] * v * sine / AIR_SCALE_M - HEATING["n"] * braking / v
        top, now = m["heat_flux_slow_peak_wpm2"], m["heat_flux_slow_wpm2"]
        if rise > 1e-3 and top - now < 0.02 * d["heat_flux_max_wpm2"]:
            return False
        m["heat_flux_peak_wpm2"] = min(m["heat_flux_peak_wpm2"], 1.01 * top)
        return True

    def _watch(self, q: float, c_n: float, nav: Values, dt: float) -> None:
        d, m = self.design, self.memory
        if m["heat_flux_slow_peak_wpm2"] == 0.0:
            m["heat_flux_slow_wpm2"] = q
        m["heat_flux_slow_wpm2"] += (q - m["heat_flux_slow_wpm2"]) * dt / (1.0 + dt)
        m["heat_flux_slow_peak_wpm2"] = max(m["heat_flux_slow_peak_wpm2"], m["heat_flux_slow_wpm2"])
        if m["phase"] == 0:
            m["heat_flux_peak_wpm2"] = max(q, m["heat_flux_peak_wpm2"])
            high = q >= d["peak_floor_ratio"] * d["heat_flux_max_wpm2"]
            down = m["heat_flux_peak_wpm2"] - q >= d["peak_drop_wpm2"]
            falls = high and down and q < m["heat_flux_prev_wpm2"]
            m["falling"] = m["falling"] + 1 if falls else 0
            if m["falling"] >= 2 and self._may_be_over(nav):
                m["phase"] = 1
        slow = d["peak_by"] == 0 or m["heat_flux_slow_wpm2"] <= 1.03 * d["heat_flux_max_wpm2"]
        if m["phase"] == 1 and q <= d["heat_flux_max_wpm2"] and slow:
            over = d["heat_flux_max_wpm2"] / m["heat_flux_peak_wpm2"]
            m["tracking_constant"] = c_n * max(over, 1.0) ** d["peak_scale_exponent"]
            m["phase"] = 2
        m["heat_flux_prev_wpm2"] = q

    def _constant(self, rho: float, v: float, dt: float) -> float:
        d, m = self.design, self.memory
        n_max = d["load_factor_max_g"]
        start = d["transition_start_ratio"] * n_max
        if m["phase"] == 2 and m["load_factor_g"] >= start:
            m["phase"], m["transition_time_s"] = 3, 0.0
        if m["phase"] == 2:
            m["flow_exponent"] = d["heat_flux_exponent"]
            return float(m["tracking_constant"])
        n_x = (m["load_factor_g"] - start) / (n_max - start)  # Eq. 18
        n_1, n_2 = d["heat_flux_exponent"], 2
        m["flow_exponent"] = n_1 - (n_1 - n_2) * quintic(n_x)  # Eq. 19
        if m["released"]:
            m["released_s"] += dt
        elif m["flow_exponent"] < d["release_exponent"]:
            m["released"] = 1
        t_x = m["transition_time_s"] / d["transition_duration_s"]  # Eq. 21
        m["transition_time_s"] += dt
        here, held = Fraction(rho * v ** m["flow_exponent"]), Fraction(m["tracking_constant"])
        share = quintic(Fraction(t_x))  # exact: Eq. 22 is a difference of unlike magnitudes
        return float(held - (held - here) * share)

    def _pid(self, gamma: float, v: float, dt: float) -> float:
        d, m = self.design, self.memory
        error = m["gamma_cmd_rad"] - gamma
        slope = (error - m["gamma_error_prev_rad"]) / dt if m["gamma_started"] else 0.0
        m["gamma_started"], m["gamma_error_prev_rad"] = 1, error
        if not m["gamma_held"]:
            m["gamma_integral_rads"] += error * dt
        printed = (
            d["k_gamma_p_mps2prad"] * error
            + d["k_gamma_i_mps3prad"] * m["gamma_integral_rads"]
            + d["k_gamma_d_mpsprad"] * slope
        )
        of_a_rate = d["k_gamma_p_1ps"] * error + d["k_gamma_i_1ps2"] * m["gamma_integral_rads"]
        return float(printed + v * of_a_rate)

    def _force_areas_m2(self) -> tuple[float, float]:
        """CD S and CL S at the angle commanded, as believed."""
        drag_m2, lift_m2 = areas_m2(self.memory["alpha_rad"])
        m = self.memory
        return drag_m2 * (1 + m["drag_excess_ratio"]), lift_m2 * (1 + m["lift_excess_ratio"])

    def _learn(self, nav: Values, rho: float) -> None:
        """Sensed over modelled forces, at the angle commanded before this step."""
        d, m = self.design, self.memory
        share, most = d["adaptation_share_ratio"], d["adaptation_max_ratio"]
        sensed = nav.get("drag_mps2", 0.0), nav.get("lift_mps2", 0.0)
        alpha = d["alpha_before_peak_rad" if m["phase"] == 0 else "alpha_after_peak_rad"]
        is_felt = math.hypot(*sensed) >= d["adaptation_load_min_g"] * G0
        if share == 0.0 or not is_felt or abs(nav.get("alpha_rad", 0.0) - alpha) > 0.01:
            return
        modelled = [rho * nav["v_rel_mps"] ** 2 / 2 * a / MASS_KG for a in areas_m2(alpha)]
        for name, f, g in zip(("drag", "lift"), sensed, modelled, strict=True):
            excess = max(-most, min(most, f / g - 1))
            old = m[f"{name}_excess_ratio"]
            m[f"{name}_excess_ratio"] = (1 - share) * old + share * excess

    def _bank(self, nav: Values, rho: float, dt: float, c_n: float) -> tuple[float, int]:
        d, m = self.design, self.memory
        v, gamma, r = nav["v_rel_mps"], nav["flight_path_angle_rad"], RADIUS_M + nav["alt_m"]
        lat, chi, n = nav["lat_rad"], nav["heading_rad"], m["flow_exponent"]
        drag_m2, lift_m2 = self._force_areas_m2()
        q_dyn = rho * v**2 / 2
        drag, lift, g = q_dyn * drag_m2 / MASS_KG, q_dyn * lift_m2 / MASS_KG, MU / r**2
        h_s = d["scale_height_m"]
        gc, slope = path_command(c_n, n, v, MASS_KG / drag_m2, g, h_s)
        m["gamma_cmd_rad"] = gc
        v_dot = -drag - g * math.sin(gamma)  # Eq. 1
        others = (  # Eq. 15
            -g * math.cos(gc)
            + 2 * OMEGA * v * math.cos(lat) * math.sin(chi)
            + v**2 / r * math.cos(gc)
            + OMEGA**2 * r * math.cos(lat)
            * (math.cos(lat) * math.cos(gc) + math.sin(gc) * math.sin(lat) * math.cos(chi))
        )  # fmt: skip
        # Eqs. 14 and 16, the PID as an acceleration
        cosine = (v * slope * v_dot + self._pid(gamma, v, dt) - others) / lift
        bank = m["path_bank_rad"] = math.acos(max(-1.0, min(1.0, cosine)))
        ratio = rho * v**n / c_n
        m["constant_ratio"] = ratio
        change = ratio * (-v * math.sin(gamma) / h_s + n * v_dot / v)
        k_d = np.interp(
            n, [2, d["heat_flux_exponent"]], [d["k_flow_d_load_rads"], d["k_flow_d_heat_flux_rads"]]
        )
        bank += d["k_flow_p_rad"] * (ratio - 1) + k_d * change  # Eq. 23
        return max(0.0, min(math.pi, float(bank))), int(abs(cosine) > 1.0)

    def step(self, nav: Values, dt: float) -> int:
        """One step: command and memory are left in `memory`; 1 where a cosine saturated."""
        d, m = self.design, self.memory
        v, rho = nav["v_rel_mps"], density(nav["alt_m"])
        self._learn(nav, rho)
        if m["phase"] < 2:
            self._watch(nav["heat_flux_wpm2"], rho * v ** d["heat_flux_exponent"], nav, dt)
        m["alpha_rad"] = d["alpha_before_peak_rad" if m["phase"] == 0 else "alpha_after_peak_rad"]
        m["load_factor_g"] = rho * v**2 / (2 * MASS_KG * G0) * math.hypot(*self._force_areas_m2())
        if m["phase"] < 2:
            m["flow_exponent"] = d["heat_flux_exponent"]
            m["bank_rad"] = d["bank_before_tracking_rad"]
            return 0
        c_n = self._constant(rho, v, dt)
        m["bank_rad"], code = self._bank(nav, rho, dt, c_n)
        return code


def energy_jpkg(nav: Values) -> float:
    """Kinetic and potential energy above the sphere."""
    r = RADIUS_M + nav["alt_m"]
    return float(nav["v_rel_mps"] ** 2 / 2 + MU / RADIUS_M - MU / r)


class LqyTwin:
    """Nominal guidance with the inner loop."""

    def __init__(self, design: Values, memory: Values, rho_exponent: float = 0.5) -> None:
        self.rho_exponent = rho_exponent  # of the heat-flux law, one half in the paper
        self.loop, self.design, self.memory = design["inner_loop"], design["nominal"], memory
        self.nominal = NominalTwin(design["nominal"], memory["nominal"])

    def _gain(self, name: str, energy: float) -> float:
        n = self.loop["n_rows"]
        return float(np.interp(energy, self.loop["energy_jpkg"][:n], self.loop[name][:n]))

    def share(self, error: float) -> float:
        """What of a heat-flux error counts."""
        inner, q_max = self.memory["nominal"], self.design["heat_flux_max_wpm2"]
        if inner["released"] and self.loop["guard_ratio"]:
            return float(np.interp(error / q_max, [-self.loop["guard_ratio"], 0.0], [0.0, 1.0]))
        if abs(error) >= self.loop["band_ratio"] * q_max:
            return 0.0
        return float(1 - quintic(inner["released_s"] / self.loop["decay_s"]))  # Eq. 31, 1 minus it

    def _heat_flux_error(self, nav: Values) -> float:
        q, q_max = nav["heat_flux_wpm2"], self.design["heat_flux_max_wpm2"]
        if self.share(q - q_max) == 0.0:
            return 0.0
        inner = self.memory["nominal"]
        gamma_off = nav["flight_path_angle_rad"] - inner["gamma_cmd_rad"]
        dh = self.loop["lead_s"] * nav["v_rel_mps"] * gamma_off  # Eq. 30
        lead = -self.rho_exponent * q / self.design["scale_height_m"] * dh
        fed = (q - q_max + lead) * self.share(q - q_max)
        guarded = inner["released"] and self.loop["guard_ratio"]
        return float(max(fed, 0.0) if guarded else fed)

    def gains(self, nav: Values) -> tuple[float, float]:
        """Bank per heat flux and per load, at this energy."""
        energy = energy_jpkg(nav)
        return self._gain("k_heat_flux_radm2pw", energy), self._gain("k_load_radpg", energy)

    def correct(self, nav: Values) -> None:
        """The larger correction of the two, into memory.  Eq. 28"""
        m = self.memory
        k_heat, k_load = self.gains(nav)
        m["heat_flux_error_wpm2"] = self._heat_flux_error(nav)
        by_heat = -k_heat * m["heat_flux_error_wpm2"]
        excess_g = max(0.0, m["nominal"]["load_factor_g"] - self.design["load_factor_max_g"])
        m["correction_rad"] = max(by_heat, -k_load * excess_g, key=abs)

    def step(self, nav: Values, dt: float) -> tuple[float, int]:
        """One step: the bank command and 1 where a cosine saturated."""
        m, inner = self.memory, self.memory["nominal"]
        code = self.nominal.step(nav, dt)
        if inner["phase"] < 2:
            return inner["bank_rad"], code
        self.correct(nav)
        return max(0.0, min(math.pi, inner["bank_rad"] + m["correction_rad"])), code
