"""How a flight computer keeps time: what its command line may ask for, and what it takes."""

import math
from typing import NamedTuple

PACE_LOW, PACE_HIGH = 0.01, 1000.0
TIMEOUT_LOW_S = 1.0
SILENCE_TIMEOUT_S = 10.0


class Timing(NamedTuple):
    """How the loop keeps time."""

    synchronisation: str = "lockstep"
    pace: float = 1.0
    """Mission seconds per second of the clock; lockstep has none."""
    silence_timeout_s: float = SILENCE_TIMEOUT_S
    """By the clock: an armed computer ends that hears nothing of a harness for so long."""
    waiting_timeout_s: float = math.inf
    """The same before it is armed."""
