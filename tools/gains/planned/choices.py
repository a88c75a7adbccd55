"""What a design chooses for the law that plans onboard and tracks its plan."""

from typing import Annotated, Literal, Self

from pydantic import model_validator

from flight_sw.guidance.planned import plan_job, tracker
from flight_sw.guidance.planned.planned_lqr import PROFILE_SPEC
from flight_sw.model.profile import KNOTS_MAX
from sim_harness.mission.quantities import Quantity, Section, Series, loaded, refusal, span_of

INDEX = span_of(PROFILE_SPEC, "bank_index", "-")


def knots(meaning: str) -> Series:
    """Places of knots on the axis of the profile."""
    return Series("-", *INDEX, meaning, KNOTS_MAX, 2, ascending=True)


def angles(meaning: str) -> Series:
    """Angles at knots."""
    return Series("deg", -180.0, 180.0, meaning, KNOTS_MAX, 2)


class Plan(Section):
    """[JOSHI] Eqs. 12-30: the profile that is planned, and how."""

    onboard: Literal["yes", "no"] = "yes"
    """Planned from the navigation fix, or the plan of the load flown."""
    index: Literal["energy", "time"] = "energy"
    """What the knots lie over: the speed that the energy has lost, or the time in the source."""
    energy_ref_mjpkg: Annotated[
        float, Quantity("MJ/kg", -1e4, 1e4, "Jacobi's, that counts as none")
    ] = 0.0
    index_speed_mps: Annotated[
        float, loaded(PROFILE_SPEC, "index_speed_mps", "m/s", "of the index' zero")
    ] = 0.0
    index_unit_mps: Annotated[
        float, loaded(PROFILE_SPEC, "index_unit_mps", "m/s", "of the index")
    ] = 1000.0
    bank_index: Annotated[tuple[float, ...], knots("of the bank's knots")]
    bank_deg: Annotated[tuple[float, ...], angles("first guess at them")]
    given_knots: Annotated[
        float, Quantity("-", 0.0, KNOTS_MAX - 1.0, "first knots whose bank is not sought")
    ] = 1.0
    alpha_index: Annotated[tuple[float, ...], knots("of the angle of attack's knots")]
    alpha_deg: Annotated[tuple[float, ...], angles("at them, as planned")]
    bank_max_deg: Annotated[
        float, loaded(plan_job.PLANNER, "bank_max_rad", "deg", "planned, either side")
    ] = 120.0
    end_bank_deg: Annotated[
        float, loaded(plan_job.PLANNER, "end_bank_rad", "deg", "wanted at the end")
    ] = 0.0
    heat_flux_margin_ratio: Annotated[
        float, Quantity("-", 0.1, 10.0, "of the mission's limit: kept by the plan")
    ] = 1.0
    target_weight_1prad: Annotated[
        float, loaded(plan_job.PLANNER, "target_weight_1prad", "1/rad", "root of H, place")
    ] = 6000.0
    bank_weight_1prad: Annotated[
        float, loaded(plan_job.PLANNER, "bank_weight_1prad", "1/rad", "root of H, bank")
    ] = 600.0
    excess_weight_ratio: Annotated[
        float,
        loaded(plan_job.PLANNER, "excess_weight_ratio", "-", "on the root of e_c, in W/cm2 root s"),
    ] = 1.0
    target_error_max: Annotated[
        float, loaded(plan_job.PLANNER, "target_error_max", "-", "e_t of a good plan")
    ] = 1.0
    excess_max: Annotated[
        float, loaded(plan_job.PLANNER, "excess_max", "-", "e_c of a good plan")
    ] = 100.0
    step_min_ratio: Annotated[
        float, loaded(plan_job.PLANNER, "step_min_ratio", "-", "shortest step length")
    ] = 1e-4
    iterations_max: Annotated[
        float, Quantity("-", 1.0, float(plan_job.ITERATIONS_MAX), "a whole number")
    ] = 10.0
    step_s: Annotated[float, loaded(plan_job.PLANNER, "step_s", "s", "of the flight ahead")] = 2.0
    steps_a_frame: Annotated[
        float, Quantity("-", 1.0, float(plan_job.STEPS_MAX), "of a job in one minor frame")
    ] = 8.0
    newton: Literal["rows", "literal"] = "rows"
    """On the errors themselves, or on e_t and e_c alone as in the source."""
    air_step_km: Annotated[
        float, Quantity("km", 0.1, 100.0, "of the smooth air that is planned in")
    ] = 2.0

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        for name in ("given_knots", "iterations_max", "steps_a_frame"):
            value = getattr(self, name)
            if value != int(value):
                raise refusal(f"{name} is {value:g}, allowed a whole number")
        for axis in ("bank", "alpha"):
            n, m = len(getattr(self, f"{axis}_index")), len(getattr(self, f"{axis}_deg"))
            if n != m:
                raise refusal(f"{axis}_deg has {m} values, allowed {n}, one for each knot")
        if self.given_knots >= len(self.bank_index):
            raise refusal(
                f"given_knots is {self.given_knots:g}, allowed below {len(self.bank_index)}"
            )
        return self


