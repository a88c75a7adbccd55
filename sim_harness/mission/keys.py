"""What a mission file may say: every key with its unit, range, default and meaning.

docs/missions.md is generated from these classes.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from flight_sw import icd
from flight_sw.guidance.heat_flux import nominal
from flight_sw.limits import AXIS_LIMITS
from flight_sw.load_image import ATMOSPHERE_TABLE
from flight_sw.model.atmosphere import KNOTS_MAX
from flight_sw.model.onboard import HEATING, PLANET, VEHICLE
from sim_harness.mission.aero_keys import (
    ConstantAerodynamics,
    NewtonianAerodynamics,
    PolynomialAerodynamics,
    TableAerodynamics,
)
from sim_harness.mission.air_keys import DensityDeviation
from sim_harness.mission.heating_factor import heating_factor
from sim_harness.mission.quantities import (
    INF,
    Quantity,
    Section,
    Series,
    Text,
    carried,
    in_unit,
    is_name,
    loaded,
    plain,
    refusal,
    span_of,
)

SOUND_SPEED_MPS = (10.0, 1e4)
ALTITUDE_MAX_KM = in_unit(icd.signal_range("NAV_VERTICAL", "alt_m")[1], "km")
SPEED_MAX_MPS = icd.signal_range("NAV_VERTICAL", "v_rel_mps")[1]
TIME_MAX_S = icd.signal_range("NAV_TIME", "t_s")[1]


class Planet(Section):
    """The planet and its rotation."""

    radius_km: Annotated[
        float,
        loaded(PLANET, "radius_m", "km", "sphere that altitude, ground range and J2 refer to"),
    ]
    mu_m3ps2: Annotated[float, loaded(PLANET, "mu_m3ps2", "m3/s2", "gravitational parameter")]
    rotation_radps: Annotated[
        float,
        loaded(
            PLANET, "rotation_radps", "rad/s", "rotation, positive eastwards; the air turns with it"
        ),
    ]
    j2: Annotated[float, Quantity("-", 0.0, 0.1, "oblateness of the field; 0 switches it off")] = (
        0.0
    )
    g0_mps2: Annotated[float, loaded(PLANET, "g0_mps2", "m/s2", "unit of the load factor")] = (
        9.80665
    )


class ExponentialAtmosphere(DensityDeviation):
    """Density falls by 1/e every scale height."""

    model: Literal["exponential"]
    density_ref_kgpm3: Annotated[float, Quantity("kg/m3", 1e-12, 1e3, "density at altitude 0")]
    scale_height_m: Annotated[float, Quantity("m", 100.0, 1e5, "scale height")]
    sound_speed_mps: Annotated[
        float, Quantity("m/s", *SOUND_SPEED_MPS, "speed of sound at all altitudes")
    ]


class Us76Atmosphere(DensityDeviation):
    """U.S. Standard Atmosphere 1976 to 1,000 km; above 86 km the speed of sound is held."""

    model: Literal["us76"]


class TableAtmosphere(DensityDeviation):
    """A table of one's own: in the mission file, or a CSV file with the same names as header."""

    model: Literal["table"]
    csv: Annotated[
        str | None, Text("path relative to the mission file, instead of the lists", "a path")
    ] = None
    altitude_km: Annotated[
        tuple[float, ...] | None,
        Series(
            "km",
            *span_of(ATMOSPHERE_TABLE, "alt_m", "km"),
            "altitude of each row",
            KNOTS_MAX,
            2,
            ascending=True,
        ),
    ] = None
    density_kgpm3: Annotated[
        tuple[float, ...] | None, Series("kg/m3", 1e-30, 1e3, "density of each row", KNOTS_MAX, 2)
    ] = None
    sound_speed_mps: Annotated[
        tuple[float, ...] | None,
        Series(
            "m/s",
            *SOUND_SPEED_MPS,
            "speed of sound of each row, or else temperature_k",
            KNOTS_MAX,
            2,
        ),
    ] = None
    temperature_k: Annotated[
        tuple[float, ...] | None, Series("K", 1.0, 1e5, "temperature of each row", KNOTS_MAX, 2)
    ] = None
    gas_constant_jpkgk: Annotated[
        float, Quantity("J/(kg K)", 10.0, 1e4, "of the gas, used with temperature_k")
    ] = 287.05287
    heat_capacity_ratio: Annotated[
        float, Quantity("-", 1.01, 1.67, "of the gas, used with temperature_k")
    ] = 1.4

    @model_validator(mode="after")
    def is_complete(self) -> Self:
        """Either a CSV file or lists of one length."""
        if self.csv is not None:
            return self
        if self.altitude_km is None or self.density_kgpm3 is None:
            raise refusal("has no rows, allowed csv or altitude_km and density_kgpm3")
        if (self.sound_speed_mps is None) == (self.temperature_k is None):
            raise refusal("has no or two thermal columns, allowed sound_speed_mps or temperature_k")
        thermal = self.sound_speed_mps or self.temperature_k or ()
        lengths = {len(self.altitude_km), len(self.density_kgpm3), len(thermal)}
        if len(lengths) > 1:
            raise refusal(f"has lists of {sorted(lengths)} values, allowed lists of one length")
        return self


