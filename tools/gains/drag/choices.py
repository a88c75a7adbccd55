"""What a design chooses for the laws that track a drag profile or predict the range."""

from typing import Annotated, Literal

from flight_sw.guidance.drag import by_observer as drag_observer
from flight_sw.guidance.drag import prediction, range_predictor
from flight_sw.guidance.drag import tracking as drag_tracking
from sim_harness.mission.quantities import Quantity, Section, loaded


class NominalFlight(Section):
    """The reference: a bank linear in speed, solved to end at the mission's target."""

    bank_low_deg: Annotated[float, Quantity("deg", 0.0, 180.0, "smallest bank looked for")] = 0.0
    bank_high_deg: Annotated[float, Quantity("deg", 0.0, 180.0, "largest")] = 120.0
    rate_hz: Annotated[float, Quantity("Hz", 1.0, 1000.0, "steps of its integration")] = 100.0
    index: Literal["energy", "speed", "time"] = "energy"
    """What the reference is looked up by."""
    drag_first_mps2: Annotated[
        float, Quantity("m/s2", 1e-6, 1e3, "the reference begins where its drag exceeds it")
    ] = 0.05


class DragTracking(Section):
    """[YANHE] Eqs. 14 and 24, and what a product adds; gains a/eps0^2 and b/eps0."""

    eps0_s: Annotated[float, Quantity("s", 0.1, 1e3, "eps0")]
    a: Annotated[float, Quantity("-", 0.0, 1e4, "on the drag error")]
    b: Annotated[float, Quantity("-", 0.0, 1e4, "on its rate")]
    alpha_deg: Annotated[
        float, loaded(drag_tracking.DESIGN, "alpha_rad", "deg", "held throughout")
    ] = 0.0
    active_drag_mps2: Annotated[
        float,
        loaded(
            drag_tracking.DESIGN,
            "active_drag_mps2",
            "m/s2",
            "sensed drag that starts tracking; nominal bank before",
        ),
    ] = 2.0
    authority_min_mps4: Annotated[
        float,
        loaded(
            drag_tracking.DESIGN,
            "authority_min_mps4",
            "m/s4",
            "floor of |g0| under the feedback; 0: as the source",
        ),
    ] = 0.0
    lift: Literal["model", "sensed"] = "model"
    """Lift in g0: the load's ratio to drag, or as sensed."""
    lift_lag_s: Annotated[float, Quantity("s", 0.0, 1e3, "smooths the sensed lift; 0: none")] = 0.0
    observes: Literal["error", "ratio"] = "error"
    """What the observer follows: the drag error (Eq. 25), or sensed over modelled drag."""
    observed_drag_mps2: Annotated[
        float,
        loaded(
            drag_observer.WATCH,
            "observed_drag_mps2",
            "m/s2",
            "sensed drag that starts the observer of the ratio",
        ),
    ] = 0.3
    takes: Literal["sensed", "estimate"] = "sensed"
    """Drag in law, f and g0: as sensed (Eq. 24), or the observer's estimate."""
    model: Literal["closed-loop", "flown"] = "closed-loop"
    """The observer's model of the error: Eq. 25b, or from the bank that will be flown."""


class RangePredictor(Section):
    """The flight ahead, and how its end corrects the bank."""

    step_s: Annotated[float, loaded(prediction.AIM, "step_s", "s", "of the prediction")] = 4.0
    steps_a_frame: Annotated[
        int,
        loaded(
            range_predictor.PREDICTOR,
            "steps_count",
            "-",
            "of a path in one guidance step, a whole number",
        ),
    ] = 1
    end: Literal["speed or altitude", "altitude"] = "speed or altitude"
    """Where a path ends: at the target's speed or altitude, or at its altitude alone."""
    cos_apart: Annotated[
        float, loaded(range_predictor.PREDICTOR, "cos_apart", "-", "between the two paths")
    ] = 0.02
    gain: Annotated[
        float, loaded(range_predictor.PREDICTOR, "gain_ratio", "-", "share of Newton's step")
    ] = 0.7
    cos_step_max: Annotated[
        float, loaded(range_predictor.PREDICTOR, "cos_step_max", "-", "largest correction")
    ] = 0.15
    sensitivity_min_km: Annotated[
        float,
        loaded(
            range_predictor.PREDICTOR,
            "sensitivity_min_m",
            "km",
            "range per cosine below which the largest is taken",
        ),
    ] = 2.0
    lag_s: Annotated[float, Quantity("s", 0.0, 100.0, "smooths the correction")] = 0.5
