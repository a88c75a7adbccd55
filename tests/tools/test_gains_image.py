"""Load images on disk: regenerated to the byte, and told apart when they are not."""

import json
import shutil
import subprocess
import sys
import zlib
from pathlib import Path

import pytest

from flight_sw.errors import DesignError
from flight_sw.load_image import HEADER, image_bytes, read_image
from tests.system.flights import DESIGN_PATH, LAWS, ROOT, built
from tools.gains.image import (
    checked_design,
    design_path,
    differences,
    image_path,
    make_all,
    provenance_path,
    provenance_text,
    round_off,
    write,
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the shipped design, images and provenance."""
    return Path(shutil.copytree(DESIGN_PATH.parent, tmp_path / "gains"))


def test_regenerating_gives_the_same_bytes() -> None:
    first, second = (
        [(m.raw, provenance_text(m.provenance)) for m in make_all(DESIGN_PATH)] for _ in range(2)
    )
    assert first == second


def test_the_committed_images_are_what_the_design_gives(folder: Path) -> None:
    for made in make_all(DESIGN_PATH):
        assert differences(DESIGN_PATH.parent, made) == []
        stored = image_path(DESIGN_PATH.parent, made.law).read_bytes()
        assert round_off(stored, built(made.law).raw) is not None


@pytest.mark.parametrize(("factor", "is_round_off"), [(1.0 + 4e-15, True), (1.0 + 1e-8, False)])
def test_the_round_off_of_another_processor_is_no_difference(
    folder: Path, factor: float, is_round_off: bool
) -> None:
    path = image_path(folder, "lqy")
    body = read_image(path).body.copy()
    body["atmosphere"]["ln_rho"][0, 100] *= factor
    path.write_bytes(image_bytes("lqy", "hyperion-1", body))
    told = json.loads(provenance_path(folder, "lqy").read_text())
    told["load_crc32"] = told["body_crc32"] = "0x00000000"
    provenance_path(folder, "lqy").write_text(json.dumps(told))
    (made,) = [m for m in make_all(folder / "design.toml") if m.law == "lqy"]
    assert (differences(folder, made) == []) == is_round_off


def test_another_process_gives_the_same_bytes() -> None:
    code = (
        "import hashlib, pathlib, sys; from tools.gains.image import make_all;"
        "print([hashlib.sha256(m.raw).hexdigest() for m in make_all(pathlib.Path(sys.argv[1]))])"
    )
    runs = [
        subprocess.run(
            [sys.executable, "-c", code, str(DESIGN_PATH)],
            cwd=ROOT, capture_output=True, check=True, timeout=120,
        ).stdout
        for _ in range(2)
    ]  # fmt: skip
    assert runs[0] == runs[1] != b""


def test_provenance_tells_inputs_and_the_image(folder: Path) -> None:
    for law in LAWS:
        told = json.loads(provenance_path(folder, law).read_text())
        raw = image_path(folder, law).read_bytes()
        assert told["load_crc32"] == f"0x{read_image(image_path(folder, law)).crc32:08x}"
        assert told["body_crc32"] == f"0x{zlib.crc32(raw[HEADER.itemsize :]):08x}"
        assert told["bytes"] == len(raw)
        assert len(told["inputs_sha256"]) == 3
    loop = json.loads(provenance_path(folder, "lqy").read_text())["operating_points"]
    assert len(loop) == 12
    assert all(point["phase_margin_deg"] > 60.0 for point in loop)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda f: image_path(f, "lqy").unlink(), ["lqy.load: does not exist"]),
        (
            lambda f: image_path(f, "lqy").write_bytes(b"AEROLOAD" + bytes(100)),
            ["lqy.load: 108 bytes, regenerated"],
        ),
        (lambda f: provenance_path(f, "lqy").unlink(), ["lqy.json: cannot be read"]),
        (lambda f: provenance_path(f, "lqy").write_text("{"), ["lqy.json: is not JSON"]),
        (
            lambda f: provenance_path(f, "lqy").write_text('{"law": "lqy"}'),
            ["lqy.json: differs in"],
        ),
    ],
)
def test_a_stored_file_that_differs_is_told(folder: Path, spoil: object, words: list[str]) -> None:
    spoil(folder)  # type: ignore[operator]
    (made,) = [m for m in make_all(folder / "design.toml") if m.law == "lqy"]
    found = differences(folder, made)
    assert len(found) == len(words)
    for text, word in zip(found, words, strict=True):
        assert word in text


def test_a_changed_weight_changes_the_image_and_its_provenance(folder: Path) -> None:
    path = folder / "design.toml"
    path.write_text(path.read_text().replace("lead_s = 20.0", "lead_s = 21.0"))
    found = {m.law: differences(folder, m) for m in make_all(path)}
    assert len(found["lqy"]) == 2
    assert "first difference at" in found["lqy"][0]
    assert len(found["nominal"]) == 1  # its provenance alone: the design file has another hash
    assert "inputs_sha256" in found["nominal"][0]


def test_written_images_are_read_back_and_agree(tmp_path: Path, folder: Path) -> None:
    for made in make_all(folder / "design.toml"):
        write(tmp_path, made)
        assert read_image(image_path(tmp_path, made.law)).crc32 == made.crc32
        assert differences(tmp_path, made) == []
    assert not list(tmp_path.glob("*.new"))


def test_a_design_is_found_by_mission_folder_or_file(folder: Path) -> None:
    assert design_path("hyperion-1") == DESIGN_PATH
    assert design_path(str(folder)) == folder / "design.toml"
    assert design_path(str(folder / "design.toml")) == folder / "design.toml"
    with pytest.raises(DesignError, match=r"none\.toml does not exist or is not a file"):
        design_path(str(folder / "none.toml"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mission = ", "not TOML"),
        ("", "mission is missing"),
        (DESIGN_PATH.read_text() + "\n[wings]\nspan_m = 2\n", "wings"),
    ],
)
def test_a_corrupt_design_file_is_named(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "design.toml"
    path.write_text(text)
    with pytest.raises(DesignError) as caught:
        checked_design(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert words in str(caught.value)
