"""Keys of a mission that name places on its planet. They are drawn in the review; no law reads
them."""

from typing import Annotated

from sim_harness.mission.quantities import Quantity, Section, Text


class Waypoint(Section):
    """A place that the flight is to pass; drawn in the review, no law reads it."""

    name: Annotated[str, Text("beside it in the review")] = ""
    longitude_deg: Annotated[float, Quantity("deg", -180.0, 180.0, "positive to the east")]
    latitude_deg: Annotated[float, Quantity("deg", -90.0, 90.0, "geocentric")]


class NoFlyZone(Section):
    """A circle that the flight is to stay out of; drawn in the review, no law reads it."""

    name: Annotated[str, Text("beside it in the review")] = ""
    longitude_deg: Annotated[float, Quantity("deg", -180.0, 180.0, "of its centre")]
    latitude_deg: Annotated[float, Quantity("deg", -90.0, 90.0, "of its centre")]
    radius_km: Annotated[float, Quantity("km", 0.1, 20000.0, "along the ground")]
