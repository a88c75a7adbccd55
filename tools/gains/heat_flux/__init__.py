"""Design of the laws that track heat flux and load factor on their limits."""

from tools.gains.heat_flux.choices import Lqy, Nominal, Sag, Tracking
from tools.gains.heat_flux.fill import fill_adaptive, fill_lqy, fill_nominal

TABLES = {
    "nominal": (Nominal | None, None),
    "lqy": (Lqy | None, None),
    "sag": (Sag | None, None),
    "tracking": (Tracking | None, None),
}
"""Tables of a design: type and default."""

FILLERS = {
    "nominal": fill_nominal,
    "lqy": fill_lqy,
    "sag": fill_adaptive,
    "integrated": fill_adaptive,
}
"""How each law's own record is filled; returns what the provenance reports of the design."""
