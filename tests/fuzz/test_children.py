"""What reads damaged files in a process of its own tells every way in which a case can end."""

import ctypes
import os
import random
from collections.abc import Sequence
from pathlib import Path

import pytest

from flight_sw.errors import AeroshellError
from tests.fuzz import children
from tests.fuzz.mutate import STEPS, Step, mutated

HERE = "tests.fuzz.test_children"


def pick(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
    return b"%d" % rng.randrange(7)


def misread(data: bytes, folder: Path) -> None:
    """Ends in a way of its own for each of the numbers."""
    if data == b"1":
        raise AeroshellError("refused")
    if data == b"2":
        raise KeyError("no refusal")
    if data == b"3":
        ctypes.string_at(0)
    if data == b"4":
        bytearray(400 << 20)
    if data == b"5":
        (folder.parent / "beside").touch()
    if data == b"6":
        raise AeroshellError("moves the cursor \x1b[2J")


MISREAD = children.Kind(lambda: [b"0"], misread, pick)
WANTED = {2: "a traceback", 3: "ended by signal 11", 4: "took 4", 5: "wrote outside", 6: "refused"}


def test_each_way_of_ending_wrongly_is_told() -> None:
    seeds = range(12)
    drawn = [int(children.case(MISREAD, [b"0"], seed)) for seed in seeds]
    assert {*drawn} == {*range(7)}
    found = children.failures(f"{HERE}:MISREAD", seeds, at_most=12)
    bad = [(seed, WANTED[n]) for seed, n in zip(seeds, drawn, strict=True) if n in WANTED]
    assert len(found) == len(bad)
    for told, (seed, why) in zip(found, bad, strict=True):
        assert told.startswith(f"seeds {seed}: {why}"), told


def spin(data: bytes, folder: Path) -> None:
    while data != b"0":
        pass


SPINNING = children.Kind(lambda: [b"0"], spin, lambda data, rng, others: b"1")


@pytest.mark.slow
def test_a_case_that_hangs_is_told() -> None:
    found = children.failures(f"{HERE}:SPINNING", range(1))
    assert len(found) == 1 and found[0].startswith("seeds 0: took too long")


def test_the_same_seed_damages_in_the_same_way() -> None:
    data = os.urandom(1000) + b"alpha = 12.5\n[name]\n"
    for seed in range(50):
        assert mutated(data, random.Random(seed)) == mutated(data, random.Random(seed))


@pytest.mark.parametrize("step", STEPS, ids=lambda step: step.__name__)
def test_every_step_takes_any_file_and_changes_some(step: Step) -> None:
    whole = [b"", b"a", b"k = 1\nj = 2\n" * 9, b"\x05\0\0\0\0\0\0\0" * 9]
    changed = set()
    for seed in range(200):
        data = whole[seed % len(whole)]
        out = bytearray(data)
        step(out, random.Random(seed), [data, b"other"])
        if out != data:
            changed.add(data)
    assert changed
