"""What lies on disk beside what its design gives today: the same, the same to round-off, or not.

Linear algebra and the C library differ in last bits between processors. What a design solves for
comes out so much apart, and where it is stored rounded it may fall to the neighbouring number.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.errors import LoadError
from flight_sw.load_image import parse_image
from sim_harness.mission.documents import json_of, read_json
from tools.gains.image import (
    Made,
    body_crc32,
    image_path,
    provenance_path,
    provenance_text,
    write,
)
from tools.gains.rounding import SIGNIFICANT_DIGITS, rounded

ROUND_OFF_MAX = 1e-9  # of a column's largest value
CRC_KEYS = {"load_crc32", "body_crc32"}
UNCOMPARED_KEYS = {"versions"}  # are told, and make no difference by themselves
UNITS_APART_MAX = 1.5  # of the last digit: neighbours among numbers that are stored rounded


class Verdict(NamedTuple):
    """How the stored image and provenance of a law compare with those just made."""

    differences: tuple[str, ...]  # a sentence each; empty: the same, or the same to round-off
    apart: float  # largest difference of the images, of a column's largest value
    is_same: bool  # to the byte, but for the versions of libraries

    @property
    def is_kept(self) -> bool:
        """Whether what is stored stays as it is."""
        return not self.differences

    def __str__(self) -> str:
        if self.differences:
            return "differs: " + "; ".join(self.differences)
        return "same" if self.is_same else f"same up to round-off ({self.apart:z.1e} of full scale)"


def _columns(body: Any) -> Iterator[npt.NDArray[Any]]:
    """The numbers of a record, an array of two axes for each of its fields."""
    for name in body.dtype.names:
        if body[name].dtype.names:
            yield from _columns(body[name])
        else:
            yield body[name].reshape(-1, *body[name].shape[-1:])


def _are_neighbours(a: float, b: float) -> bool:
    """Whether two numbers are stored rounded and one unit of the last digit apart."""
    if not (math.isfinite(a) and math.isfinite(b)) or (rounded(a), rounded(b)) != (a, b):
        return False
    lower = min(abs(a), abs(b))
    if lower == 0.0:
        return False
    unit = 10.0 ** (math.floor(math.log10(lower)) - SIGNIFICANT_DIGITS + 1)
    return abs(a - b) <= UNITS_APART_MAX * unit


def apart(a: npt.NDArray[Any], b: npt.NDArray[Any]) -> float:
    """Largest difference of two columns, of their largest value; inf where it is no round-off."""
    if a.dtype.kind != "f":
        return 0.0 if np.array_equal(a, b) else math.inf
    scale = np.maximum(np.abs(np.where(np.isfinite(b), b, 0.0)).max(axis=0), np.finfo(float).tiny)
    with np.errstate(invalid="ignore", over="ignore"):
        ratio = np.where(a == b, 0.0, np.abs(a - b) / scale)
    far = np.argwhere(~(ratio <= ROUND_OFF_MAX))  # what is not a number too
    if not all(_are_neighbours(float(a[*at]), float(b[*at])) for at in far):
        return math.inf
    return float(ratio.max(initial=0.0))


def round_off(stored: bytes, made: bytes) -> float | None:
    """Largest difference of two images, of a column's largest value; None: more than round-off."""
    try:
        before, after = (parse_image(raw, "").body for raw in (stored, made))
    except LoadError:
        return None
    if before.dtype != after.dtype:
        return None
    pairs = zip(_columns(before), _columns(after), strict=True)
    largest = max(apart(a, b) for a, b in pairs)
    return largest if math.isfinite(largest) else None


def _is_close(before: Any, after: Any) -> bool:
    """Whether two values of a provenance are the same, numbers to round-off."""
    if isinstance(before, float) and isinstance(after, float):
        return before == after or (
            math.isclose(before, after, rel_tol=ROUND_OFF_MAX, abs_tol=ROUND_OFF_MAX)
            or _are_neighbours(before, after)
        )
    if isinstance(before, dict) and isinstance(after, dict):
        return before.keys() == after.keys() and all(
            _is_close(before[key], after[key]) for key in before
        )
    if isinstance(before, list) and isinstance(after, list):
        return len(before) == len(after) and all(map(_is_close, before, after))
    return bool(before == after)


def _crcs_of(raw: bytes) -> dict[str, str]:
    """What provenance must tell of the image that it lies beside; nothing of what is none."""
    try:
        crc32 = parse_image(raw, "").crc32
    except LoadError:
        return {}
    return {"load_crc32": f"0x{crc32:08x}", "body_crc32": body_crc32(raw)}


def _provenance_differences(path: Path, raw: bytes, made: Made) -> list[str]:
    """How a stored provenance differs from the one just made, or from the image that it tells of.

    Its CRCs are those of the stored image, whatever that differs in.
    """
    try:
        before = read_json(path, LoadError)
    except LoadError:
        before = None
    if not isinstance(before, dict):
        return [f"{path}: missing or not JSON"]
    ours = json_of(provenance_text(made.provenance).encode())
    for key in CRC_KEYS:
        ours[key] = _crcs_of(raw).get(key, before.get(key))
    keys = [
        key
        for key in {**before, **ours}
        if key not in UNCOMPARED_KEYS and not _is_close(before.get(key), ours.get(key))
    ]
    return [f"{path}: differs in {', '.join(keys)}"] if keys else []


def compare(folder: Path, made: Made) -> Verdict:
    """How the stored image and provenance compare with those just made."""
    stored = image_path(folder, made.law)
    if not stored.is_file():
        return Verdict((f"{stored}: does not exist",), math.inf, False)
    raw = stored.read_bytes()
    largest = round_off(raw, made.raw)
    found = []
    if raw != made.raw and largest is None:
        where = next(
            (i for i, (a, b) in enumerate(zip(raw, made.raw, strict=False)) if a != b),
            min(len(raw), len(made.raw)),
        )
        found.append(
            f"{stored}: {len(raw)} bytes, regenerated {len(made.raw)}; first difference at {where}"
        )
    found += _provenance_differences(provenance_path(folder, made.law), raw, made)
    return Verdict(tuple(found), math.inf if largest is None else largest, raw == made.raw)


def differences(folder: Path, made: Made) -> list[str]:
    """How the stored image and provenance differ from those just made, a sentence each."""
    return list(compare(folder, made).differences)


def keep_or_write(folder: Path, made: Made) -> Verdict:
    """Store an image and its provenance, unless what is stored is the same up to round-off."""
    verdict = compare(folder, made)
    if not verdict.is_kept:
        write(folder, made)
    return verdict
