"""An entry planned onboard and tracked with gains over energy.  [JOSHI]"""

from flight_sw.guidance.planned import planned_lqr

LAWS = {"planned-lqr": (7, planned_lqr)}
"""By name: the number that FSW_BOOT sends, never used again for another, and the module."""
