"""What README.md says can be typed works; its numbers are tested in test_readme_numbers.py.

Its `sh` blocks are run line by line in a folder of their own, flights cut short: they end at 110 km
and, where no bus is named, fly in memory without a recording. `make fly` and `make test` are not
run: the one sets up an environment, the other runs this suite. That they and every other target
named exist is asked of `make -n`.
"""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.rules.sources import ROOT
from tools.cli import main

pytestmark = pytest.mark.jit_only

README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```sh\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
SPANS = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```$", "", README, flags=re.M | re.S))
PAGES = ["README.md", *(str(p.relative_to(ROOT)) for p in sorted((ROOT / "docs").rglob("*.md")))]

CUT_SHORT = "--set end.altitude_km=110"
IN_MEMORY = "--bus memory --no-record"
FIRST_FLIGHT = "aeroshell fly hyperion-1 --law nominal"  # keeps the default bus and its recording
TIMEOUT_S = 120  # of one process; it may have to compile
FRAMES_LOGGED_MIN = 1000  # of 13,000: a logger in Python may lag behind the flight


def variant(line: str) -> str:
    """The command as it is run here."""
    command = line.split("#", maxsplit=1)[0].rstrip()
    command = re.sub(r"^make (\S+)", rf"make --no-print-directory -n -C {ROOT} \1", command)
    command = command.replace("sim_harness/missions/", f"{ROOT}/sim_harness/missions/")
    if command == "aeroshell gains hyperion-1":
        return "aeroshell gains gains/hyperion-1/design.toml"  # the copy's images
    if command.startswith("aeroshell campaign"):
        return re.sub(r"-n \d+", "-n 2", command) + f" {CUT_SHORT}"
    if command.startswith("aeroshell fly --from"):
        return re.sub(r"--run \d+", "--run 2", command) + f" {IN_MEMORY}"
    if command.startswith("aeroshell review"):
        command = command.replace("hyperion-1-lqy-001", "hyperion-1-nominal-001")  # is recorded
        draws = any(Path("/usr/share/vulkan/icd.d").glob("*.json"))
        return command if draws else command.replace("--screenshot review.png", "--save x.rrd")
    if not command.startswith("aeroshell fly"):
        return command
    in_memory = "--bus" not in command and command != FIRST_FLIGHT
    options = f"{CUT_SHORT} {IN_MEMORY}" if in_memory else CUT_SHORT
    return command.replace("aeroshell fly", f"aeroshell fly {options}")


def is_for_terminals(block: str) -> bool:
    """Whether the lines of a block run beside each other."""
    return "# terminal 1" in block


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder that commands run in: the gains they refer to, an environment activated."""
    shutil.copytree(ROOT / "gains", tmp_path / "gains")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    monkeypatch.setenv("COLUMNS", "80")
    before = signal.getsignal(signal.SIGTERM)  # the command line takes it over
    yield tmp_path
    signal.signal(signal.SIGTERM, before)


def run(command: str) -> int:
    """Exit status of one command; our own runs in this process, which has its kernels loaded."""
    if command.startswith("aeroshell "):
        return main(shlex.split(command.split(" > ", maxsplit=1)[0])[1:])
    done = subprocess.run(["bash", "-c", command], check=False, timeout=TIMEOUT_S)
    return done.returncode


@pytest.mark.parametrize(
    "block",
    [b for b in BLOCKS if not is_for_terminals(b)],
    ids=lambda block: block.split("#")[0].split("\n")[0].strip().replace("/", "-"),
)
def test_every_command_runs(block: str, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for command in map(variant, block.splitlines()):
        status = run(command)
        told = capfd.readouterr()
        assert status == 0, f"{command}\n{told.out[-2000:]}\n{told.err[-2000:]}"
        if "--json" in command:
            assert json.loads(told.out)["outcome"] == "end condition"
    flights = {p.name for p in folder.glob("runs/hyperion-1-nominal-001/*")}
    if FIRST_FLIGHT in block.split("  "):
        assert flights == {"flight.mcap", "summary.json"}


def await_file(path: Path) -> None:
    """Wait until a part has made its socket or its log: then it is on the bus."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while not path.exists():
        assert time.monotonic() < deadline_s, f"no {path.name}"
        time.sleep(0.05)


def started(command: str) -> subprocess.Popen[str]:
    """A command in a terminal of its own."""
    return subprocess.Popen(
        shlex.split(command), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )


def test_the_parts_run_by_themselves(folder: Path) -> None:
    (block,) = filter(is_for_terminals, BLOCKS)
    *parts, world = map(variant, block.splitlines())
    running = []
    try:
        for command, made in zip(parts, ("entry.bus", "entry.asc", "entry.asc"), strict=True):
            running.append(started(command))
            await_file(folder / made)
        assert run(world) == 0
        hub, logger, computer = running
        assert '"verdicts"' in computer.communicate(timeout=30)[0]
        logger.send_signal(signal.SIGINT)
        logger.communicate(timeout=30)
        hub.send_signal(signal.SIGINT)
        assert "frames received" in hub.communicate(timeout=30)[0]
        assert (hub.returncode, computer.returncode) == (0, 0)
    finally:
        for process in running:
            process.kill()
            process.wait()
    log = (folder / "entry.asc").read_text(encoding="utf-8")
    assert log.count("\n") > FRAMES_LOGGED_MIN


@pytest.mark.parametrize("target", sorted({s.split()[1] for s in SPANS if s.startswith("make ")}))
def test_every_make_target_named_exists(target: str) -> None:
    command = ["make", "--no-print-directory", "-n", "-C", str(ROOT), target]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_somewhere(page: str) -> None:
    path = ROOT / page
    links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8"))
    assert [x for x in links if "://" not in x and not (path.parent / x).exists()] == []


@pytest.mark.parametrize("name", re.findall(r"^\| `([a-z_]+/)` \|", README, re.MULTILINE))
def test_every_folder_named_exists(name: str) -> None:
    assert (ROOT / name).is_dir()
