"""After boot nothing allocates: in the machine code, in numba's counters, in the interpreter's."""

import gc
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError
from numba.core.runtime import _nrt_python, rtsys

from flight_sw.executive import serve
from sim_harness.flight.flight import hand_over
from sim_harness.flight.loop import fly_in_memory
from sim_harness.jit import kernel
from tests.flight_sw.test_executive import Loop
from tests.system.flights import FLOWN, MARS_LAWS, PLANNED_LAWS, Computer, World, any_built, built

pytestmark = pytest.mark.jit_only

ALLOCATORS = re.compile(
    r"\b(NRT_Allocate\w*|NRT_MemInfo_(?:new|alloc|varsize)\w*|malloc|calloc|realloc|posix_memalign|"
    r"Py\w+_New\w*|PyList_\w+|PyMem_\w+|PyObject_Malloc)\b"
)
WRAPPER_ONLY = {"PyBytes_FromStringAndSize", "PyUnicode_FromString"}  # texts of refused arguments
CHUNK_CYCLES = 400
SETTLING_CALLS = 600  # calls that fly nothing fill the lists of free objects that gc emptied
WARM_UP = 3  # first calls of a round, not counted
CALLS_A_ROUND = 30
ROUNDS = 3


def allocators_in(compiled: Any) -> set[str]:
    """Allocating functions that a fresh copy's machine code names, callees linked in."""
    (signature,) = compiled.signatures
    return set(ALLOCATORS.findall(compiled.inspect_asm(signature)))


def symbols_in(compiled: Any) -> str:
    """The whole assembly, to see that the callees are in it."""
    (signature,) = compiled.signatures
    return str(compiled.inspect_asm(signature))


@kernel
def make_array(n: int) -> float:
    """What a kernel must not do."""
    return np.zeros(n)[n - 1]


@numba.njit
def make_array_all_the_same(n: int) -> float:
    """The same, without the project's flags."""
    return np.zeros(n)[n - 1]


@numba.njit
def call_it(n: int) -> float:
    """An allocation behind a call."""
    return make_array_all_the_same(n) + 1.0


def test_a_kernel_that_would_allocate_is_refused_by_the_compiler() -> None:
    with pytest.raises(TypingError, match="zeros"):
        make_array(3)


def test_an_allocation_is_seen_behind_a_call(fresh_compile: Callable[..., Any]) -> None:
    assert call_it(3) == 1.0
    assert allocators_in(fresh_compile(call_it, 3))


HOLDS_ALL_OF_MARS = "range-predictor"  # but the control of the two that track drag


@pytest.mark.parametrize(
    "law",
    [*FLOWN, HOLDS_ALL_OF_MARS, *PLANNED_LAWS,
     *(pytest.param(law, marks=pytest.mark.slow) for law in MARS_LAWS if law != HOLDS_ALL_OF_MARS)],
)  # fmt: skip
def test_the_minor_frame_holds_no_allocation(law: str, fresh_compile: Callable[..., Any]) -> None:
    made = any_built(law)
    computer = Computer(made)
    compiled = fresh_compile(hand_over, made.load, computer.state, computer.tx, 1, computer.tx)
    assert allocators_in(compiled) == set()
    for callee in ("minor_frame", "modelled_forces", "limits5limit", "receiver5judge"):
        assert callee in symbols_in(compiled)


def test_the_executive_holds_no_allocation(fresh_compile: Callable[..., Any]) -> None:
    loop = Loop()
    made, computer = loop.flight.made, loop.computer
    compiled = fresh_compile(
        serve, 0, loop.io, made.load, computer.state, loop.executive, loop.rx, loop.tx, 0
    )
    assert allocators_in(compiled) == set()
    assert "recvmmsg" in symbols_in(compiled)
    assert "sendmmsg" in symbols_in(compiled)


def test_the_flight_loop_holds_no_allocation(fresh_compile: Callable[..., Any]) -> None:
    world, computer = World(built("lqy"), 10), Computer(built("lqy"))
    compiled = fresh_compile(
        fly_in_memory, world.harness, built("lqy").load, computer.state, world.step_time, world.rx,
        world.tx, world.logs, 1,
    )  # fmt: skip
    assert allocators_in(compiled) == set()


def counters() -> np.ndarray:
    """numba's allocations and frees (twice: memory, owners), and the interpreter's live blocks."""
    return np.array([*rtsys.get_allocation_stats(), sys.getallocatedblocks()])


@pytest.fixture
def counting() -> Iterator[None]:
    """numba counts, and the collector is off as in the running flight computer."""
    _nrt_python.memsys_enable_stats()
    gc.collect()
    gc.disable()
    yield
    gc.enable()
    _nrt_python.memsys_disable_stats()


