"""Units in which tables and reports show what records hold in SI."""

DISPLAY = {  # SI unit at the end of a name: factor and unit to show
    "wpm2": (1e-3, "kW/m2"),
    "jpm2": (1e-6, "MJ/m2"),
    "pa": (1e-3, "kPa"),
    "m": (1e-3, "km"),
    "mps": (1.0, "m/s"),
    "mps2": (1.0, "m/s2"),
    "g": (1.0, "g"),
}
