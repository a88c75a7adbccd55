"""The bank of a nominal flight: a straight line over speed, held outside its ends."""

import math

from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel


def _speeds_in_order(profile: Record) -> str:
    slow, fast = float(profile["v_slow_mps"]), float(profile["v_fast_mps"])
    return "" if slow < fast else f"v_slow_mps is {slow:g}, allowed below v_fast_mps {fast:g}"


BANK_PROFILE = RecordSpec(
    "bank_profile",
    Field("bank_fast_rad", 0.0, math.pi, "at the higher speed"),
    Field("bank_slow_rad", 0.0, math.pi, "at the lower speed"),
    Field("v_fast_mps", 0.0, 1e5),
    Field("v_slow_mps", 0.0, 1e5),
    rules=(_speeds_in_order,),
)


@kernel
def nominal_bank(profile: Record, v_mps: float) -> float:
    """Bank of the nominal flight at this speed."""
    slow_mps = profile["v_slow_mps"]
    share = min(max((v_mps - slow_mps) / (profile["v_fast_mps"] - slow_mps), 0.0), 1.0)
    bank_rad = profile["bank_slow_rad"]
    return bank_rad + share * (profile["bank_fast_rad"] - bank_rad)
