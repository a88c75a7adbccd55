"""Published results that a flight is printed beside: numbers and where they stand."""

from typing import NamedTuple


class Published(NamedTuple):
    """One row of a published table."""

    heat_load_mjpm2: float
    ground_range_km: float
    source: str


TABLE_1 = "[MOOIJ18] Table 1"
TABLE_2 = "[MOOIJ18] Table 2"
HYPERION_1 = {
    ("nominal", 1500.0): Published(1353.3, 6703.1, TABLE_1),
    ("nominal", 1600.0): Published(1297.8, 6103.8, TABLE_1),
    ("nominal", 1700.0): Published(1278.8, 5743.1, TABLE_1),
    ("nominal", 1800.0): Published(1250.9, 5541.6, TABLE_1),
    ("nominal", 1900.0): Published(1229.4, 5390.2, TABLE_1),
    ("lqy", 1500.0): Published(1353.8, 6724.5, TABLE_2),
    ("lqy", 1600.0): Published(1295.0, 6099.5, TABLE_2),
    ("lqy", 1700.0): Published(1268.8, 5696.5, TABLE_2),
    ("lqy", 1800.0): Published(1215.8, 5316.2, TABLE_2),
    ("lqy", 1900.0): Published(1170.7, 5012.2, TABLE_2),
}
"""By law and heat-flux set point in kW/m2."""


def published(mission: str, law: str, heat_flux_max_kwpm2: float) -> Published | None:
    """The published row for a flight of a shipped mission, None if there is none."""
    if mission != "hyperion-1":
        return None
    return HYPERION_1.get((law, heat_flux_max_kwpm2))
