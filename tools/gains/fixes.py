"""Navigation fixes that tell the truth: what a design sees of a flight."""

import numpy as np
import numpy.typing as npt

from flight_sw.records.dictionary import NAV
from flight_sw.records.types_ import Record


def fix_of(truth: Record) -> npt.NDArray[np.void]:
    """A navigation fix, shape (1,), that tells the truth of a frame."""
    nav = np.zeros(1, NAV)
    for name in NAV.names or ():
        nav[name] = truth[name]
    nav["lift_mps2"] = abs(truth["lift_mps2"])
    return nav
