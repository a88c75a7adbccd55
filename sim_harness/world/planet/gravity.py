"""Gravity of a point mass with the oblateness term J2, in spherical components.

Potential: -mu/R (1 - J2 (Re/R)^2 (3 sin^2 lat - 1)/2), latitude geocentric. J2 = 0 switches it off.
"""

import math

from flight_sw.records.types_ import Record
from sim_harness.jit import kernel


@kernel
def gravity(planet: Record, radius_m: float, sin_lat: float, cos_lat: float) -> tuple[float, float]:
    """Acceleration towards the centre and towards the north, m/s2, without centrifugal part."""
    central = planet["mu_m3ps2"] / (radius_m * radius_m)
    j2 = planet["j2"]
    if j2 == 0.0:
        return central, 0.0
    ratio = planet["radius_m"] / radius_m
    oblate = 1.5 * j2 * ratio * ratio
    down = central * (1.0 - oblate * (3.0 * sin_lat * sin_lat - 1.0))
    north = -2.0 * central * oblate * sin_lat * cos_lat
    return down, north


@kernel
def potential(planet: Record, radius_m: float, sin_lat: float) -> float:
    """Potential of the same field, J/kg, zero at infinity."""
    ratio = planet["radius_m"] / radius_m
    oblate = 0.5 * planet["j2"] * ratio * ratio * (3.0 * sin_lat * sin_lat - 1.0)
    return -planet["mu_m3ps2"] / radius_m * (1.0 - oblate)


@kernel
def jacobi_energy(
    planet: Record, radius_m: float, sin_lat: float, cos_lat: float, v_rel_mps: float
) -> float:
    """Energy in the rotating frame, J/kg: constant without aerodynamic forces."""
    spin_mps = planet["rotation_radps"] * radius_m * cos_lat
    kinetic = 0.5 * (v_rel_mps * v_rel_mps - spin_mps * spin_mps)
    return kinetic + potential(planet, radius_m, sin_lat)


@kernel
def haversine_m(
    radius_m: float, lon_rad: float, lat_rad: float, lon_to_rad: float, lat_to_rad: float
) -> float:
    """Great-circle distance between two places on a sphere, [MOOIJ18] Eqs 25-27.

    The arctangent of the paper is written as the arcsine it equals: exact for short distances,
    good to 0.2 m at the antipode of the Earth.
    """
    half_lat = math.sin(0.5 * (lat_to_rad - lat_rad))
    half_lon = math.sin(0.5 * (lon_to_rad - lon_rad))
    a = half_lat * half_lat + math.cos(lat_rad) * math.cos(lat_to_rad) * half_lon * half_lon
    return 2.0 * radius_m * math.asin(math.sqrt(min(a, 1.0)))
