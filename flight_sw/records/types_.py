"""Names for what kernels take: the compiler ignores them, the reader and mypy do not."""

from typing import Any

import numpy as np
import numpy.typing as npt

Record = Any
"""A record scalar: a numpy void that the compiler sees as a C struct."""
F8 = npt.NDArray[np.float64]
U8 = npt.NDArray[np.uint64]
Frames = npt.NDArray[np.void]
"""Array of dictionary.FRAME."""
