"""Stagnation-point heat flux, cold wall: factor rho^a V^b.

Covers the Chapman form c1/sqrt(R_N) (rho/rho_ref)^a (V/V_ref)^b of [MOOIJ18] Eq. 7, Sutton-Graves
and k_Q sqrt(rho) V^3.15: the constants are folded into one factor on the ground.
"""

import math

from flight_sw.records.types_ import Record
from sim_harness.jit import kernel


@kernel
def heat_flux(heating: Record, rho_kgpm3: float, v_rel_mps: float) -> float:
    """Heat flux in W/m2; the common exponents 0.5 and 3 without a power function."""
    if heating["density_exponent"] == 0.5:
        density_part = math.sqrt(rho_kgpm3)
    else:
        density_part = math.pow(rho_kgpm3, heating["density_exponent"])
    if heating["velocity_exponent"] == 3.0:
        velocity_part = v_rel_mps * v_rel_mps * v_rel_mps
    else:
        velocity_part = math.pow(v_rel_mps, heating["velocity_exponent"])
    return heating["factor_si"] * density_part * velocity_part
