"""Keys of a vehicle's aerodynamics: constant, Newtonian, tables, polynomials."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import model_validator

from flight_sw.model.onboard import AERO_TABLE, POWERS_ALPHA, POWERS_MACH
from sim_harness.mission.air_keys import AerodynamicDeviation
from sim_harness.mission.quantities import Quantity, Rows, Series, loaded, refusal, span_of
from sim_harness.mission.table_sizes import AERO_TABLE_MAX

SAMPLED_ALPHA_DEG = np.linspace(-5.0, 90.0, 77)
"""Angles of attack at which a load's table holds the coefficients of a formula: 1.25 deg apart, so
that 20 and 45 deg are knots; 3e-5 off between them."""
SAMPLED_MACH = np.linspace(0.0, 30.0, 61)
"""Mach numbers at which polynomials are looked at."""


class ConstantAerodynamics(AerodynamicDeviation):
    """The same coefficients at every angle of attack and Mach number."""

    model: Literal["constant"]
    lift_coefficient: Annotated[float, loaded(AERO_TABLE, "cl", "-", "C_L, negative: lift down")]
    drag_coefficient: Annotated[float, loaded(AERO_TABLE, "cd", "-", "C_D")]


class NewtonianAerodynamics(AerodynamicDeviation):
    """C_N = n1 s^2 + n2 s c, C_A = a1 c^2 + a2 s^2; s, c = sin, cos of the angle of attack."""

    model: Literal["newtonian"]
    n1: Annotated[float, Quantity("-", -100.0, 100.0, "normal force, sin^2 term")]
    n2: Annotated[float, Quantity("-", -100.0, 100.0, "normal force, sin cos term")]
    a1: Annotated[float, Quantity("-", -100.0, 100.0, "axial force, cos^2 term")]
    a2: Annotated[float, Quantity("-", -100.0, 100.0, "axial force, sin^2 term")]

    @model_validator(mode="after")
    def drags(self) -> Self:
        """The drag coefficient is not negative where the flight computer's table is sampled."""
        alpha_rad = np.radians(SAMPLED_ALPHA_DEG)
        s, c = np.sin(alpha_rad), np.cos(alpha_rad)
        drag = (self.n1 * s * s + self.n2 * s * c) * s + (self.a1 * c * c + self.a2 * s * s) * c
        if drag.min() < 0.0:
            worst_deg = SAMPLED_ALPHA_DEG[drag.argmin()]
            raise refusal(
                f"gives C_D {drag.min():.3g} at an angle of attack of {worst_deg:g} deg, "
                f"allowed 0 or more from {SAMPLED_ALPHA_DEG[0]:g} to {SAMPLED_ALPHA_DEG[-1]:g} deg"
            )
        return self


def coefficient_rows(name: str, what: str) -> Series:
    """A table of coefficients, one list per angle of attack."""
    meaning = f"{what}: a list per angle of attack, a value per Mach number"
    return Rows("-", *span_of(AERO_TABLE, name, "-"), meaning, AERO_TABLE_MAX)


class TableAerodynamics(AerodynamicDeviation):
    """Coefficients against angle of attack and Mach, bilinear, held at the edges."""

    model: Literal["table"]
    angle_of_attack_deg: Annotated[
        tuple[float, ...],
        Series(
            "deg",
            *span_of(AERO_TABLE, "alpha_rad", "deg"),
            "of the rows",
            AERO_TABLE_MAX,
            ascending=True,
        ),
    ]
    mach: Annotated[
        tuple[float, ...],
        Series(
            "-",
            *span_of(AERO_TABLE, "mach", "-"),
            "of the columns",
            AERO_TABLE_MAX,
            ascending=True,
        ),
    ]
    lift_coefficient: Annotated[tuple[tuple[float, ...], ...], coefficient_rows("cl", "C_L")]
    drag_coefficient: Annotated[tuple[tuple[float, ...], ...], coefficient_rows("cd", "C_D")]

    @model_validator(mode="after")
    def is_rectangular(self) -> Self:
        """One row per angle of attack, one value per Mach number."""
        wanted = (len(self.angle_of_attack_deg), len(self.mach))
        for key in ("lift_coefficient", "drag_coefficient"):
            rows = getattr(self, key)
            if len(rows) != wanted[0] or any(len(row) != wanted[1] for row in rows):
                lengths = sorted({len(row) for row in rows})
                raise refusal(
                    f".{key} has {len(rows)} rows of {lengths} values, "
                    f"allowed {wanted[0]} rows of {wanted[1]}"
                )
        return self


def power_rows(what: str) -> Series:
    """Coefficients of a polynomial, one list per power of the angle of attack."""
    meaning = f"{what}: a list per power of the angle of attack in deg, a value per power of Mach"
    return Rows("-", *span_of(AERO_TABLE, "cl_powers", "-"), meaning, POWERS_ALPHA)


class PolynomialAerodynamics(AerodynamicDeviation):
    """Coefficients as polynomials in angle of attack and Mach number, up to cubic by quadratic."""

    model: Literal["polynomial"]
    lift_powers: Annotated[tuple[tuple[float, ...], ...], power_rows("C_L")]
    drag_powers: Annotated[tuple[tuple[float, ...], ...], power_rows("C_D")]

    def powers(self, key: str) -> np.ndarray:
        """Shape (4, 3): of powers of the angle of attack in rad, and of the Mach number."""
        powers = np.zeros((POWERS_ALPHA, POWERS_MACH))
        for i, row in enumerate(getattr(self, key)):
            powers[i, : len(row)] = row
        return powers * np.degrees(1.0) ** np.arange(POWERS_ALPHA)[:, None]

    @model_validator(mode="after")
    def is_flyable(self) -> Self:
        """No more powers of Mach than are kept, and drag where it is looked at."""
        for key in ("lift_powers", "drag_powers"):
            longest = max(len(row) for row in getattr(self, key))
            if longest > POWERS_MACH:
                raise refusal(f".{key} has {longest} powers of Mach, allowed {POWERS_MACH}")
        alpha_rad = np.radians(SAMPLED_ALPHA_DEG)
        drag = np.polynomial.polynomial.polygrid2d(
            alpha_rad, SAMPLED_MACH, self.powers("drag_powers")
        )
        if drag.min() < 0.0:
            i, j = np.unravel_index(drag.argmin(), drag.shape)
            raise refusal(
                f"gives C_D {drag.min():.3g} at an angle of attack of {SAMPLED_ALPHA_DEG[i]:g} deg "
                f"and Mach {SAMPLED_MACH[j]:g}, allowed 0 or more from {SAMPLED_ALPHA_DEG[0]:g} "
                f"to {SAMPLED_ALPHA_DEG[-1]:g} deg and Mach 0 to {SAMPLED_MACH[-1]:g}"
            )
        return self
