"""A whole `design.toml`: what all laws share, and the tables of every family of laws."""

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError, create_model

from flight_sw.errors import DesignError
from flight_sw.guidance import FAMILIES as FLOWN_FAMILIES
from sim_harness.mission.documents import read_toml
from sim_harness.mission.errors import sentence
from sim_harness.mission.quantities import plain
from tools.gains.schema import CommonDesign

FAMILIES = {name: importlib.import_module(f"tools.gains.{name}") for name in FLOWN_FAMILIES}
"""Of each family of laws the package of its name here: it has TABLES and FILLERS."""


def _tables() -> dict[str, Any]:
    """The tables of all families: name, type and default."""
    found: dict[str, Any] = {}
    for name, family in FAMILIES.items():
        if twice := found.keys() & family.TABLES.keys():
            raise ImportError(f"family {name}: table {twice} is another family's")
        found |= family.TABLES
    return found


if TYPE_CHECKING:
    Design = CommonDesign
else:
    Design = create_model("Design", __base__=CommonDesign, __doc__="The whole file.", **_tables())


def read_tree(path: Path) -> dict[str, Any]:
    """The file as nested tables; raises DesignError if it cannot be read as TOML."""
    return read_toml(path, DesignError, str(path))


def design_of(tree: dict[str, Any], where: str) -> Design:
    """The checked design; raises DesignError with file, key, value and what is allowed."""
    try:
        return Design.model_validate(tree)
    except ValidationError as error:
        problems = "; ".join(sentence(Design, tree, e) for e in error.errors()[:3])
        raise DesignError(f"{where}: {problems}") from error


def laws_of(tree: dict[str, Any], path: Path) -> list[str]:
    """The laws that a design names; raises DesignError where its list is none."""
    laws = tree.get("laws", [])
    if not isinstance(laws, list) or not all(isinstance(law, str) for law in laws):
        raise DesignError(f"{path}: laws is {plain(laws)}, allowed a list of names of laws")
    return laws
