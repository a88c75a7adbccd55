"""Gains of the LQY inner loop: a linear-quadratic output regulator along the two path limits.

Source: [MOOIJ18] Eqs. 28-30; the matrices are derived in docs/laws/heat_flux.md (the paper gives
neither them nor the weights). At each speed the vehicle is put where it should be: on the heat-flux
limit, or on the load limit where that is higher in the sky, at the path angle and bank that hold it
there.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt

from flight_sw.errors import DesignError
from flight_sw.guidance.heat_flux import nominal
from flight_sw.model.onboard import FORCES, heat_flux, modelled_forces, specific_energy
from flight_sw.records.types_ import Record
from tools.gains.heat_flux.choices import Lqy
from tools.gains.rounding import rounded

LOWEST_ALTITUDE_M = 0.0
HIGHEST_ALTITUDE_M = 150e3

Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True)
class OperatingPoint:
    """One row of the schedule, with what a reviewer asks of it."""

    speed_mps: float
    altitude_m: float
    energy_jpkg: float
    heat_flux_wpm2: float
    load_factor_g: float
    path_angle_deg: float
    bank_deg: float
    k_heat_flux_radm2pw: float
    k_load_radpg: float
    closed_loop_eigenvalues_ps: list[list[float]]
    gain_margin_low: float
    phase_margin_deg: float


def scaled_projection(state_gain: Matrix, output: Matrix, scale: Matrix) -> float:
    """The scalar output gain nearest to a state gain, in scaled states.

    A 1x2 state gain is not parallel to the output row, so the scalar is a convention: least squares
    after scaling speed and pseudo altitude alike.
    """
    gain, row = state_gain * scale, output * scale
    return float(gain @ row / (row @ row))


class Along:
    """The path of the limits for one load body (a record of flight_sw.load_image.body_spec)."""

    def __init__(self, body: Record, design: Record, choice: Lqy) -> None:
        self.onboard = body["onboard"]
        self.atmosphere = body["atmosphere"]
        self.design = design
        self.choice = choice
        self.forces = np.zeros(1, FORCES.dtype)

    def model(self, altitude_m: float, speed_mps: float) -> Record:
        """Modelled forces at the angle of attack flown after the peak."""
        alpha_rad = float(self.design["alpha_after_peak_rad"])
        forces = self.forces[0]
        modelled_forces(self.onboard, self.atmosphere, altitude_m, speed_mps, alpha_rad, forces)
        return forces

    def heat_flux_wpm2(self, altitude_m: float, speed_mps: float) -> float:
        """Modelled heat flux."""
        rho_kgpm3 = float(self.model(altitude_m, speed_mps)["rho_kgpm3"])
        return float(heat_flux(self.onboard, rho_kgpm3, speed_mps))

    def load_factor_g(self, altitude_m: float, speed_mps: float) -> float:
        """Modelled load factor."""
        forces = self.model(altitude_m, speed_mps)
        return math.hypot(forces["drag_mps2"], forces["lift_mps2"]) / float(
            self.onboard["planet"]["g0_mps2"]
        )

    def altitude_m(self, speed_mps: float) -> tuple[float, float]:
        """Altitude where the first of the two limits is met, and the exponent n of that limit."""

        from scipy.optimize import brentq

        def where(value: float, name: str) -> float:
            def excess(altitude_m: float) -> float:
                quantity = getattr(self, name)(altitude_m, speed_mps)
                return math.log(max(quantity, 1e-30) / value)

            if excess(LOWEST_ALTITUDE_M) < 0.0:
                return LOWEST_ALTITUDE_M
            if excess(HIGHEST_ALTITUDE_M) > 0.0:
                raise DesignError(
                    f"lqy.speeds_mps: at {speed_mps:g} m/s the limit lies above "
                    f"{HIGHEST_ALTITUDE_M / 1e3:g} km"
                )
            return float(
                brentq(excess, LOWEST_ALTITUDE_M, HIGHEST_ALTITUDE_M, xtol=1e-9, rtol=1e-14)
            )

        by_heat = where(float(self.design["heat_flux_max_wpm2"]), "heat_flux_wpm2")
        by_load = where(float(self.design["load_factor_max_g"]), "load_factor_g")
        if by_heat >= by_load:
            return by_heat, float(self.design["heat_flux_exponent"])
        return by_load, nominal.N_LOAD

    def path(self, altitude_m: float, speed_mps: float, n: float) -> tuple[float, float]:
        """Path angle and bank (clipped for the design) that stay on rho V^n, eastward, equator."""
        forces = self.model(altitude_m, speed_mps)
        planet = self.onboard["planet"]
        gravity, lift = float(forces["gravity_mps2"]), float(forces["lift_mps2"])
        k_kgpm2 = float(self.onboard["vehicle"]["mass_kg"]) / float(forces["drag_area_m2"])
        constant = float(forces["rho_kgpm3"]) * speed_mps**n
        gamma_rad, slope = nominal.path_angle_command(
            constant, n, speed_mps, k_kgpm2, gravity, float(self.design["scale_height_m"])
        )
        rate_mps2 = -float(forces["drag_mps2"]) - gravity * math.sin(gamma_rad)
        radius_m = float(planet["radius_m"]) + altitude_m
        omega = float(planet["rotation_radps"])
        other = (
            (speed_mps**2 / radius_m - gravity) * math.cos(gamma_rad)
            + 2.0 * omega * speed_mps
            + omega**2 * radius_m * math.cos(gamma_rad)
        )
        cos_bank = (speed_mps * slope * rate_mps2 - other) / max(lift, 1e-9)
        bank_rad = math.acos(min(max(cos_bank, -1.0), 1.0))
        low = math.radians(self.choice.bank_design_low_deg)
        high = math.radians(self.choice.bank_design_high_deg)
        return gamma_rad, min(max(bank_rad, low), high)

    def linearised(self, speed_mps: float) -> tuple[Matrix, Matrix, Matrix, OperatingPoint]:
        """A, B, C for x = (dV, dh*), u = dbank, y = (dq, dn), and the point they belong to."""
        altitude_m, n = self.altitude_m(speed_mps)
        gamma_rad, bank_rad = self.path(altitude_m, speed_mps, n)
        q_wpm2 = self.heat_flux_wpm2(altitude_m, speed_mps)
        load_g = self.load_factor_g(altitude_m, speed_mps)
        forces = self.model(altitude_m, speed_mps)
        drag, lift = float(forces["drag_mps2"]), float(forces["lift_mps2"])
        h_s, c_g = float(self.design["scale_height_m"]), self.choice.lead_s
        radius_m = float(self.onboard["planet"]["radius_m"]) + altitude_m
        a = np.array(
            [
                [-2.0 * drag / speed_mps, drag / h_s],
                [
                    c_g * (2.0 * lift * math.cos(bank_rad) / speed_mps + 2.0 * speed_mps / radius_m)
                    + gamma_rad,
                    -c_g * lift * math.cos(bank_rad) / h_s,
                ],
            ]
        )
        b = np.array([[0.0], [-c_g * lift * math.sin(bank_rad)]])
        rho_exponent = float(self.onboard["heating"]["rho_exponent"])
        v_exponent = float(self.onboard["heating"]["v_exponent"])
        c = np.array(
            [
                [v_exponent * q_wpm2 / speed_mps, -rho_exponent * q_wpm2 / h_s],
                [2.0 * load_g / speed_mps, -load_g / h_s],
            ]
        )
        energy = specific_energy(self.onboard["planet"], altitude_m, speed_mps)
        point = OperatingPoint(
            speed_mps,
            rounded(altitude_m),
            rounded(energy),
            rounded(q_wpm2),
            rounded(load_g),
            rounded(math.degrees(gamma_rad)),
            rounded(math.degrees(bank_rad)),
            0.0,
            0.0,
            [],
            0.0,
            0.0,
        )
        return a, b, c, point


def regulator(
    a: Matrix, b: Matrix, output: Matrix, error_max: float, bank_max_rad: float
) -> Matrix:
    """State gain of the output regulator with Bryson's weights, from the Riccati equation."""
    import control  # slow to import: a flight with stored gains does not wait for it

    q = np.outer(output, output) / error_max**2
    r = np.array([[1.0 / bank_max_rad**2]])
    gain, _, _ = control.lqr(a, b, q, r)
    return np.asarray(gain, dtype=np.float64)[0]


