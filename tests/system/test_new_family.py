"""A family of laws moves in by two folders, a message and a design; no list elsewhere is edited."""

import csv
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from flight_sw import icd
from tests.system.flights import ROOT

pytestmark = pytest.mark.jit_only  # the copy runs in the interpreter either way

LAW = """
from flight_sw.records import status
from flight_sw.records.fields import Field, RecordSpec
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

PHASES = ("CONSTANT",)
FIRST_PHASE: dict[str, int] = {}
TELEMETRY = ("steps_taken",)
DESIGN = RecordSpec("constant_bank", Field("bank_rad", -3.2, 3.2))
STATE = RecordSpec("constant_bank_state", Field("steps", kind="u4"))


@kernel
def step(load: Record, state: Record, nav: Record, out: Record) -> int:
    state["steps"] += 1
    out["bank_cmd_rad"] = load["law"]["bank_rad"]
    out["telemetry"][0] = state["steps"]
    return status.OK
"""
FLOWN_SIDE = """
from flight_sw.guidance.open_loop import constant_bank

LAWS = {"constant-bank": (200, constant_bank)}
"""
DESIGN_SIDE = '''
import math
from typing import Annotated

from sim_harness.mission.quantities import Quantity, Section


class ConstantBank(Section):
    """A bank."""

    bank_deg: Annotated[float, Quantity("deg", -180.0, 180.0, "held")]


def fill(body, design, mission, law):
    choice = design.table(ConstantBank, "constant_bank", law)
    body["law"]["bank_rad"] = math.radians(choice.bank_deg)
    return {}


TABLES = {"constant_bank": (ConstantBank | None, None)}
FILLERS = {"constant-bank": fill}
'''
MESSAGE = """
BO_ 1904 TM_CONSTANT_BANK: 8 FSW
 SG_ e2e_crc : 0|8@1+ (1,0) [0|255] "" HARNESS
 SG_ e2e_counter : 8|4@1+ (1,0) [0|15] "" HARNESS
 SG_ steps_taken : 12|32@1+ (1,0) [0|4294967295] "" HARNESS

CM_ "Aeroshell"""
ATTRIBUTES = """
BA_ "GenMsgCycleTime" BO_ 1904 100;
BA_ "E2EDataIds" BO_ 1904 "0102030405060708090a0b0c0d0e0f10";
BA_ "GenMsgCycleTime" BO_ 16 20;"""
CHECKED = "same"
PROGRAM = "import sys; sys.path.insert(0, '.'); from tools.cli import main; main()"


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """A copy of the sources with one more family in it."""
    for name in ("flight_sw", "sim_harness", "tools", "gains"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    flown = tmp_path / "flight_sw" / "guidance" / "open_loop"
    designed = tmp_path / "tools" / "gains" / "open_loop"
    for folder, text in ((flown, FLOWN_SIDE), (designed, DESIGN_SIDE)):
        folder.mkdir()
        (folder / "__init__.py").write_text(text, encoding="utf-8")
    (flown / "constant_bank.py").write_text(LAW, encoding="utf-8")
    dbc = tmp_path / "flight_sw" / "icd" / icd.DBC_PATH.name
    text = dbc.read_text(encoding="utf-8")
    first_time = '\nBA_ "GenMsgCycleTime" BO_ 16 20;'
    for mark, added in (('\nCM_ "Aeroshell', MESSAGE), (first_time, ATTRIBUTES)):
        assert text.count(mark) == 1
        text = text.replace(mark, added)
    dbc.write_text(text, encoding="utf-8")
    return tmp_path


def aeroshell(house: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The command line of the copy, uncompiled."""
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *arguments],
        cwd=house, capture_output=True, text=True, check=False, timeout=300,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
    )  # fmt: skip


def test_a_new_family_is_designed_and_flown_and_refuses_no_load_of_the_others(house: Path) -> None:
    checked = aeroshell(house, "gains", "hyperion-1", "--check")
    assert checked.returncode == 0, checked.stdout + checked.stderr
    images = list((ROOT / "gains" / "hyperion-1").glob("*.load"))
    assert checked.stdout.count(CHECKED) == len(images)
    design = house / "gains" / "hyperion-1" / "design.toml"
    text = design.read_text(encoding="utf-8")
    first = text.index("laws = [") + len("laws = [")
    table = "\n[constant_bank]\nbank_deg = 60.0\n"
    design.write_text(f'{text[:first]}"constant-bank", {text[first:]}{table}', "utf-8")
    made = aeroshell(house, "gains", "hyperion-1")
    assert made.returncode == 0, made.stderr
    flown = aeroshell(
        house, "fly", "hyperion-1", "--law", "constant-bank", "--bus", "memory", "--out", "flown",
        "--set", "time_max_s=0.5", "--set", "entry_load_g=0",
    )  # fmt: skip
    assert flown.returncode == 0, flown.stderr
    told = aeroshell(house, "export", "flown", "--format", "csv")
    assert told.returncode == 0, told.stderr
    (found,) = house.rglob("TM_CONSTANT_BANK.csv")
    with found.open(encoding="utf-8", newline="") as file:
        steps = [float(row["steps_taken"]) for row in csv.DictReader(file)]
    assert len(steps) >= 4 and steps == sorted(steps) and steps[-1] > 10
