"""What the onboard planner would plan for a mission: the computer's kernels, run on the ground."""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flight_sw.errors import FlightError
from flight_sw.guidance.planned import plan_job, planned_lqr
from flight_sw.load_image import activate, parse_image
from sim_harness.mission.mission import Mission
from tools.gains.planned.offline import (
    Planned,
    fix_at_entry,
    iterations_of,
    plan_offline,
)
from tools.overrides import prepare
from tools.tracks.planned import columns_of

LAW = "planned-lqr"
HEADINGS = (
    ("iteration", "iteration", "{:d}"),
    ("e_t", "target_error", "{:z,.4g}"),
    ("e_c (W/cm2)2 s", "excess", "{:z,.4g}"),
    ("step", "step_ratio", "{:z.3g}"),
    ("latitude deg", "latitude_deg", "{:z.4f}"),
    ("longitude deg", "longitude_deg", "{:z.4f}"),
    ("final bank deg", "bank_final_deg", "{:z.3f}"),
    ("heat flux kW/m2", "heat_flux_max_kwpm2", "{:z.1f}"),
    ("duration s", "duration_s", "{:z.1f}"),
)
"""Columns of the table of iterations: title, key and form."""


class Told(NamedTuple):
    """A plan for a person."""

    mission: Mission
    planned: Planned
    dt_s: float
    columns: dict[str, np.ndarray]
    """Index, states, controls and heat flux along the plan; SI."""
    case: str | None = None

    @property
    def ending(self) -> str:
        """How the planner ended."""
        if self.planned.stage == planned_lqr.FAILED:
            return "failed"
        return plan_job.ENDINGS[int(self.planned.job["ending"][0])]

    @property
    def is_good(self) -> bool:
        """Whether the plan ends at the target within the design's bars."""
        return self.ending == plan_job.ENDINGS[plan_job.CONVERGED]

    def missed(self) -> dict[str, float]:
        """By how much the plan misses the target."""
        target, radius_km = self.mission.target, self.mission.planet.radius_km
        assert target is not None  # the design refuses a mission without
        lat, lon = (float(np.degrees(self.columns[n][-1])) for n in ("lat_rad", "lon_rad"))
        east = math.remainder(lon - target.longitude_deg, 360.0)
        north = lat - target.latitude_deg
        east_km = math.radians(east) * math.cos(math.radians(lat)) * radius_km
        return {
            "latitude_error_deg": north,
            "longitude_error_deg": east,
            "distance_km": math.hypot(math.radians(north) * radius_km, east_km),
        }


def plan_of(
    target: str, settings: list[str], load_path: Path | None, case: str | None = None
) -> Told:
    """The plan of a mission; raises AeroshellError where the mission has no law that plans."""
    prepared = prepare(target, None if load_path else LAW, settings, load_path, case)
    if prepared.law != LAW:
        raise FlightError(f"{prepared.load_path}: is for law '{prepared.law}', which plans nothing")
    load = activate(parse_image(prepared.load_image, str(prepared.load_path))).copy()
    load["law"]["plans_onboard"] = 1
    planned = plan_offline(load, fix_at_entry(prepared.mission))
    columns: dict[str, np.ndarray] = {}
    if int(planned.plan["n_rows"][0]) > 0:
        columns = columns_of(load[0], planned.plan[0])
    return Told(prepared.mission, planned, float(load["dt_s"][0]), columns, case)


def to_json(told: Told) -> dict[str, Any]:
    """Everything as plain values, angles in degrees."""
    job, plan = told.planned.job[0], told.planned.plan[0]
    n = int(plan["profile"]["n_bank"])
    found: dict[str, Any] = {
        "mission": told.mission.name,
        "case": told.case,
        "ending": told.ending,
        "iterations": iterations_of(job) if told.columns else [],
        "flights_ahead": int(job["flights"]),
        "minor_frames": told.planned.frames,
        "coast_s": told.planned.frames * told.dt_s,
        "bank_index": [float(v) for v in plan["profile"]["bank_index"][:n]],
        "bank_deg": [float(np.degrees(v)) for v in plan["profile"]["bank_rad"][:n]],
    }
    if told.columns:
        found |= told.missed()
        found["trajectory"] = {name: values.tolist() for name, values in told.columns.items()}
    return found
