"""Missions that can be flown: read from their files, and refused where no world can be made."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sim_harness.mission.mission import Mission, read_mission, stated_mission
from sim_harness.world.assembly import world_of


def load_mission(name_or_path: str | Path, overrides: Mapping[str, Any] | None = None) -> Mission:
    """A shipped mission by name, or one's own by the path of its TOML file.

    Raises MissionError for a file, a key or a value that is not allowed, and for what a flight
    could not be made from.
    """
    return _tried(read_mission(name_or_path, overrides))


def mission_of(raw: dict[str, Any], path: Path, label: str) -> Mission:
    """The mission that a file's tables state; `label` is what a refusal calls them."""
    return _tried(stated_mission(raw, path, label))


def _tried(mission: Mission) -> Mission:
    """The mission, once its world has been made: that reads the files which it refers to."""
    world_of(mission)
    return mission
