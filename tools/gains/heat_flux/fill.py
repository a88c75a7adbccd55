"""Loads of the laws that track heat flux and load factor, filled from a design."""

import math
from typing import Any

from flight_sw.errors import DesignError
from flight_sw.guidance.heat_flux.peak import PEAK_BY
from flight_sw.records.types_ import Record
from sim_harness.mission.mission import Mission
from tools.gains.heat_flux import adaptive, lqy
from tools.gains.heat_flux.choices import Lqy, Nominal, Sag, Tracking
from tools.gains.schema import CommonDesign


def _nominal(record: Record, design: CommonDesign, mission: Mission, law: str) -> None:
    choice = design.table(Nominal, "nominal", law)
    limits, heating = mission.limits, mission.heating
    for name in ("heat_flux_max_kwpm2", "load_factor_max_g"):
        if not math.isfinite(getattr(limits, name)):
            raise DesignError(
                f"laws: {law} needs limits.{name}, which is infinite: allowed is a finite limit"
            )
    if heating is None:
        raise DesignError(f"laws: {law} needs a table [heating] in the mission")
    record["heat_flux_max_wpm2"] = limits.heat_flux_max_kwpm2 * 1e3
    record["load_factor_max_g"] = limits.load_factor_max_g
    # q = k rho^m V^n is constant where rho V^(n/m) is.
    exponent = heating.speed_exponent / heating.density_exponent
    record["heat_flux_exponent"] = exponent
    if not choice.release_exponent < exponent:
        raise DesignError(
            f"nominal.release_exponent is {choice.release_exponent:g}, allowed below "
            f"{exponent:g}, the exponent of a constant heat flux"
        )
    record["peak_scale_exponent"] = 1.0
    record["peak_by"] = PEAK_BY.index(choice.peak_by)
    for name, value in choice:
        if name == "peak_by":
            continue
        if name.endswith("_deg"):
            record[name.removesuffix("_deg") + "_rad"] = math.radians(value)
        elif name.endswith("_kwpm2"):
            record[name.removesuffix("_kwpm2") + "_wpm2"] = value * 1e3
        else:
            record[name] = value


def fill_nominal(body: Record, design: CommonDesign, mission: Mission, law: str) -> dict[str, Any]:
    """Law `nominal`."""
    _nominal(body["law"], design, mission, law)
    return {}


def fill_lqy(body: Record, design: CommonDesign, mission: Mission, law: str) -> dict[str, Any]:
    """Law `lqy`: the nominal one, and the gains of its inner loop."""
    choice = design.table(Lqy, "lqy", law)
    record = body["law"]
    _nominal(record["nominal"], design, mission, law)
    points = lqy.operating_points(body, record["nominal"], choice)
    lqy.fill(record["inner_loop"], choice, points)
    return {"operating_points": [vars(p) for p in points]}


def fill_adaptive(body: Record, design: CommonDesign, mission: Mission, law: str) -> dict[str, Any]:
    """Laws `sag` and `integrated`: what `lqy` has, and how they adapt and track."""
    sag, tracking = design.table(Sag, "sag", law), design.table(Tracking, "tracking", law)
    report = fill_lqy(body, design, mission, law)
    record = body["law"]
    adaptive.fill_weights(record["tracking"], sag)
    told = adaptive.fill_tracking(record, tracking, float(body["guidance_dt_s"]))
    return {**told, **report}
