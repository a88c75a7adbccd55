"""The factor of the heat-flux law, from the constants that a mission states."""

import math


def heating_factor(
    coefficient: float,
    nose_radius_m: float,
    rho_ref_kgpm3: float,
    v_ref_mps: float,
    density_exponent: float,
    velocity_exponent: float,
) -> float:
    """c1/sqrt(R_N)/rho_ref^a/V_ref^b in SI units."""
    reference = rho_ref_kgpm3**density_exponent * v_ref_mps**velocity_exponent
    return coefficient / math.sqrt(nose_radius_m) / reference
