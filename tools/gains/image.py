"""Load images and their provenance: made from a design, written beside it, or compared with it."""

import contextlib
import hashlib
import importlib.metadata
import json
import math
import os
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw import icd
from flight_sw.errors import DesignError, LoadError
from flight_sw.load_image import HEADER, image_bytes, layout_hash, parse_image
from sim_harness.documents import read_json
from sim_harness.mission import Mission, find, load_mission
from tools.gains.body import fill_body
from tools.gains.schema import Design, design_of, read_tree

DESIGN_NAME = "design.toml"
ROUND_OFF_MAX = 1e-9  # of a column's largest value: linear algebra differs so between processors
CRC_KEYS = {"load_crc32", "body_crc32"}
VERSIONS_OF = ("numpy", "scipy", "control", "numba")


class Made(NamedTuple):
    """One law's image and what it was made from."""

    law: str
    raw: bytes
    provenance: dict[str, Any]

    @property
    def crc32(self) -> int:
        """The CRC that names the image."""
        return parse_image(self.raw, self.law).crc32


def design_path(target: str) -> Path:
    """The design of a shipped mission by its name, or of a path to the file or its folder."""
    path = Path(target)
    if path.is_dir():
        return path / DESIGN_NAME
    if path.suffix == ".toml" or "/" in target:
        if not path.is_file():
            raise DesignError(f"design file {target} does not exist or is not a file")
        return path
    folder = load_mission(target).gains_folder
    if not (folder / DESIGN_NAME).is_file():
        raise DesignError(f"mission {target}: {folder / DESIGN_NAME} does not exist")
    return folder / DESIGN_NAME


def mission_path(design: Design, path: Path) -> Path:
    """The mission file a design is for: shipped, or relative to the design's own folder."""
    if design.mission.endswith(".toml") or "/" in design.mission:
        return find(path.parent / design.mission)
    return find(design.mission)


def checked_design(path: Path, tree: dict[str, Any] | None = None) -> Design:
    """The design of a file, or of its tables as changed by overrides."""
    return design_of(read_tree(path) if tree is None else tree, str(path))


def make(law: str, design: Design, mission: Mission, path: Path) -> Made:
    """One law's image; raises DesignError where the law cannot be designed."""
    if law not in design.laws:
        raise DesignError(f"{path}: law '{law}' is not designed here, laws are {design.laws}")
    filled = fill_body(law, design, mission)
    raw = image_bytes(law, mission.name, filled.body)
    image = parse_image(raw, str(path))
    provenance = {
        "generator": "aeroshell gains",
        "mission": mission.name,
        "law": law,
        "load_crc32": f"0x{image.crc32:08x}",
        "layout": layout_hash(law),
        "bytes": len(raw),
        "body_crc32": f"0x{zlib.crc32(raw[HEADER.itemsize :]):08x}",
        "inputs_sha256": {
            DESIGN_NAME: hashlib.sha256(path.read_bytes()).hexdigest(),
            mission.path.name: hashlib.sha256(mission.path.read_bytes()).hexdigest(),
            icd.DBC_PATH.name: icd.DBC_SHA256,
        },
        "versions": {name: importlib.metadata.version(name) for name in VERSIONS_OF},
        **filled.report,
    }
    return Made(law, raw, provenance)


def make_all(path: Path) -> list[Made]:
    """The images of every law that a design file names."""
    design = checked_design(path)
    mission = load_mission(mission_path(design, path))
    return [make(law, design, mission, path) for law in design.laws]


def image_path(folder: Path, law: str) -> Path:
    """Where a law's image lies."""
    return folder / f"{law}.load"


def provenance_path(folder: Path, law: str) -> Path:
    """Where a law's provenance lies."""
    return folder / f"{law}.json"


def write_atomically(path: Path, raw: bytes) -> None:
    """Write under a temporary name, then rename."""
    temporary = path.with_name(path.name + ".new")
    try:
        temporary.write_bytes(raw)
        os.replace(temporary, path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise


def provenance_text(provenance: dict[str, Any]) -> str:
    """The provenance as it is stored."""
    return json.dumps(provenance, indent=1) + "\n"


def write(folder: Path, made: Made) -> None:
    """Store an image and its provenance."""
    write_atomically(image_path(folder, made.law), made.raw)
    text = provenance_text(made.provenance)
    write_atomically(provenance_path(folder, made.law), text.encode())


def _columns(body: Any) -> Iterator[npt.NDArray[Any]]:
    """The numbers of a record, an array of two axes for each of its fields."""
    for name in body.dtype.names:
        if body[name].dtype.names:
            yield from _columns(body[name])
        else:
            yield body[name].reshape(-1, *body[name].shape[-1:])


def round_off(stored: bytes, made: bytes) -> float | None:
    """Largest difference of two images, of a column's largest value; None if it is not round-off.

    What a design solves for comes out a few units in the last place apart on another processor.
    """
    try:
        before, after = (parse_image(raw, "").body for raw in (stored, made))
    except LoadError:
        return None
    largest = 0.0
    if before.dtype != after.dtype:
        return None
    for a, b in zip(_columns(before), _columns(after), strict=True):
        if a.dtype.kind != "f":
            largest = max(largest, 0.0 if np.array_equal(a, b) else 1.0)
            continue
        scale = np.maximum(np.abs(b).max(axis=0), np.finfo(float).tiny)
        largest = max(largest, float((np.abs(a - b) / scale).max()))
    return largest if largest <= ROUND_OFF_MAX else None


def _is_close(before: Any, after: Any) -> bool:
    """Whether two values of a provenance are the same, numbers to round-off."""
    if isinstance(before, float) and isinstance(after, float):
        return math.isclose(before, after, rel_tol=ROUND_OFF_MAX, abs_tol=ROUND_OFF_MAX)
    if isinstance(before, dict) and isinstance(after, dict):
        return before.keys() == after.keys() and all(
            _is_close(before[key], after[key]) for key in before
        )
    if isinstance(before, list) and isinstance(after, list):
        return len(before) == len(after) and all(map(_is_close, before, after))
    return bool(before == after)


def differences(folder: Path, made: Made) -> list[str]:
    """How the stored image and provenance differ from those just made, a sentence each.

    Versions of libraries are told in the provenance, but do not make a difference by themselves,
    nor does another processor's round-off.
    """
    found = []
    stored = image_path(folder, made.law)
    if not stored.is_file():
        return [f"{stored}: does not exist"]
    raw = stored.read_bytes()
    is_close = raw != made.raw and round_off(raw, made.raw) is not None
    if raw != made.raw and not is_close:
        where = next((i for i, (a, b) in enumerate(zip(raw, made.raw, strict=False)) if a != b), -1)
        found.append(
            f"{stored}: {len(raw)} bytes, regenerated {len(made.raw)}; first difference at {where}"
        )
    told = provenance_path(folder, made.law)
    try:
        before = read_json(told, DesignError)
    except DesignError as error:
        return [*found, str(error)]
    if not isinstance(before, dict):
        return [*found, f"{told}: is no provenance"]
    ours = json.loads(provenance_text(made.provenance))
    passed_over = {"versions"} | (CRC_KEYS if is_close else set())
    keys = [
        key
        for key in {**before, **ours}
        if key not in passed_over and not _is_close(before.get(key), ours.get(key))
    ]
    if keys:
        found.append(f"{told}: differs in {', '.join(keys)}")
    return found
