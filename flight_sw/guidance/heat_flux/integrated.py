"""The integrated system: nominal guidance, inner loop (LQY) and outer loop (SAG) together.

Source: [MOOIJ18] sec. III, Fig. 3. Both loops see the same errors, and their corrections add up.
The modules it is made of: nominal.py, lqy.py, sag.py.
"""

from flight_sw.guidance.heat_flux import lqy, nominal, sag
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

DESIGN = sag.DESIGN
STATE = sag.STATE
PHASES = sag.PHASES
TELEMETRY = (*sag.TELEMETRY, *lqy.TELEMETRY[len(nominal.TELEMETRY) :])
FIRST_PHASE = {**sag.FIRST_PHASE, **lqy.FIRST_PHASE}
BANK_CORRECTION, HEAT_FLUX_ERROR = len(sag.TELEMETRY), len(sag.TELEMETRY) + 1


@kernel
def step(load: Record, state: Record, nav: Record, out: Record) -> int:
    """One guidance step of law `integrated`."""
    design = load["law"]
    inner = state["nominal"]
    code = sag.prepare(load, state, nav)
    nominal.report(inner, out)
    if inner["phase"] >= nominal.HEAT_FLUX:
        gains = lqy.gains(design["inner_loop"], load["onboard"], nav)
        state["correction_rad"] = lqy.correction(
            design["nominal"],
            design["inner_loop"],
            load["onboard"],
            state,
            nav,
            state["heat_flux_wpm2"],
            gains,
        )
        state["adaptive_rad"] = sag.adaptive_bank(load, state, gains)
    sag.command(state, out)
    telemetry = out["telemetry"]
    telemetry[BANK_CORRECTION] = state["correction_rad"]
    telemetry[HEAT_FLUX_ERROR] = state["heat_flux_error_wpm2"]
    return code
