"""What varies from flight to flight of a campaign: drawn once, the same for every law.

A sample is nothing but values of keys and a seed. It depends on the set, the number of flights, the
campaign's seed and the values that the entries are beside; never on the law.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from flight_sw.errors import MissionError
from sim_harness.mission.dispersion_keys import Dispersions, Fixed, Normal, Uniform, nominal_of
from sim_harness.mission.documents import short
from sim_harness.mission.errors import nearest

F8 = npt.NDArray[np.float64]
SEED_LIMIT = 1 << 32
HALF_OPEN = 1e-15  # keeps a quantile off 0 and 1, where the normal score is infinite


class Samples(NamedTuple):
    """Row k is flight k + 1: a value for each key, and what seeds the flight's own noise."""

    keys: tuple[str, ...]
    values: F8
    seeds: npt.NDArray[np.int64]

    def overrides(self, run: int) -> dict[str, float]:
        """The values of one flight, counted from 1, by their keys."""
        return dict(zip(self.keys, self.values[run - 1].tolist(), strict=True))


def set_of(sets: Mapping[str, Dispersions], name: str, mission: str) -> Dispersions:
    """A mission's dispersion set by its name."""
    if name not in sets:
        known = sorted(sets)
        allowed = f"allowed {', '.join(known)}" if known else "its file has no [dispersions]"
        raise MissionError(
            f'dispersion set "{name}" is not one of {mission}{nearest(name, known)}; {allowed}'
        )
    return sets[name]


def cube(dispersions: Dispersions, n: int, dimensions: int, seed: int) -> F8:
    """Points of the unit cube, a row a flight."""
    if dimensions == 0:
        return np.zeros((n, 0))
    random = np.random.default_rng(seed)
    if dispersions.sampling == "sobol":
        # A power of two keeps the sequence balanced; a shorter campaign flies its beginning.
        return qmc.Sobol(dimensions, rng=random).random_base2(max(n - 1, 1).bit_length())[:n]
    if dispersions.sampling == "latin-hypercube":
        return qmc.LatinHypercube(dimensions, rng=random).random(n)
    return random.random((n, dimensions))


def correlation_root(dispersions: Dispersions, keys: list[str], where: str) -> F8 | None:
    """Lower Cholesky factor of the normal scores' correlation; None without any."""
    matrix = np.eye(len(keys))
    for group in dispersions.correlations:
        for key in group.keys:
            if key not in keys:
                raise MissionError(
                    f"{where}.correlations names {short(key)}{nearest(key, keys)}; "
                    f"allowed keys that vary in the set: {short(', '.join(keys))}"
                )
        places = [keys.index(key) for key in group.keys]
        for i in places:
            for j in places:
                if i != j:
                    matrix[i, j] = group.coefficient
    if not dispersions.correlations:
        return None
    try:
        root = np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise MissionError(
            f"{where}.correlations contradict each other: their matrix is not positive definite"
        ) from None
    return root


def offsets(spread: Uniform | Normal, u: F8) -> F8:
    """Offsets or shares at quantiles `u`."""
    if isinstance(spread, Uniform):
        return spread.low + (spread.high - spread.low) * u
    below = float(ndtr(-spread.cut_sigmas))
    return spread.sigma * ndtri(below + u * (1.0 - 2.0 * below))


def around(spread: Uniform | Normal, nominal: float, offset: F8) -> F8:
    """Values that lie beside the nominal one."""
    return nominal * (1.0 + offset) if spread.scale == "relative" else nominal + offset


def nominal_values(dispersions: Dispersions, present: Mapping[str, object], where: str) -> F8:
    """What each varying key lies beside, in order of `varying`."""
    found = []
    for key, spread in varying(dispersions).items():
        nominal = nominal_of(spread, present.get(key))
        if nominal is None or not math.isfinite(nominal):
            raise MissionError(
                f"{where}.{key} lies beside {present.get(key)}, which is no finite number; "
                "allowed with a value `beside` in the entry"
            )
        found.append(nominal)
    return np.array(found)


def varying(dispersions: Dispersions) -> dict[str, Uniform | Normal]:
    """The keys that differ from flight to flight, sorted: the order in the file means nothing."""
    spreads = sorted(dispersions.keys.items())
    return {key: spread for key, spread in spreads if not isinstance(spread, Fixed)}


def fixed(dispersions: Dispersions) -> dict[str, float]:
    """The keys that have one value in the whole set."""
    spreads = sorted(dispersions.keys.items())
    return {key: spread.value for key, spread in spreads if isinstance(spread, Fixed)}


def draw(
    dispersions: Dispersions, present: Mapping[str, object], n: int, seed: int, where: str
) -> Samples:
    """The samples of a campaign of `n` flights; `present` holds the undispersed values by key."""
    spreads = varying(dispersions)
    keys = list(spreads)
    nominal = nominal_values(dispersions, present, where)
    u = cube(dispersions, n, len(keys), seed)
    if (root := correlation_root(dispersions, keys, where)) is not None:
        u = ndtr(ndtri(np.clip(u, HALF_OPEN, 1.0 - HALF_OPEN)) @ root.T)
    values = np.zeros((n, len(keys)))
    for i, spread in enumerate(spreads.values()):
        values[:, i] = around(spread, nominal[i], offsets(spread, u[:, i]))
    seeds = np.random.SeedSequence(seed).generate_state(n, np.uint32).astype(np.int64)
    return Samples(tuple(keys), values, seeds)


def extremes(
    dispersions: Dispersions, present: Mapping[str, object], where: str
) -> dict[str, tuple[float, ...]]:
    """The outermost values of each varying key."""
    nominal = nominal_values(dispersions, present, where)
    found: dict[str, tuple[float, ...]] = {}
    for (key, spread), value in zip(varying(dispersions).items(), nominal, strict=True):
        found[key] = tuple(float(v) for v in around(spread, value, np.array(spread.ends)))
    return found
