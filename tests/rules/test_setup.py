"""Setup says in one sentence what a machine lacks."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.rules.sources import ROOT

FIND_PYTHON = ROOT / ".ci" / "find-python"


def find_python(python: Path | str) -> subprocess.CompletedProcess[str]:
    """What setup answers when it is told to use this interpreter."""
    return subprocess.run(
        ["bash", str(FIND_PYTHON)],
        env={**os.environ, "PYTHON": str(python)},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


def stub(folder: Path, script: str) -> Path:
    """An executable that stands for an interpreter."""
    path = folder / "python3"
    path.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    path.chmod(0o755)
    return path


def test_this_interpreter_is_taken() -> None:
    answer = find_python(sys.executable)
    assert (answer.returncode, answer.stdout) == (0, f"{sys.executable}\n")


def test_an_old_interpreter_is_named_with_what_is_needed(tmp_path: Path) -> None:
    old = stub(tmp_path, '[ "$1" = -V ] && echo Python 3.10.13; exit 1')
    answer = find_python(old)
    assert answer.returncode == 1 and answer.stdout == ""
    assert answer.stderr == (
        f"setup: {old} is 'Python 3.10.13', needed is Python 3.11 or newer; "
        "name one with 'make setup PYTHON=/path/to/python3'\n"
    )


def test_a_missing_venv_module_is_named_with_its_package(tmp_path: Path) -> None:
    bare = stub(tmp_path, 'case "$2" in *ensurepip*) exit 1;; esac')
    answer = find_python(bare)
    assert answer.returncode == 1
    assert answer.stderr == (
        f"setup: {bare} cannot make virtual environments (no venv or ensurepip module); "
        "Debian has it in the package python3-venv\n"
    )


@pytest.mark.parametrize("script", [".ci/run", ".ci/find-python"])
def test_scripts_parse(script: str) -> None:
    subprocess.run(["bash", "-n", str(ROOT / script)], check=True, timeout=60)


def test_every_target_is_in_the_help() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8").splitlines()
    phony = {line.split(": ")[1] for line in makefile if line.startswith(".PHONY: ")}
    listed = {line.split(":")[0] for line in makefile if ": ## " in line or " ## " in line}
    assert phony <= listed
