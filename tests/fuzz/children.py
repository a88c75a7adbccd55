"""Reads damaged files in a process of its own, so that a crash, a hang or a flood of memory is a
failing case and not the end of the tests.

A `Kind` says what is damaged and who reads it; `failures` runs the cases of a range of seeds and
returns those that ended other than in a result or a refusal of one sentence. A child reads many
cases, one after another; the one that it dies of is told, and the next child goes on behind it.
"""

import importlib
import os
import random
import select
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flight_sw.errors import AeroshellError
from tests.fuzz.mutate import mutated

ROOT = Path(__file__).parents[2]
CASE_CPU_S = 10.0  # of processor time, whatever else the machine does
SILENCE_S = 300.0  # of the clock: nobody waits for ever
MEMORY_MAX_BYTES = 256 << 20  # beyond what is held when a case begins
SENTENCE_MAX = 1000  # characters
MB = 1 << 20


@dataclass(frozen=True)
class Kind:
    """One kind of file, or folder handed over as one."""

    samples: Callable[[], Sequence[bytes]]
    """Whole files, the same every time. They are read first: kernels are compiled then."""
    read: Callable[[bytes, Path], object]
    """Hands one to the code, in an empty folder; raises AeroshellError where it is refused."""
    mutate: Callable[[bytes, random.Random, Sequence[bytes]], bytes] = mutated
    refusals: tuple[type[Exception], ...] = field(default=(AeroshellError,))


def case(kind: Kind, samples: Sequence[bytes], seed: int) -> bytes:
    """The damaged file of a seed."""
    rng = random.Random(seed)
    return kind.mutate(rng.choice(samples), rng, samples)


def failures(
    target: str, seeds: range, at_most: int = 5, environment: Mapping[str, str] | None = None
) -> list[str]:
    """What went wrong with the cases of these seeds; `target` is `module:attribute` of a Kind."""
    return _failures((target, "seeds"), [str(seed) for seed in seeds], at_most, environment or {})


def failures_of_files(target: str, paths: Sequence[Path]) -> list[str]:
    """What goes wrong with kept cases."""
    return _failures((target, "files"), [str(path) for path in paths], len(paths), {})


def _failures(
    what: tuple[str, str], names: list[str], at_most: int, environment: Mapping[str, str]
) -> list[str]:
    found: list[str] = []
    while names and len(found) < at_most:
        done, why = _child(what, names, environment)
        if why:
            found.append(f"{what[1]} {names[done]}: {why}")
        names = names[done + 1 :]
    return found


def _child(
    what: tuple[str, str], names: list[str], environment: Mapping[str, str]
) -> tuple[int, str]:
    """How many cases are done, and why no more are."""
    command = [sys.executable, "-X", "faulthandler", "-m", "tests.fuzz.children", *what]
    with tempfile.TemporaryDirectory() as folder:
        wanted, errors = Path(folder, "names"), Path(folder, "errors")
        wanted.write_text("\n".join(names))
        working = Path(folder, "working")
        working.mkdir()
        paths = {"TMPDIR": folder, "PYTHONPATH": str(ROOT)}
        with (
            errors.open("wb") as file,
            subprocess.Popen(
                [*command, str(wanted)],
                stdout=subprocess.PIPE,
                stderr=file,
                cwd=working,
                env={**os.environ, **environment, **paths},
            ) as child,
        ):
            done, why = _heard(child)
        said = errors.read_text(errors="replace")[-3000:]
    if done == len(names) and child.returncode == 0:
        return done, ""
    if not why:
        number = -child.returncode
        ended = "took too long" if number == signal.SIGPROF else f"ended by signal {number}"
        why = ended if number > 0 else "not begun, the whole ones are not read"
    return min(done, len(names) - 1), f"{why}\n{said}"


def _heard(child: subprocess.Popen[bytes]) -> tuple[int, str]:
    """How many cases are done, and what is said of the next."""
    assert child.stdout is not None
    done = 0
    while select.select([child.stdout], [], [], SILENCE_S)[0]:
        line = child.stdout.readline().decode()
        if line != "\n":
            return done, line.strip()
        done += 1
    child.kill()
    return done, f"nothing heard for {SILENCE_S:g} s"


def _kilobytes(name: str) -> int:
    status = Path("/proc/self/status").read_text()
    return int(status.split(f"{name}:")[1].split()[0])


def judge_memory(begun_kb: int) -> str:
    """What is wrong with the memory taken since the peak was forgotten; empty if nothing is."""
    taken = (_kilobytes("VmHWM") - begun_kb) * 1024
    return f"took {taken / MB:.0f} MB" if taken > MEMORY_MAX_BYTES else ""


def forget_peak() -> int:
    """Forget the most memory that was ever held; returns what is held now, in kB."""
    Path("/proc/self/clear_refs").write_text("5")
    return _kilobytes("VmRSS")


def judge(kind: Kind, data: bytes) -> str:
    """What is wrong with how a file is read; empty if nothing is. Raises what a reader raises."""
    before = {*Path.cwd().iterdir()}
    with tempfile.TemporaryDirectory() as outer:
        folder = Path(outer, "folder")
        folder.mkdir()
        try:
            kind.read(data, folder)
        except kind.refusals as error:
            text = str(error)
            if len(text) > SENTENCE_MAX or not text.replace("\n", "").isprintable():
                return f"refused with {text!r:.2000}"
        if [path.name for path in Path(outer).iterdir()] != ["folder"]:
            return "wrote outside of its folder"
    return "wrote into the working folder" if {*Path.cwd().iterdir()} != before else ""


def _run(kind: Kind, form: str, names: list[str]) -> None:
    samples = kind.samples()
    for whole in samples:
        assert judge(kind, whole) == ""
    for name in names:
        data = Path(name).read_bytes() if form == "files" else case(kind, samples, int(name))
        begun_kb = forget_peak()
        signal.setitimer(signal.ITIMER_PROF, CASE_CPU_S)
        try:
            why = judge(kind, data)
        except Exception:
            traceback.print_exc()
            why = "a traceback"
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        why = why or judge_memory(begun_kb)
        print(why, flush=True)
        if why:
            raise SystemExit(1)


def kind_of(target: str) -> Any:
    """The Kind that `module:attribute` names."""
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


if __name__ == "__main__":
    _run(kind_of(sys.argv[1]), sys.argv[2], Path(sys.argv[3]).read_text().split("\n"))
