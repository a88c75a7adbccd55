"""Heat flux and load factor tracked on their limits: nominal, LQY and adaptive laws.  [MOOIJ18]"""

from flight_sw.guidance.heat_flux import integrated, lqy, nominal, sag

LAWS = {"nominal": (0, nominal), "lqy": (1, lqy), "sag": (5, sag), "integrated": (6, integrated)}
"""By name: the number that FSW_BOOT sends, never used again for another, and the module."""
