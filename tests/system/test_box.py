"""The box of `make vcan` ends with whoever started it, however that ends."""

import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RUN = ROOT / "tests" / "vcan" / "run"
END_S = 10.0
COMMAND = f"{RUN} bash -c 'echo up; sleep 60'; true"

pytestmark = [
    pytest.mark.jit_only,
    pytest.mark.skipif(
        not (shutil.which("linux.uml") and shutil.which("busybox")),
        reason="user-mode-linux or busybox-static is not installed",
    ),
    pytest.mark.skipif(
        subprocess.run([RUN, "--native"], capture_output=True, check=False).returncode == 0,
        reason="this kernel has a virtual interface of its own, there is no box",
    ),
]


def boxes(since: set[int]) -> set[int]:
    """Processes of boxes that were not there before."""
    found = set()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            program = (folder / "cmdline").read_bytes().partition(b"\0")[0]
        except OSError:
            continue
        if program.endswith(b"linux.uml"):
            found.add(int(folder.name))
    return found - since


@pytest.mark.parametrize(
    ("whom", "number"),
    [
        ("run", signal.SIGKILL),
        ("run", signal.SIGINT),
        ("run", signal.SIGTERM),
        ("its parent", signal.SIGKILL),
    ],
)
def test_a_box_ends_with_who_started_it(whom: str, number: signal.Signals) -> None:
    before = boxes(set())
    with subprocess.Popen(
        ["bash", "-c", COMMAND], stdout=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "AEROSHELL_BOX_BARE": "1"},
    ) as parent:  # fmt: skip
        assert parent.stdout is not None
        assert any(line == "up\n" for line in parent.stdout)
        assert boxes(before)
        children = Path(f"/proc/{parent.pid}/task/{parent.pid}/children").read_text().split()
        os.kill(int(children[0]) if whom == "run" else parent.pid, number)
        deadline_s = time.monotonic() + END_S
        while boxes(before) and time.monotonic() < deadline_s:
            time.sleep(0.05)
        left = boxes(before)
        for process in left:  # of ours
            os.kill(process, signal.SIGKILL)
        parent.kill()
    assert not left


def test_make_has_the_box_for_its_child() -> None:
    """A shell between the two would outlive a make that is killed, and the box with it."""
    recipes = (ROOT / "Makefile").read_text("utf-8").splitlines()
    started = [
        line.strip()
        for line in recipes
        if line.strip().startswith(("tests/vcan/run", "exec tests/vcan/run"))
    ]
    assert len([line for line in started if line.startswith("exec ")]) == 2
