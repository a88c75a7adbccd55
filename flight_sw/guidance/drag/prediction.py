"""The flight ahead in its vertical plane, in steps short enough to be dealt out over frames.

A path is integrated (RK4) from a fix to the speed or altitude where it shall end, with the bank of
the nominal flight and its cosine shifted by a constant. Air and aerodynamics are the load's, scaled
by what is sensed now.

Limits: plane motion (turning through the Coriolis term at the latitude and heading of the fix); the
coefficients of the fix are kept; what is sensed now holds to the end.
"""

import math

from flight_sw import icd
from flight_sw.guidance.drag.bank_profile import BANK_PROFILE, nominal_bank
from flight_sw.model.atmosphere import density
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

STEPS_MAX = 500  # of one path, then it ends where it is
V_MIN_MPS = 1.0  # floor of the speed in divisions, no effect above it

AIM = RecordSpec(
    "aim",
    Field("step_s", 0.01, 100.0, "of the prediction"),
    Field(
        "end_speed_mps",
        *icd.signal_range("NAV_VERTICAL", "v_rel_mps"),
        "a path ends at or below it; 0: never",
    ),
    Field("end_alt_m", *icd.signal_range("NAV_VERTICAL", "alt_m"), "a path ends at or below it"),
    Field("profile", record=BANK_PROFILE),
    Field("cos_bank_low", -1.0, 1.0),
    Field("cos_bank_high", -1.0, 1.0),
)

PLANE = RecordSpec(
    "plane",
    Field("drag_area_m2pkg", why="drag = area rho V^2"),
    Field("lift_area_m2pkg"),
    Field("turn_radps", why="Coriolis part of the path angle's rate"),
    Field("centrifugal_1ps2", why="over the distance to the axis, at the latitude"),
)
"""What is kept over one prediction."""

PATH = RecordSpec(
    "path",
    Field("alt_m"),
    Field("v_mps"),
    Field("gamma_rad"),
    Field("range_m"),
    Field("cos_shift", why="added to the cosine of the nominal bank"),
    Field("steps_count", kind="u4"),
    Field("ended", kind="u4"),
)

Rates = tuple[float, float, float, float]


@kernel
def shifted_cos_bank(aim: Record, v_mps: float, cos_shift: float) -> float:
    """Control of the nominal flight at this speed, shifted, within its limits."""
    cos_bank = math.cos(nominal_bank(aim["profile"], v_mps)) + cos_shift
    return min(max(cos_bank, aim["cos_bank_low"]), aim["cos_bank_high"])


@kernel
def start_path(path: Record, nav: Record, range_m: float, cos_shift: float) -> None:
    """Begin at a fix."""
    path["alt_m"] = nav["alt_m"]
    path["v_mps"] = nav["v_rel_mps"]
    path["gamma_rad"] = nav["flight_path_angle_rad"]
    path["range_m"] = range_m
    path["cos_shift"] = cos_shift
    path["steps_count"] = 0
    path["ended"] = 0


@kernel
def _rates(
    planet: Record,
    atmosphere: Record,
    plane: Record,
    alt_m: float,
    v_mps: float,
    gamma_rad: float,
    cos_bank: float,
) -> Rates:
    """Of altitude, speed, path angle and range."""
    v = max(v_mps, V_MIN_MPS)
    r = planet["radius_m"] + alt_m
    pressure = density(atmosphere, alt_m) * v * v
    down = planet["mu_m3ps2"] / (r * r) - plane["centrifugal_1ps2"] * r
    sin_gamma = math.sin(gamma_rad)
    cos_gamma = math.cos(gamma_rad)
    turn = plane["lift_area_m2pkg"] * pressure * cos_bank / v + (v / r - down / v) * cos_gamma
    return (
        v * sin_gamma,
        -plane["drag_area_m2pkg"] * pressure - down * sin_gamma,
        turn + plane["turn_radps"],
        v * cos_gamma * planet["radius_m"] / r,
    )


@kernel
def step_path(planet: Record, atmosphere: Record, aim: Record, plane: Record, path: Record) -> None:
    """One step of a path; at its end the state stands where the end was met."""
    dt = aim["step_s"]
    half = 0.5 * dt
    alt, v, gamma = path["alt_m"], path["v_mps"], path["gamma_rad"]
    cos_bank = shifted_cos_bank(aim, v, path["cos_shift"])
    a = _rates(planet, atmosphere, plane, alt, v, gamma, cos_bank)
    b = _rates(
        planet, atmosphere, plane,
        alt + half * a[0], v + half * a[1], gamma + half * a[2], cos_bank,
    )  # fmt: skip
    c = _rates(
        planet, atmosphere, plane,
        alt + half * b[0], v + half * b[1], gamma + half * b[2], cos_bank,
    )  # fmt: skip
    d = _rates(
        planet, atmosphere, plane, alt + dt * c[0], v + dt * c[1], gamma + dt * c[2], cos_bank
    )
    sixth = dt / 6.0
    alt_rise = sixth * (a[0] + 2.0 * (b[0] + c[0]) + d[0])
    v_rise = sixth * (a[1] + 2.0 * (b[1] + c[1]) + d[1])
    share = 1.0
    if v + v_rise <= aim["end_speed_mps"] and v_rise < 0.0:
        share = min(share, (aim["end_speed_mps"] - v) / v_rise)
    if alt + alt_rise <= aim["end_alt_m"] and alt_rise < 0.0:
        share = min(share, (aim["end_alt_m"] - alt) / alt_rise)
    path["steps_count"] += 1
    if share < 1.0 or path["steps_count"] >= STEPS_MAX:
        path["ended"] = 1
    share = max(share, 0.0)
    path["alt_m"] = alt + share * alt_rise
    path["v_mps"] = v + share * v_rise
    path["gamma_rad"] = gamma + share * sixth * (a[2] + 2.0 * (b[2] + c[2]) + d[2])
    path["range_m"] += share * sixth * (a[3] + 2.0 * (b[3] + c[3]) + d[3])