def rounds_of(call: Callable[[], None], rounds: int, calls: int) -> np.ndarray:
    """Counters before and after every call, by rounds: shape (rounds, calls, 5)."""
    for _ in range(SETTLING_CALLS):
        counters()
    readings = np.zeros((rounds, calls + 1, 5), np.int64)
    for of_round in readings:
        of_round[0] = counters()
        for reading in of_round[1:]:
            call()
            reading[:] = counters()
    return readings


def check(readings: np.ndarray) -> None:
    """Each call wraps its arrays and lets them go; frames add nothing, and nothing stays.

    What stays of every call stays in every round. The interpreter's blocks are those of the whole
    process: others take some in one round, and what they let go says nothing at all.
    """
    per_call = np.diff(readings[:, WARM_UP:], axis=1)
    of_numba = per_call[..., :4].reshape(-1, 4)
    assert (of_numba == of_numba[0]).all()
    allocated, freed, made, dropped = of_numba[0]
    assert (allocated, made) == (freed, dropped)
    stayed = per_call[..., 4].sum(axis=1)
    assert stayed.min() < per_call.shape[1] / 2, f"blocks that stayed, by rounds: {stayed}"


WHOLE = {
    **dict.fromkeys(FLOWN, (40, 2400.0)),
    **dict.fromkeys(MARS_LAWS, (12, 1000.0)),
    **dict.fromkeys(PLANNED_LAWS, (66, 520.0)),
}
"""Of each law the calls a round that fly its mission to the end, and a speed fallen below then."""


@pytest.mark.parametrize("law", WHOLE)
def test_no_counter_moves_over_a_whole_flight(law: str, counting: None) -> None:
    calls, end_mps = WHOLE[law]
    made = any_built(law)
    world, computer = World(made, 90_000), Computer(made)
    for _ in range(SETTLING_CALLS):
        world.fly(computer, 0)
    check(rounds_of(lambda: world.fly(computer, CHUNK_CYCLES), ROUNDS, calls))
    assert world.harness["truth"]["v_rel_mps"][0] < end_mps  # it has flown to the end


def test_what_stays_of_every_call_is_seen_and_what_is_freed_is_no_fault(counting: None) -> None:
    kept: list[object] = []
    taken: list[object] = [object() for _ in range(20 * CALLS_A_ROUND)]
    check(rounds_of(taken.pop, ROUNDS, CALLS_A_ROUND))
    readings = rounds_of(lambda: kept.append(object()), ROUNDS, CALLS_A_ROUND)
    with pytest.raises(AssertionError, match="blocks that stayed"):
        check(readings)
    once = iter([1_000])  # somebody else's burst, in one round
    check(rounds_of(
        lambda: kept.extend(object() for _ in range(next(once, 0))), ROUNDS, CALLS_A_ROUND
    ))  # fmt: skip
    with pytest.raises(AssertionError):
        check(rounds_of(lambda: make_array_all_the_same(3), ROUNDS, CALLS_A_ROUND) + leak())


def leak() -> np.ndarray:
    """What numba's counters would show of a block a call that is not freed."""
    counted = np.zeros((1, CALLS_A_ROUND + 1, 5), np.int64)
    counted[0, :, 0] = np.arange(CALLS_A_ROUND + 1)
    return counted


def test_ten_thousand_frames_cost_what_one_costs(counting: None) -> None:
    def cost(cycles: int) -> list[int]:
        world, computer = World(built("lqy"), 12_000), Computer(built("lqy"))
        world.fly(computer, 1)
        before = counters()
        world.fly(computer, cycles)
        return (counters() - before)[:4].tolist()

    cost(1)
    assert cost(10_000) == cost(1)


def serving_readings() -> np.ndarray:
    """Counters over cycles served from a socket, by rounds."""
    loop = Loop()
    for _ in range(SETTLING_CALLS):
        loop.serve(slice_ns=0)
    cycles = iter(loop.flight.navigation)
    loop.send(next(cycles))
    loop.serve()
    before = int(loop.executive["cycles"][0])

    def serve_one() -> None:
        loop.send(next(cycles))
        loop.serve(slice_ns=1)
        loop.answers()

    readings = rounds_of(serve_one, ROUNDS, 12)
    assert loop.executive["cycles"][0] == before + ROUNDS * 12
    return readings


def test_the_serving_loop_moves_no_counter(tmp_path: Path) -> None:
    """In a process of its own, as it flies: what other tests compiled counts in theirs."""
    kept = tmp_path / "readings.npy"
    done = subprocess.run(
        [sys.executable, "-m", "tests.system.test_allocation", str(kept)],
        cwd=Path(__file__).parents[2], capture_output=True, text=True, timeout=400.0, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    check(np.load(kept))


if __name__ == "__main__":
    _nrt_python.memsys_enable_stats()
    gc.collect()
    gc.disable()
    np.save(sys.argv[1], serving_readings())
