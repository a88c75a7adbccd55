"""What the computer believes of vehicle and planet, against closed forms and scipy."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from flight_sw.model.onboard import (
    ALPHA_ROWS,
    FORCES,
    MACH_ROWS,
    ONBOARD,
    heat_flux,
    modelled_forces,
    specific_energy,
)
from sim_harness.world import atmosphere

ALPHAS_RAD = np.radians([0.0, 10.0, 25.0, 45.0])
MACHS = np.array([2.0, 5.0, 20.0])
RHO0_KGPM3, SCALE_M, SOUND_MPS = 1.2, 7000.0, 300.0


def onboard_with(n_mach: int) -> Any:
    """A vehicle with a table of random coefficients, in the first rows of the record."""
    rng = np.random.default_rng(20260304)
    record = np.zeros(1, ONBOARD.dtype)[0]
    record["planet"] = (6.0e6, 4.0e14, 1e-4, 9.8, 0.0)
    record["heating"] = (2.0e-4, 0.5, 3.0)
    record["vehicle"]["mass_kg"] = 500.0
    record["vehicle"]["reference_area_m2"] = 2.0
    aero = record["vehicle"]["aero"]
    aero["n_alpha"], aero["n_mach"] = len(ALPHAS_RAD), n_mach
    aero["alpha_rad"][: len(ALPHAS_RAD)] = ALPHAS_RAD
    aero["mach"][:n_mach] = MACHS[:n_mach]
    for name in ("cl", "cd"):
        table = np.full((ALPHA_ROWS, MACH_ROWS), math.nan)  # what is not in use is not read
        table[: len(ALPHAS_RAD), :n_mach] = rng.uniform(0.2, 1.5, (len(ALPHAS_RAD), n_mach))
        aero[name] = table.ravel()
    return record


def forces_at(onboard: Any, alt_m: float, v_mps: float, alpha_rad: float) -> Any:
    """The forces record of one call, in exponential air."""
    air = atmosphere.exponential(RHO0_KGPM3, SCALE_M, SOUND_MPS)
    forces = np.zeros(1, FORCES.dtype)
    modelled_forces(onboard, air[0], alt_m, v_mps, alpha_rad, forces[0])
    return forces[0]


def expected(onboard: Any, name: str, alpha_rad: float, mach: float) -> float:
    """Bilinear value inside the grid, edge value outside, by scipy."""
    aero = onboard["vehicle"]["aero"]
    n_mach = int(aero["n_mach"])
    table = aero[name].reshape(ALPHA_ROWS, MACH_ROWS)[: len(ALPHAS_RAD), :n_mach]
    alpha = np.clip(alpha_rad, ALPHAS_RAD[0], ALPHAS_RAD[-1])
    if n_mach == 1:
        return float(np.interp(alpha, ALPHAS_RAD, table[:, 0]))
    mach = float(np.clip(mach, MACHS[0], MACHS[n_mach - 1]))
    return float(RegularGridInterpolator((ALPHAS_RAD, MACHS[:n_mach]), table)((alpha, mach)))


@pytest.mark.parametrize("n_mach", [1, 2, 3])
def test_forces_are_those_of_a_bilinear_table_in_this_air(n_mach: int) -> None:
    onboard = onboard_with(n_mach)
    rng = np.random.default_rng(20260305)
    for _ in range(60):
        alt_m, v_mps = rng.uniform(1e3, 9e4), rng.uniform(300.0, 7500.0)
        alpha_rad = rng.choice([rng.uniform(-0.3, 1.1), *ALPHAS_RAD])
        forces = forces_at(onboard, alt_m, v_mps, alpha_rad)
        rho = RHO0_KGPM3 * math.exp(-alt_m / SCALE_M)
        scale = rho * v_mps**2 / 2 * 2.0 / 500.0
        cd = expected(onboard, "cd", alpha_rad, v_mps / SOUND_MPS)
        cl = expected(onboard, "cl", alpha_rad, v_mps / SOUND_MPS)
        assert forces["rho_kgpm3"] == pytest.approx(rho, rel=1e-11)
        assert forces["drag_mps2"] == pytest.approx(scale * cd, rel=1e-11)
        assert forces["lift_mps2"] == pytest.approx(scale * cl, rel=1e-11)
        assert forces["drag_area_m2"] == pytest.approx(2.0 * cd, rel=1e-11)
        assert forces["gravity_mps2"] == pytest.approx(4.0e14 / (6.0e6 + alt_m) ** 2, rel=1e-14)


def test_heat_flux_is_that_of_the_paper() -> None:
    # [MOOIJ18] Eq. 7 with its constants; 1,700 kW/m2 at 7,500 m/s lies near 68.8 km in [US76].
    c1, r_n, rho0, v_c = 1.06584e8, 0.238, 1.225, 7905.0
    record = onboard_with(1)
    record["heating"] = (c1 / math.sqrt(r_n) / math.sqrt(rho0) / v_c**3, 0.5, 3.0)
    rho = 1.0e-4
    assert heat_flux(record, rho, 7500.0) == pytest.approx(
        c1 / math.sqrt(r_n) * math.sqrt(rho / rho0) * (7500.0 / v_c) ** 3, rel=1e-12
    )


@pytest.mark.parametrize("alt_m", [-500.0, 0.0, 1.0, 5e4, 3e5])
def test_energy_is_kinetic_and_potential_above_the_sphere(alt_m: float) -> None:
    planet = onboard_with(1)["planet"]
    expected_jpkg = 5000.0**2 / 2 + 4.0e14 / 6.0e6 - 4.0e14 / (6.0e6 + alt_m)
    assert specific_energy(planet, alt_m, 5000.0) == pytest.approx(expected_jpkg, rel=1e-12)
