"""Readers that are not ours take a recording whole: @mcap/core in node, and rerun's own check."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from sim_harness.telemetry.reader import open_recording
from tests.replay.record import FLIGHTS, FOLDER

PACKAGES = ("@mcap/core@2.2.2", "fzstd@0.1.1")
INSTALL_TIMEOUT_S = 120.0
READER = Path(__file__).with_name("read_mcap.mjs")
RECORDINGS = [FOLDER / f"{name}.mcap" for name in FLIGHTS]


@pytest.fixture(scope="module")
def node_modules(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the packages; skips where node or its registry is not to be had."""
    if not (shutil.which("node") and shutil.which("npm")):
        pytest.skip("node and npm are not installed")
    folder = tmp_path_factory.mktemp("node")
    (folder / "package.json").write_text("{}")
    command = ["npm", "install", "--no-audit", "--no-fund", "--silent", *PACKAGES]
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, timeout=INSTALL_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        pytest.skip("npm did not answer in time")
    if done.returncode != 0:
        pytest.skip("npm could not install @mcap/core")
    return folder


def read_by_node(folder: Path, *paths: Path) -> list[dict[str, Any]]:
    """What @mcap/core finds in recordings; any error or warning fails."""
    command = ["node", str(READER), str(folder), *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120.0, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_mcap_core_reads_every_message_checksum_and_index(node_modules: Path) -> None:
    for path, told in zip(RECORDINGS, read_by_node(node_modules, *RECORDINGS), strict=True):
        recording = open_recording(path)
        assert told["isDone"]
        assert told["messages"] == told["indexed"] == told["statistics"] > 800
        manifest = told["metadata"]["aeroshell.manifest"]
        assert manifest == {**recording.manifest, "crc32": manifest["crc32"]}
        assert told["metadata"]["aeroshell.outcome"] == dict(recording.outcome)
        assert told["attachments"] == {n: len(d) for n, d in recording.attachments.items()}
        assert told["topics"]["/truth" if "/truth" in told["topics"] else "/bus/frames"] > 10


def test_mcap_core_reads_a_torn_recording_up_to_where_it_ends(
    node_modules: Path, tmp_path: Path
) -> None:
    torn = tmp_path / "torn.mcap"
    whole = RECORDINGS[0].read_bytes()
    torn.write_bytes(whole[: len(whole) * 3 // 4])
    (told,) = read_by_node(node_modules, torn)
    assert not told["isDone"]
    assert told["attachments"] and told["metadata"]["aeroshell.manifest"]


@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: path.stem)
def test_rerun_checks_a_recording_without_an_issue(path: Path) -> None:
    command = [str(Path(sys.executable).parent / "rerun"), "mcap", "check", "--full", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120.0, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    rows = [line for line in done.stdout.splitlines() if "/" in line and ".mcap" not in line]
    assert len(rows) > 10
    assert all(row.split()[0] == "ok" and row.rstrip().endswith("—") for row in rows)
