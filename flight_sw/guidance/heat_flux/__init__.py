"""Heat flux and load factor tracked on their limits: nominal, LQY and adaptive laws.  [MOOIJ18]"""

from types import ModuleType

from flight_sw.guidance.heat_flux import integrated, lqy, nominal, sag

LAWS: dict[str, ModuleType] = {
    "nominal": nominal,
    "lqy": lqy,
    "sag": sag,
    "integrated": integrated,
}