class Vehicle(Section):
    """Mass and aerodynamics."""

    mass_kg: Annotated[float, loaded(VEHICLE, "mass_kg", "kg", "mass at entry")]
    reference_area_m2: Annotated[
        float,
        loaded(VEHICLE, "reference_area_m2", "m2", "area that the coefficients refer to"),
    ]
    side_lift_ratio: Annotated[
        float,
        Quantity("-", 0.0, 1.0, "share of the lift's sideways part that acts; 0: stays in plane"),
    ] = 1.0
    aerodynamics: Annotated[
        ConstantAerodynamics | NewtonianAerodynamics | TableAerodynamics | PolynomialAerodynamics,
        Field(discriminator="model"),
    ]


class Heating(Section):
    """Heat flux = coefficient / sqrt(nose radius) (rho/density_ref)^a (V/speed_ref)^b in W/m2."""

    coefficient: Annotated[
        float, Quantity("W/m^1.5", 0.0, 1e15, "in front; with references of 1 in SI units")
    ]
    nose_radius_m: Annotated[float, Quantity("m", 1e-4, 1e3, "nose radius")]
    density_ref_kgpm3: Annotated[float, Quantity("kg/m3", 1e-6, 1e3, "reference density")] = 1.0
    speed_ref_mps: Annotated[float, Quantity("m/s", 1.0, 1e5, "reference speed")] = 1.0
    density_exponent: Annotated[float, loaded(HEATING, "rho_exponent", "-", "a")] = 0.5
    speed_exponent: Annotated[float, loaded(HEATING, "v_exponent", "-", "b")] = 3.0

    @property
    def factor_si(self) -> float:
        """The heat flux at 1 kg/m3 and 1 m/s, W/m2."""
        return heating_factor(
            self.coefficient,
            self.nose_radius_m,
            self.density_ref_kgpm3,
            self.speed_ref_mps,
            self.density_exponent,
            self.speed_exponent,
        )

    @model_validator(mode="after")
    def is_carried_by_a_load(self) -> Self:
        """All keys together give a factor that the flight computer's load takes."""
        _, most = span_of(HEATING, "coefficient", "-")
        if not self.factor_si <= most:
            raise refusal(
                f"gives {self.factor_si:g} W/m2 at 1 kg/m3 and 1 m/s, allowed up to {most:g}"
            )
        return self


class Entry(Section):
    """State at time zero."""

    frame: Literal["relative", "inertial"] = "relative"
    altitude_km: Annotated[
        float, Quantity("km", 1.0, ALTITUDE_MAX_KM, "above the sphere of radius_km")
    ]
    longitude_deg: Annotated[float, Quantity("deg", -180.0, 180.0, "positive to the east")]
    latitude_deg: Annotated[float, Quantity("deg", -90.0, 90.0, "geocentric")]
    speed_mps: Annotated[float, Quantity("m/s", 10.0, SPEED_MAX_MPS, "in the frame named")]
    flight_path_angle_deg: Annotated[
        float, Quantity("deg", -90.0, 0.0, "of that velocity, positive up")
    ]
    heading_deg: Annotated[
        float, Quantity("deg", -360.0, 360.0, "of that velocity, from north to the east")
    ]
    bank_deg: Annotated[float, Quantity("deg", -180.0, 180.0, "positive: lift to the right")] = 0.0
    angle_of_attack_deg: Annotated[float, Quantity("deg", -180.0, 180.0, "angle of attack")] = 0.0