class Tracker(Section):
    """[JOSHI] Eqs. 40-49; weights by Bryson's rule, in the source's units."""

    axes: Literal["path", "raw"] = "path"
    """Errors along and across, odd gains by the bank's sign, or as in the source."""
    integral: Literal["along-track", "latitude"] = "along-track"
    integral_1ps: Annotated[float, Quantity("1/s", -1e3, 1e3, "K_I, rad of alpha per rad s")] = 0.2
    integral_max_rads: Annotated[
        float, loaded(tracker.TRACKER, "integral_max_rads", "rad s", "bound")
    ] = 10.0
    feedback_from_index: Annotated[
        float, loaded(tracker.TRACKER, "feedback_from_index", "-", "index; open loop before")
    ] = 0.02
    integral_from_index: Annotated[
        float, loaded(tracker.TRACKER, "integral_from_index", "-", "index")
    ] = 0.1
    odd_max_ratio: Annotated[
        float, loaded(tracker.TRACKER, "odd_max_ratio", "-", "bound on the odd gains' scale")
    ] = 1.5
    alpha_shift_max_deg: Annotated[
        float, loaded(tracker.TRACKER, "alpha_shift_max_rad", "deg", "largest correction")
    ] = 8.0
    bank_shift_max_deg: Annotated[
        float, loaded(tracker.TRACKER, "bank_shift_max_rad", "deg", "largest correction")
    ] = 30.0
    alpha_low_deg: Annotated[
        float, loaded(tracker.TRACKER, "alpha_low_rad", "deg", "commanded")
    ] = 5.0
    alpha_high_deg: Annotated[
        float, loaded(tracker.TRACKER, "alpha_high_rad", "deg", "commanded")
    ] = 50.0
    bank_max_deg: Annotated[
        float, loaded(tracker.TRACKER, "bank_max_rad", "deg", "commanded, either side")
    ] = 100.0
    speed_max_mps: Annotated[float, Quantity("m/s", 1e-3, 1e4, "allowed error")] = 10.0
    path_angle_max_deg: Annotated[float, Quantity("deg", 1e-4, 90.0, "allowed error")] = 0.9549
    heading_max_deg: Annotated[float, Quantity("deg", 1e-4, 90.0, "allowed error")] = 0.9549
    altitude_max_m: Annotated[float, Quantity("m", 1e-3, 1e6, "allowed error")] = 1000.0
    place_max_deg: Annotated[float, Quantity("deg", 1e-6, 90.0, "allowed, both ways")] = 0.09549
    alpha_max_deg: Annotated[float, Quantity("deg", 1e-3, 90.0, "allowed correction")] = 2.3391
    bank_max_error_deg: Annotated[float, Quantity("deg", 1e-3, 90.0, "allowed correction")] = 5.7296
    rows: Annotated[float, Quantity("-", 2.0, float(tracker.GAIN_ROWS), "of the table")] = 66.0
    index_first: Annotated[float, Quantity("-", *INDEX, "of the table's first row")] = 0.05
    index_last: Annotated[float, Quantity("-", *INDEX, "of its last row")] = 6.6

    @model_validator(mode="after")
    def _is_ordered(self) -> Self:
        if self.rows != int(self.rows):
            raise refusal(f"rows is {self.rows:g}, allowed a whole number")
        for low, high in (("index_first", "index_last"), ("alpha_low_deg", "alpha_high_deg")):
            if not getattr(self, low) < getattr(self, high):
                raise refusal(
                    f"{low} is {getattr(self, low):g}, allowed below {high} {getattr(self, high):g}"
                )
        return self
