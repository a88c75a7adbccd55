"""Random numbers of a flight: a function of seed, stream and index, without memory.

Philox4x32-10 [PHILOX] with the seed as key and (index, stream) as counter: what a report's noise is
depends on its number alone, and is the same in memory, on a bus, in a campaign, and re-flown. Every
use has a stream of its own, listed here and nowhere else.

Limits: seeds and indexes from 0 to 2**63 - 1; Gaussians reach to 8.6 sigma.
"""

import math

import numpy as np

from sim_harness.jit import kernel

# Streams: never renumbered, a recorded seed would mean another flight.
NAV_POSITION = 1  # north and east
NAV_VERTICAL = 2  # altitude and speed
NAV_DIRECTION = 3  # path angle and heading
NAV_AERO = 4  # drag and lift
NAV_ATTITUDE = 5  # bank and angle of attack
NAV_HEATING = 6
NAV_DROPOUT = 7
AIR_DENSITY = 16
WIND_EAST = 17
WIND_NORTH = 18

MULTIPLIER_0, MULTIPLIER_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
WEYL_0, WEYL_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
LOW, HALF = np.uint64(0xFFFF_FFFF), np.uint64(32)
ROUNDS = 10
UNUSED = np.uint64(11)  # bits of a 64-bit word beyond the 53 of a float
ULP = 2.0**-53

Words = tuple[np.uint64, np.uint64, np.uint64, np.uint64]
Pair = tuple[float, float]


@kernel
def philox(
    c0: np.uint64, c1: np.uint64, c2: np.uint64, c3: np.uint64, k0: np.uint64, k1: np.uint64
) -> Words:
    """Four random 32-bit words for a counter of four and a key of two.  [PHILOX] sec. 4.3"""
    for _ in range(ROUNDS):
        product_0 = MULTIPLIER_0 * c0
        product_1 = MULTIPLIER_1 * c2
        c0 = (product_1 >> HALF) ^ c1 ^ k0
        c2 = (product_0 >> HALF) ^ c3 ^ k1
        c1 = product_1 & LOW
        c3 = product_0 & LOW
        k0 = (k0 + WEYL_0) & LOW
        k1 = (k1 + WEYL_1) & LOW
    return c0, c1, c2, c3


@kernel
def uniforms(seed: int, stream: int, index: int) -> Pair:
    """Two independent numbers, uniform in [0, 1), 53 bits each."""
    key = np.uint64(seed)
    counter = np.uint64(index)
    a, b, c, d = philox(
        counter & LOW, counter >> HALF, np.uint64(stream), np.uint64(0), key & LOW, key >> HALF
    )
    first = float(((b << HALF) | a) >> UNUSED) * ULP
    second = float(((d << HALF) | c) >> UNUSED) * ULP
    return first, second


@kernel
def gaussians(seed: int, stream: int, index: int) -> Pair:
    """Two independent numbers, normal with mean 0 and standard deviation 1, by Box-Muller."""
    first, second = uniforms(seed, stream, index)
    radius = math.sqrt(-2.0 * math.log(1.0 - first))
    angle = 2.0 * math.pi * second
    return radius * math.cos(angle), radius * math.sin(angle)
