"""Design of the law that plans onboard and tracks its plan."""

from tools.gains.planned.choices import Plan, Tracker
from tools.gains.planned.fill import fill_planned_lqr

TABLES = {"plan": (Plan | None, None), "tracker": (Tracker | None, None)}
"""Tables of a design: type and default."""

FILLERS = {"planned-lqr": fill_planned_lqr}
"""How each law's own record is filled; returns what the provenance reports of the design."""
