"""Load images on disk: regenerated to the byte, and told apart when they are not."""

import functools
import json
import math
import shutil
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

from flight_sw.errors import DesignError
from flight_sw.load_image import HEADER, image_bytes, parse_image, read_image
from tests.system.flights import DESIGN_PATH, LAWS, ROOT
from tools.cli import main
from tools.gains.compare import ROUND_OFF_MAX, apart, compare, differences, round_off
from tools.gains.image import (
    Made,
    body_crc32,
    checked_design,
    design_path,
    image_path,
    make_all,
    provenance_path,
    provenance_text,
    write,
)

DESIGNS = sorted(DESIGN_PATH.parents[1].glob("*/design.toml"))
OF_ANOTHER_PROCESSOR = 1.0 + 4e-15


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the shipped design, images and provenance."""
    return Path(shutil.copytree(DESIGN_PATH.parent, tmp_path / "gains"))


@functools.cache
def lqy() -> Made:
    """The image that this processor makes of the shipped design."""
    (made,) = [m for m in make_all(DESIGN_PATH) if m.law == "lqy"]
    return made


def store(folder: Path, factor: float, column: int = 100) -> None:
    """Store an image with one number of its body changed, and the provenance that belongs to it."""
    body = parse_image(lqy().raw, "lqy").body.copy()
    body["atmosphere"]["ln_rho"][0, column] *= factor
    raw = image_bytes("lqy", "hyperion-1", body)
    crcs = {"load_crc32": f"0x{parse_image(raw, '').crc32:08x}", "body_crc32": body_crc32(raw)}
    write(folder, Made("lqy", raw, {**lqy().provenance, **crcs}))


def test_regenerating_gives_the_same_bytes() -> None:
    first, second = (
        [(m.raw, provenance_text(m.provenance)) for m in make_all(DESIGN_PATH)] for _ in range(2)
    )
    assert first == second


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.parent.name)
def test_the_committed_images_are_what_the_design_gives(path: Path) -> None:
    assert len(DESIGNS) == 3
    for made in make_all(path):
        assert differences(path.parent, made) == []
        stored = image_path(path.parent, made.law).read_bytes()
        assert round_off(stored, made.raw) is not None


@pytest.mark.parametrize(
    ("factor", "is_round_off"), [(OF_ANOTHER_PROCESSOR, True), (1.0 + 1e-8, False)]
)
def test_the_round_off_of_another_processor_is_no_difference(
    folder: Path, factor: float, is_round_off: bool
) -> None:
    store(folder, factor)
    assert (differences(folder, lqy()) == []) == is_round_off


@pytest.mark.parametrize(("units", "is_round_off"), [(1.0, True), (2.0, False), (0.5, False)])
def test_what_is_stored_rounded_may_fall_to_the_neighbouring_number(
    units: float, is_round_off: bool
) -> None:
    body = parse_image(lqy().raw, "lqy").body.copy()
    gains = body["law"]["inner_loop"]["k_load_radpg"]
    largest = np.unravel_index(np.abs(gains).argmax(), gains.shape)
    gain = float(gains[largest])
    unit = 10.0 ** (math.floor(math.log10(abs(gain))) - 8)  # 9 digits are stored of it
    assert unit > ROUND_OFF_MAX * abs(gain)
    gains[largest] = float(f"{gain - units * unit:.12e}")
    found = round_off(image_bytes("lqy", "hyperion-1", body), lqy().raw)
    assert (found is not None) == is_round_off


@pytest.mark.parametrize(("stored", "made"), [
    (math.inf, 5.0), (5.0, math.inf), (math.nan, 5.0), (5.0, math.nan), (-math.inf, math.inf),
])  # fmt: skip
def test_a_number_that_is_none_is_no_round_off_of_one(stored: float, made: float) -> None:
    column = np.ones((3, 2))
    a, b = column.copy(), column.copy()
    a[1, 1], b[1, 1] = stored, made
    assert apart(a, b) == math.inf
    assert apart(b, b) == (math.inf if math.isnan(made) else 0.0)


def test_verdicts_are_printed_and_round_off_leaves_the_files_as_they_are(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    design = str(folder / "design.toml")
    made = [m.law for m in make_all(folder / "design.toml")]
    assert main(["gains", design]) == 0
    capsys.readouterr()

    def verdicts(*options: str, status: int = 0) -> dict[str, str]:
        assert main(["gains", design, *options]) == status
        lines = capsys.readouterr().out.splitlines()
        return {Path(line.split()[0]).stem: line.split(" bytes  ")[1] for line in lines}

    store(folder, OF_ANOTHER_PROCESSOR)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    told = verdicts("--check")
    assert list(told) == made
    assert told["lqy"].startswith("same up to round-off (")
    told = verdicts()
    assert told["lqy"].startswith("same up to round-off (")
    assert all(line.endswith(", left as it is") for line in told.values())
    assert {path: path.read_bytes() for path in folder.iterdir()} == before

    store(folder, 1.001)
    told = verdicts("--check", status=1)
    assert told["lqy"].startswith("differs: ") and "lqy.load" in told["lqy"]
    assert {line.split(" (")[0] for law, line in told.items() if law != "lqy"} <= {
        "same", "same up to round-off",
    }  # fmt: skip
    assert image_path(folder, "lqy").read_bytes() != lqy().raw  # --check writes nothing
    assert verdicts()["lqy"] == "written"
    assert image_path(folder, "lqy").read_bytes() == lqy().raw
    assert verdicts("--check")["lqy"] == "same"


def test_provenance_of_another_image_is_told(folder: Path) -> None:
    store(folder, OF_ANOTHER_PROCESSOR)
    told = json.loads(provenance_path(folder, "lqy").read_text())
    told["load_crc32"] = "0x00000000"
    provenance_path(folder, "lqy").write_text(json.dumps(told))
    (found,) = compare(folder, lqy()).differences
    assert found.endswith("lqy.json: differs in load_crc32")


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
        assert len(told["inputs_sha256"]) == 2
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
        (lambda f: provenance_path(f, "lqy").unlink(), ["lqy.json: missing or not JSON"]),
        (lambda f: provenance_path(f, "lqy").write_text("{"), ["lqy.json: missing or not JSON"]),
        (lambda f: provenance_path(f, "lqy").write_text("[1]"), ["lqy.json: missing or not JSON"]),
        (
            lambda f: provenance_path(f, "lqy").write_text("[" * 100_000),
            ["lqy.json: missing or not JSON"],
        ),
        (
            lambda f: image_path(f, "lqy").write_bytes(image_path(f, "nominal").read_bytes()),
            ["lqy.load: ", "lqy.json: differs in load_crc32, body_crc32"],
        ),
        (
            lambda f: provenance_path(f, "lqy").write_text('{"law": "lqy"}'),
            ["lqy.json: differs in"],
        ),
    ],
)
@pytest.mark.parametrize("factor", [1.0, OF_ANOTHER_PROCESSOR])
def test_a_stored_file_that_differs_is_told(
    folder: Path, spoil: object, words: list[str], factor: float
) -> None:
    store(folder, factor)
    spoil(folder)  # type: ignore[operator]
    found = differences(folder, lqy())
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