def margins(a: Matrix, b: Matrix, row: Matrix) -> tuple[float, float]:
    """Lower gain margin (0: none below) and phase margin in degrees of the scalar loop."""
    import control

    loop = control.ss(a, b, row.reshape(1, 2), 0.0)
    gain_margin, phase_margin, *_ = control.margin(loop)
    low = float(gain_margin) if math.isfinite(gain_margin) and gain_margin < 1.0 else 0.0
    return low, float(phase_margin) if math.isfinite(phase_margin) else 180.0


def operating_points(body: Record, design: Record, choice: Lqy) -> list[OperatingPoint]:
    """The schedule, in order of ascending energy."""
    along = Along(body, design, choice)
    bank_max_rad = math.radians(choice.bank_error_max_deg)
    points = []
    for speed_mps in choice.speeds_mps:
        a, b, c, point = along.linearised(speed_mps)
        scale = np.array([speed_mps / choice.speed_scale_ratio, float(design["scale_height_m"])])
        errors = (choice.heat_flux_error_max_kwpm2 * 1e3, choice.load_error_max_g)
        gains = [
            scaled_projection(regulator(a, b, row, error, bank_max_rad), row, scale)
            for row, error in zip(c, errors, strict=True)
        ]
        if min(gains) < 0.0:
            raise DesignError(f"lqy: gain at {speed_mps:g} m/s is negative ({min(gains):g})")
        row = gains[0] * c[0]
        poles = np.linalg.eigvals(a - b @ row.reshape(1, 2))
        low, phase = margins(a, b, row)
        points.append(
            OperatingPoint(
                **{
                    **asdict(point),
                    "k_heat_flux_radm2pw": rounded(gains[0]),
                    "k_load_radpg": rounded(gains[1]),
                    "closed_loop_eigenvalues_ps": sorted(
                        [round(float(p.real), 6), round(float(p.imag), 6)] for p in poles
                    ),
                    "gain_margin_low": round(low, 4),
                    "phase_margin_deg": round(phase, 3),
                }
            )
        )
    return sorted(points, key=lambda p: p.energy_jpkg)


def fill(loop: Record, choice: Lqy, points: list[OperatingPoint]) -> None:
    """Write the schedule into an inner-loop record."""
    n = len(points)
    loop["n_rows"] = n
    loop["energy_jpkg"][:n] = [p.energy_jpkg for p in points]
    loop["k_heat_flux_radm2pw"][:n] = [p.k_heat_flux_radm2pw for p in points]
    loop["k_load_radpg"][:n] = [p.k_load_radpg for p in points]
    loop["lead_s"] = choice.lead_s
    loop["band_ratio"] = choice.band_ratio
    loop["decay_s"] = choice.decay_s
