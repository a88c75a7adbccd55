"""A whole flight among 100,000 false frames with our identifiers and right checksums.

A checksum of eight bits lets one random frame in 256 pass; these pass it all. What is left is the
sequence, the ranges and the gates on what a vehicle can have done since the last fix.
"""

from typing import Any, NamedTuple

import numpy as np
import pytest

from flight_sw import icd
from flight_sw.can.e2e import protect
from flight_sw.computer import minor_frame
from flight_sw.dictionary import FRAME, RX_CAPACITY, TX_CAPACITY
from sim_harness import loop
from sim_harness.jit import kernel
from sim_harness.logs import COMMANDS, Logs
from sim_harness.world.records import END_CONDITION, FLYING
from tests.system.flights import FLOWN, NAV_FRAMES, Computer, World, built, sha256

pytestmark = pytest.mark.jit_only

FALSE_FRAMES = 100_000
CYCLES = 46_000  # longer than the flight
PER_CYCLE_MAX = RX_CAPACITY - NAV_FRAMES
OURS = [message for message in icd.LAYOUT if message.sender == "HARNESS"]


class Noise(NamedTuple):
    """False frames and, for each cycle, where its own begin."""

    frames: np.ndarray
    first: np.ndarray
    before: np.ndarray
    """Before which frame of the navigation set each is put."""


@kernel
def protect_all(codecs: Any, slots: Any, counters: Any, words: Any) -> None:
    """Put counters and right checksums into words."""
    for i in range(len(words)):
        words[i] = protect(codecs[0], slots[i], words[i], counters[i])


@kernel
def mixed(rx: Any, n_rx: int, noise: Any, cycle: int, out: Any) -> int:
    """The cycle's navigation set with its false frames between, into `out`; its length."""
    at = noise.first[cycle]
    n = 0
    for i in range(n_rx):
        while at < noise.first[cycle + 1] and noise.before[at] == i:
            out[n] = noise.frames[at]
            n += 1
            at += 1
        out[n] = rx[i]
        n += 1
    return n


@kernel
def fly_among(harnesses: Any, loads: Any, states: Any, buffers: Any, logs: Any, noise: Any) -> int:
    """A flight in memory whose computer hears the false frames too."""
    rx, both, tx = buffers
    harness = harnesses[0]
    for cycle in range(len(noise.first) - 1):
        n_rx = loop.open_cycle(harness, logs, rx)
        n_tx = minor_frame(loads[0], states[0], both, mixed(rx, n_rx, noise, cycle, both), tx)
        if not loop.take_answer(harness, logs, tx, n_tx):
            return -cycle
        outcome = loop.close_cycle(harness, logs)
        if outcome != FLYING:
            return outcome
    return FLYING


def random_noise(codec: np.ndarray, seed: int) -> Noise:
    """False frames spread evenly over the flight: any payload, any counter."""
    rng = np.random.default_rng(seed)
    which = rng.integers(0, len(OURS), FALSE_FRAMES)
    slots = np.array([icd.slot(message.name) for message in OURS])[which]
    words = rng.integers(0, 1 << 64, FALSE_FRAMES, dtype=np.uint64)
    protect_all(codec, slots, rng.integers(0, 16, FALSE_FRAMES), words)
    frames = np.zeros(FALSE_FRAMES, FRAME)
    frames["can_id"] = np.array([message.can_id for message in OURS])[which]
    frames["dlc"], frames["data"] = 8, words
    cycle = np.sort(rng.integers(0, CYCLES, FALSE_FRAMES))
    before = rng.integers(0, NAV_FRAMES, FALSE_FRAMES)
    order = np.lexsort((before, cycle))
    return Noise(frames, np.searchsorted(cycle, np.arange(CYCLES + 1)), before[order])


def flown_among(law: str, noise: Noise) -> tuple[int, World, Computer]:
    """The flight's outcome, its harness's side and its computer."""
    made = built(law)
    world, computer = World(made, 1), Computer(made)
    buffers = tuple(np.zeros(n, FRAME) for n in (RX_CAPACITY, RX_CAPACITY, TX_CAPACITY))
    logs = Logs(np.zeros(CYCLES, FRAME), world.logs.bus[:0], world.logs.truth[:0])
    world.logs = logs
    outcome = fly_among(world.harness, made.load, computer.state, buffers, logs, noise)
    return outcome, world, computer


def calm_flight(law: str) -> World:
    """The same flight without a false frame."""
    nothing = Noise(np.zeros(0, FRAME), np.zeros(CYCLES + 1, np.int64), np.zeros(0, np.int64))
    outcome, world, _ = flown_among(law, nothing)
    assert outcome == END_CONDITION
    return world


def command_stream(world: World) -> str:
    """Hash over every command of a flight."""
    return sha256(world.logs.commands[: int(world.harness["written"][0, COMMANDS])])


@pytest.mark.parametrize("law", FLOWN)
def test_false_frames_with_right_checksums_move_no_command(law: str) -> None:
    noise = random_noise(built(law).load["codec"], seed=2)
    assert np.diff(noise.first).max() <= PER_CYCLE_MAX
    outcome, world, computer = flown_among(law, noise)
    assert outcome == END_CONDITION
    cycles = int(world.harness["truth"]["minor_frames"][0])
    counted = computer.counted
    assert counted.pop("OK") == NAV_FRAMES * cycles + 1  # the flight's own, and one request
    assert sum(counted.values()) == noise.first[cycles]
    assert set(counted) == {"REPEATED", "WRONG_SEQUENCE", "OUT_OF_RANGE", "IMPLAUSIBLE"}
    assert command_stream(world) == command_stream(calm_flight(law))


@pytest.mark.parametrize("seed", [4, 6])
def test_a_false_frame_that_is_believed_costs_a_few_cycles(seed: int) -> None:
    # One in 100,000 passes every gate: these two draws have one each.
    calm = calm_flight("lqy").harness["truth"][0]
    outcome, world, computer = flown_among("lqy", random_noise(calm_codec(), seed))
    flown = world.harness["truth"][0]
    assert outcome == END_CONDITION
    assert 0 < computer.state["incomplete_sets"][0] <= 3
    assert computer.state["fix_valid"][0] == 1
    for name in ("heat_load_jpm2", "ground_range_m", "t_s"):
        assert flown[name] == pytest.approx(calm[name], rel=1e-5)


def calm_codec() -> np.ndarray:
    """The codec that frames are protected with."""
    return built("lqy").load["codec"]