class Limits(Section):
    """Path constraints: what guidance is asked to keep and the summary judges."""

    heat_flux_max_kwpm2: Annotated[
        float,
        loaded(
            nominal.DESIGN,
            "heat_flux_max_wpm2",
            "kW/m2",
            "stagnation point; inf: none",
            or_inf=True,
        ),
    ] = INF
    load_factor_max_g: Annotated[
        float,
        loaded(
            nominal.DESIGN,
            "load_factor_max_g",
            "g",
            "in units of g0_mps2; inf: none",
            or_inf=True,
        ),
    ] = INF
    dynamic_pressure_max_kpa: Annotated[float, Quantity("kPa", 0.01, INF, "inf: none")] = INF


YES_NO = ("no", "yes")


class Target(Section):
    """Where and how fast the flight shall end; without this table no terminal errors are told."""

    longitude_deg: Annotated[float, Quantity("deg", -180.0, 180.0, "positive to the east")]
    latitude_deg: Annotated[float, Quantity("deg", -90.0, 90.0, "geocentric")]
    altitude_km: Annotated[
        float, carried("NAV_VERTICAL", "alt_m", "km", "above the sphere of radius_km")
    ]
    speed_mps: Annotated[float, carried("NAV_VERTICAL", "v_rel_mps", "m/s", "relative speed")]
    final_path_angle_deg: Annotated[
        float | None, Quantity("deg", -90.0, 90.0, "none: its error is not told")
    ] = None
    final_heading_deg: Annotated[
        float | None, Quantity("deg", -360.0, 360.0, "from north; none: its error is not told")
    ] = None


class End(Section):
    """The flight ends with whichever comes first; it always ends on the ground."""

    speed_mps: Annotated[
        float,
        carried("NAV_VERTICAL", "v_rel_mps", "m/s", "relative speed at or below; 0: never"),
    ] = 0.0
    altitude_km: Annotated[
        float, Quantity("km", -INF, ALTITUDE_MAX_KM, "altitude at or below; -inf: never")
    ] = -INF
    jacobi_energy_mjpkg: Annotated[
        float,
        Quantity("MJ/kg", -1e4, 1e4, "energy in the turning frame at or below; -1e4: never"),
    ] = -1e4
    at_target: Annotated[
        str,
        Text(
            "ends as well where it has flown the target's downrange", "no, yes", YES_NO.__contains__
        ),
    ] = "no"
    at_target_energy: Annotated[
        str,
        Text(
            "ends as well with the energy of the target's speed there", "no, yes",
            YES_NO.__contains__,
        ),
    ] = "no"  # fmt: skip
    time_max_s: Annotated[float, Quantity("s", 0.02, TIME_MAX_S, "time after entry: timed out")] = (
        10000.0
    )


class Axis(Section):
    """How an attitude angle follows its command; the defaults follow at once."""

    lag_s: Annotated[float, Quantity("s", 0.0, 1000.0, "first-order lag; 0: none")] = 0.0
    rate_max_degps: Annotated[
        float, loaded(AXIS_LIMITS, "rate_max_radps", "deg/s", "inf: no limit", or_inf=True)
    ] = INF
    accel_max_degps2: Annotated[
        float, loaded(AXIS_LIMITS, "accel_max_radps2", "deg/s2", "inf: no limit", or_inf=True)
    ] = INF
    low_deg: Annotated[float, loaded(AXIS_LIMITS, "low_rad", "deg", "lower stop")] = -180.0
    high_deg: Annotated[
        float,
        loaded(AXIS_LIMITS, "high_rad", "deg", "upper stop; a full turn apart: turns freely"),
    ] = 180.0

    @model_validator(mode="after")
    def is_ordered(self) -> Self:
        """The lower stop lies below the upper one."""
        if not self.low_deg < self.high_deg:
            raise refusal(
                f".low_deg is {plain(self.low_deg)}, allowed below high_deg {plain(self.high_deg)}"
            )
        return self


class Actuators(Section):
    """Bank and angle of attack."""

    bank: Axis = Axis()
    alpha: Axis = Axis()


class Guidance(Section):
    """The law that flies by default, and where its load images are."""

    law: Annotated[str, Text("law flown unless another is asked for", "a name", is_name)]
    gains: Annotated[
        str | None,
        Text("folder of design and load images, relative to the mission file", "a path"),
    ] = None
    rate_hz: Annotated[
        float, Quantity("Hz", 1.0, 1000.0, "minor frames a second, and integration steps")
    ] = 50.0
