"""requirements.lock holds what pyproject.toml asks for, all of it and only with hashes."""

import re
import sys
import tomllib
from importlib import metadata
from typing import NamedTuple

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.rules.sources import ROOT

FLIGHT_BUILD = ("numpy", "numba")  # part of what flies: exact, and installed as locked
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PYTHONS = ("3.11", "3.12", "3.13")
HASH = re.compile(r"--hash=sha256:[0-9a-f]{64}")


class Locked(NamedTuple):
    """One entry of the lock."""

    requirement: Requirement
    hashes: int

    @property
    def version(self) -> str:
        """The one version it admits."""
        (specifier,) = self.requirement.specifier
        assert specifier.operator == "==", f"{self.requirement} is not pinned"
        return specifier.version


def read_lock() -> list[Locked]:
    """All entries, continuation lines joined."""
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    entries = []
    for line in text.replace("\\\n", " ").splitlines():
        if line.strip() and not line.lstrip().startswith("#"):
            wanted = line.split("--hash")[0].strip()
            entries.append(Locked(Requirement(wanted), len(HASH.findall(line))))
    return entries


LOCK = read_lock()


def pins_for(python: str) -> dict[str, str]:
    """Name to version, as pip on Linux with this Python reads the lock."""
    environment = {
        "python_version": python, "python_full_version": f"{python}.0", "sys_platform": "linux",
    }  # fmt: skip
    chosen = [
        e for e in LOCK if not e.requirement.marker or e.requirement.marker.evaluate(environment)
    ]
    names = [canonicalize_name(e.requirement.name) for e in chosen]
    assert len(set(names)) == len(names), f"two versions of one package for Python {python}"
    return {name: e.version for name, e in zip(names, chosen, strict=True)}


def asked_for() -> list[Requirement]:
    """Every requirement of the project, its development tools and its build backend."""
    project = PROJECT["project"]
    lines = [*project["dependencies"], *project["optional-dependencies"]["dev"]]
    return [Requirement(line) for line in (*lines, *PROJECT["build-system"]["requires"])]


@pytest.mark.parametrize("python", PYTHONS)
def test_lock_satisfies_the_project(python: str) -> None:
    pins = pins_for(python)
    for wanted in asked_for():
        version = pins.get(canonicalize_name(wanted.name), "")
        assert version and wanted.specifier.contains(version), f"{wanted}: lock has {version!r}"


def test_every_entry_has_hashes() -> None:
    assert [str(e.requirement) for e in LOCK if not e.hashes] == []


def test_lock_is_complete_without_resolving() -> None:
    """Setup installs with --no-deps, so each locked package's own needs must be locked too."""
    pins = pins_for(f"{sys.version_info.major}.{sys.version_info.minor}")
    missing = []
    for name in pins:
        for line in metadata.requires(name) or []:
            needed = Requirement(line)
            if needed.marker and not needed.marker.evaluate({"extra": ""}):
                continue
            version = pins.get(canonicalize_name(needed.name), "")
            if not version or not needed.specifier.contains(version, prereleases=True):
                missing.append(f"{name} needs {needed}, lock has {version!r}")
    assert not missing


@pytest.mark.parametrize("name", FLIGHT_BUILD)
def test_flight_build_is_pinned_exactly_and_installed(name: str) -> None:
    (wanted,) = [r for r in asked_for() if r.name == name]
    assert str(wanted) == f"{name}=={metadata.version(name)}"
