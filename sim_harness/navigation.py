"""What navigation reports to the bus: exact for now, behind the interface a noisy one will use.

`measure` writes the truth, in the signals' units, into the flat vector of bus values. NAV_STATE is
what navigation remembers between frames.
"""

import numpy as np

from flight_sw.icd import value_index
from flight_sw.types_ import F8, Record
from sim_harness.jit import kernel

LON = value_index("NAV_POSITION", "lon_rad")
LAT = value_index("NAV_POSITION", "lat_rad")
ALT = value_index("NAV_VERTICAL", "alt_m")
V_REL = value_index("NAV_VERTICAL", "v_rel_mps")
FLIGHT_PATH_ANGLE = value_index("NAV_DIRECTION", "flight_path_angle_rad")
HEADING = value_index("NAV_DIRECTION", "heading_rad")
DRAG = value_index("NAV_AERO", "drag_mps2")
LIFT = value_index("NAV_AERO", "lift_mps2")
BANK = value_index("NAV_ATTITUDE", "bank_rad")
ALPHA = value_index("NAV_ATTITUDE", "alpha_rad")
HEAT_FLUX = value_index("NAV_HEATING", "heat_flux_wpm2")
TIME = value_index("NAV_TIME", "t_s")

NAV_STATE = np.dtype([("reports", "i8")], align=True)  # since entry


@kernel
def measure(world: Record, truth: Record, nav_state: Record, values: F8) -> None:
    """Writes one report into the vector of bus values; lift is reported by its magnitude."""
    values[LON] = truth["lon_rad"]
    values[LAT] = truth["lat_rad"]
    values[ALT] = truth["alt_m"]
    values[V_REL] = truth["v_rel_mps"]
    values[FLIGHT_PATH_ANGLE] = truth["flight_path_angle_rad"]
    values[HEADING] = truth["heading_rad"]
    values[DRAG] = truth["drag_mps2"]
    values[LIFT] = abs(truth["lift_mps2"])
    values[BANK] = truth["bank_rad"]
    values[ALPHA] = truth["alpha_rad"]
    values[HEAT_FLUX] = truth["heat_flux_wpm2"]
    values[TIME] = truth["t_s"]
    nav_state["reports"] += 1
