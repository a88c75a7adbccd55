"""Load of the law that plans onboard: planner, the ground's plan, gains over energy."""

import math
from typing import Any

import numpy as np

from flight_sw.errors import DesignError
from flight_sw.guidance.planned import plan_job
from flight_sw.load_image import body_spec
from flight_sw.model.atmosphere import density, sound_speed
from flight_sw.model.profile import BY_ENERGY, BY_TIME, merge_breaks
from flight_sw.records.types_ import Record
from sim_harness.mission.mission import Mission
from sim_harness.world import atmosphere
from tools.gains.planned.choices import Plan, Tracker
from tools.gains.planned.gain_table import fill_gains
from tools.gains.planned.offline import (
    Planned,
    fix_at_entry,
    iterations_of,
    plan_offline,
    with_banks,
)
from tools.gains.rounding import rounded
from tools.gains.schema import CommonDesign

BANK_DIGITS = 6  # of a radian: where plans of all processors agree
COARSE_DIGITS = 3  # of what hangs on small differences
HEAT_FLUX_UNIT_WPM2 = 1e4  # e_c in (W/cm2)^2 s, as in the source
AIR_LOW_M, AIR_ABOVE_ENTRY_M = -2000.0, 20e3


def smooth_air(air: Record, top_m: float, step_m: float) -> np.ndarray:
    """The air as a spline of ln(density) that is twice smooth, shape (1,).

    The standard's layers meet in kinks: a step of a flight ahead across one loses its order.
    """
    alts_m = np.arange(AIR_LOW_M, top_m + step_m, step_m)
    rho = np.array([density(air, float(alt_m)) for alt_m in alts_m])
    sound = np.array([sound_speed(air, float(alt_m)) for alt_m in alts_m])
    return atmosphere.table(alts_m, rho, sound)


def fill_profile(record: Record, choice: Plan) -> None:
    """The PROFILE of the first guess."""
    record["index_by"] = BY_ENERGY if choice.index == "energy" else BY_TIME
    record["energy_ref_jpkg"] = choice.energy_ref_mjpkg * 1e6
    record["index_speed_mps"] = choice.index_speed_mps
    record["index_unit_mps"] = choice.index_unit_mps
    record["time_unit_s"] = 1.0
    for axis in ("bank", "alpha"):
        places, values = getattr(choice, f"{axis}_index"), getattr(choice, f"{axis}_deg")
        record[f"n_{axis}"] = len(places)
        record[f"{axis}_index"][: len(places)] = places
        record[f"{axis}_rad"][: len(values)] = np.radians(values)
    merge_breaks(record)


def fill_planner(record: Record, choice: Plan, mission: Mission) -> None:
    """The PLANNER record."""
    target = mission.target
    if target is None:
        raise DesignError(f"{mission.path.name}: planned-lqr needs a table [target]")
    if mission.heating is None:
        raise DesignError(f"{mission.path.name}: planned-lqr needs a table [heating]")
    if not math.isfinite(mission.limits.heat_flux_max_kwpm2):
        raise DesignError(
            "laws: planned-lqr needs limits.heat_flux_max_kwpm2, which is infinite: allowed is a "
            "finite limit"
        )
    record["target_lat_rad"] = math.radians(target.latitude_deg)
    record["target_lon_rad"] = math.remainder(math.radians(target.longitude_deg), 2.0 * math.pi)
    record["end_alt_m"] = target.altitude_km * 1e3
    record["bank_max_rad"] = math.radians(choice.bank_max_deg)
    record["end_bank_rad"] = math.radians(choice.end_bank_deg)
    limit_wpm2 = mission.limits.heat_flux_max_kwpm2 * 1e3
    record["heat_flux_limit_wpm2"] = limit_wpm2 * choice.heat_flux_margin_ratio
    record["heat_flux_unit_wpm2"] = HEAT_FLUX_UNIT_WPM2
    for name in (
        "target_weight_1prad", "bank_weight_1prad", "excess_weight_ratio", "target_error_max",
        "excess_max", "step_min_ratio", "step_s",
    ):  # fmt: skip
        record[name] = getattr(choice, name)
    record["steps_a_frame_count"] = int(choice.steps_a_frame)
    record["iterations_max"] = int(choice.iterations_max)
    record["literal"] = choice.newton == "literal"
    record["first_free_knot"] = int(choice.given_knots)


def ground_plan(body: Record, mission: Mission) -> Planned:
    """The plan from the mission's entry; raises DesignError where nothing can be flown at all."""
    spec = body_spec("planned-lqr")
    load = np.zeros(1, spec.dtype)
    load[0] = body
    load["law"]["plans_onboard"] = 1
    found = plan_offline(load, fix_at_entry(mission))
    if int(found.plan["n_rows"][0]) < 2:
        raise DesignError(
            f"{mission.path.name}: the first guess of [plan] cannot be flown from the entry down "
            f"to {float(body['law']['planner']['end_alt_m']) / 1e3:g} km"
        )
    # What Newton's steps end with differs between processors by more than round-off.
    banks_rad = np.round(found.plan["profile"]["bank_rad"][0], BANK_DIGITS)
    return with_banks(load, found, banks_rad)


def _store(record: Record, found: Planned) -> None:
    """The ground's plan into the load, rounded."""
    plan = found.plan[0]
    record["ending"], record["iterations"] = plan["ending"], plan["iterations"]
    for name in ("target_error", "excess", "heat_flux_peak_wpm2", "duration_s"):
        record[name] = rounded(float(plan[name]), COARSE_DIGITS)
    record["flights"], n = plan["flights"], int(plan["n_rows"])
    record["n_rows"] = n
    record["profile"]["bank_rad"] = plan["profile"]["bank_rad"]
    record["index"][:n] = plan["index"][:n]
    record["state"][:n] = plan["state"][:n]


def fill_planned_lqr(
    body: Record, design: CommonDesign, mission: Mission, law: str
) -> dict[str, Any]:
    """Law `planned-lqr`."""
    choice = design.table(Plan, "plan", law)
    tracking = design.table(Tracker, "tracker", law)
    record = body["law"]
    top_m = mission.entry.altitude_km * 1e3 + AIR_ABOVE_ENTRY_M
    body["atmosphere"] = smooth_air(body["atmosphere"], top_m, choice.air_step_km * 1e3)[0]
    fill_planner(record["planner"], choice, mission)
    fill_profile(record["guess"], choice)
    record["stored"]["profile"] = record["guess"]
    found = ground_plan(body, mission)
    _store(record["stored"], found)
    told = fill_gains(record["tracker"], body, found.plan[0], tracking)
    record["plans_onboard"] = choice.onboard == "yes"
    ending = plan_job.ENDINGS[int(found.plan["ending"][0])]
    steps = [
        {key: rounded(value, COARSE_DIGITS) for key, value in step.items()}
        for step in iterations_of(found.job[0])
    ]
    return {"plan": {"ending": ending, "iterations": steps}, **told}
