"""Fixed-size histograms of durations: 32 bins an octave, so a percentile is right to 3 %."""

import numpy as np

from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

SUB_BITS = 5
SUB = 1 << SUB_BITS
OCTAVES = 32 - SUB_BITS
BINS = (OCTAVES + 1) * SUB
LONGEST_NS = (1 << 32) - 1
FRACTIONS = {"p50": 0.5, "p99": 0.99, "p999": 0.999}

HISTOGRAM = np.dtype(
    [("n", "u8"), ("max_ns", "i8"), ("sum_ns", "i8"), ("bins", "u4", (BINS,))], align=True
)


@kernel
def bin_of(duration_ns: int) -> int:
    """Bin of a duration: exact below 32 ns, then 32 bins for each doubling."""
    value = min(max(duration_ns, 0), LONGEST_NS)
    shift = 0
    while (value >> shift) >= 2 * SUB and shift < OCTAVES:
        shift += 1
    return shift * SUB + (value >> shift)


@kernel
def add(histogram: Record, duration_ns: int) -> None:
    """Count one duration."""
    bins = histogram["bins"]
    bins[bin_of(duration_ns)] += 1
    histogram["n"] += 1
    histogram["sum_ns"] += duration_ns
    histogram["max_ns"] = max(histogram["max_ns"], duration_ns)


def upper_edge_ns(index: int) -> int:
    """Largest duration that falls into a bin."""
    shift = max(index // SUB - 1, 0)
    return ((index - shift * SUB + 1) << shift) - 1


def filled_bins_us(histogram: Record) -> list[tuple[float, int]]:
    """Upper edge in microseconds and count of every bin that holds something."""
    filled = np.flatnonzero(histogram["bins"])
    return [(upper_edge_ns(int(i)) / 1e3, int(histogram["bins"][i])) for i in filled]


def percentiles_us(histogram: Record) -> dict[str, float]:
    """p50, p99, p999 (upper edge of their bin) and the exact max, in microseconds."""
    total = int(histogram["n"])
    if total == 0:
        return {**dict.fromkeys(FRACTIONS, 0.0), "max": 0.0}
    cumulated = np.cumsum(histogram["bins"], dtype=np.int64)
    longest_ns = int(histogram["max_ns"])
    result = {
        name: min(upper_edge_ns(int(np.searchsorted(cumulated, fraction * total))), longest_ns)
        / 1e3
        for name, fraction in FRACTIONS.items()
    }
    return {**result, "max": longest_ns / 1e3}
