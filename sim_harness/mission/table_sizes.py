"""How large the tables of a mission may be: what keys allow, and records hold."""

AERO_TABLE_MAX = 12  # rows (angle of attack) and columns (Mach)
