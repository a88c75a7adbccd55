"""Load images and their provenance: made from a design, and written beside it."""

import contextlib
import hashlib
import importlib.metadata
import json
import os
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from flight_sw.errors import DesignError
from flight_sw.load_image import HEADER, image_bytes, layout_hash, parse_image
from sim_harness.mission.mission import Mission, find
from sim_harness.world.missions import load_mission
from tools.gains.body import fill_body
from tools.gains.design import Design, design_of, read_tree

DESIGN_NAME = "design.toml"
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


def body_crc32(raw: bytes) -> str:
    """The CRC-32 of an image's body, as provenance tells it."""
    return f"0x{zlib.crc32(raw[HEADER.itemsize :]):08x}"


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
        "body_crc32": body_crc32(raw),
        "inputs_sha256": {
            DESIGN_NAME: hashlib.sha256(path.read_bytes()).hexdigest(),
            mission.path.name: hashlib.sha256(mission.path.read_bytes()).hexdigest(),
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


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name to write under; the file takes its place when all is written, or never."""
    temporary = path.with_name(path.name + ".new")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        # A full disk names no file, and Arrow tells of it in words of its own.
        why = os.strerror(error.errno) if error.errno else str(error)
        raise OSError(error.errno, why, str(path)) from error


def write_atomically(path: Path, raw: bytes) -> None:
    """Write under a temporary name, then rename."""
    with replacing(path) as temporary:
        temporary.write_bytes(raw)


def provenance_text(provenance: dict[str, Any]) -> str:
    """The provenance as it is stored."""
    return json.dumps(provenance, indent=1) + "\n"


def write(folder: Path, made: Made) -> None:
    """Store an image and its provenance."""
    write_atomically(image_path(folder, made.law), made.raw)
    text = provenance_text(made.provenance)
    write_atomically(provenance_path(folder, made.law), text.encode())
