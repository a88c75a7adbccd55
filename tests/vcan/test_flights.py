"""A flight over SocketCAN is the flight of memory, quiet bus or not, stepped or on the clock."""

import subprocess
import time
from collections.abc import Iterator
from typing import Any

import psutil
import pytest

from flight_sw import icd
from flight_sw.can.address import identifiers_from
from tests.vcan.flying import (
    INTERFACE,
    Trigger,
    end,
    fly,
    frames_through,
    running,
    set_interface,
    start,
)

pytestmark = [pytest.mark.vcan, pytest.mark.jit_only]

FLOOD_S = 10.0
LONG_FLOOD_S = 600.0
REALTIME_S = 60.0
FLOWN_RATIO = 4.0  # seconds of flight in a second of flood
LONG_PIECE_S = 300.0
LOOK_S = 60.0
GROWTH_MAX_MB = 20.0  # of memory in ten minutes
MANY_FRAMES = 20_000
FALSE_EACH = 1000  # frames of each identifier
FALSE_GAP_MS = 5
LUCKY_RATIO = 0.01  # right checksum 1/256, right sequence 3/16 of those, each with a margin


@pytest.fixture(autouse=True)
def interface_up() -> Iterator[None]:
    yield
    set_interface("up")


def sha256_in_memory(time_max_s: float) -> str:
    return str(fly("memory", time_max_s)["command_sha256"])


def test_a_lockstep_flight_sends_the_commands_of_memory() -> None:
    summary = fly(time_max_s=60.0)
    assert summary["failure"] == ""
    assert summary["command_sha256"] == sha256_in_memory(60.0)
    assert (summary["frames_rejected"], summary["frames_dropped"]) == (0, 0)


def test_a_minute_of_entry_in_real_time_slips_nowhere() -> None:
    """A busy host shows as lateness: that is told, and nothing is claimed of the commands."""
    summary = fly(time_max_s=REALTIME_S, pace=1.0)
    slips = {key: summary[key] for key in ("slips", "ticks", "late_commands")}
    harness = summary["timing"]["harness"]
    print(f"real time on {INTERFACE}: {slips} in {summary['minor_frames']} frames, "
          f"wake-up {harness['harness_wake_up_us']} us, round trip {harness['round_trip_us']} us, "
          f"stolen {harness['stolen_s']} s")  # fmt: skip
    assert summary["failure"] == ""
    assert summary["flight_time_s"] == pytest.approx(REALTIME_S)
    assert summary["frames_rejected"] == 0
    if any(slips.values()):
        pytest.skip(f"the machine was too busy for real time: {slips}")
    assert summary["pace_held"] is True
    assert summary["command_sha256"] == sha256_in_memory(REALTIME_S)


def fly_flooded(seconds: float) -> tuple[dict[str, Any], int, float]:
    """A lockstep flight flooded with foreign identifiers: summary, foreign frames, seconds."""
    began: list[tuple[int, float]] = []
    cangens: list[subprocess.Popen[bytes]] = []

    def flood() -> None:
        began.append((frames_through(), time.monotonic()))
        for options in (("-I", "123"), ("-e",)):
            cangens.append(start("cangen", INTERFACE, "-g", "0", "-i", *options))

    try:
        summary = fly(time_max_s=seconds * FLOWN_RATIO, trigger=Trigger(flood))
        before, start_s = began[0]
        elapsed_s = time.monotonic() - start_s
        own = summary["frames_sent"] + summary["computer"]["frames_sent"]
        return summary, frames_through() - before - own, elapsed_s
    finally:
        end(*cangens)


def check_flooded(seconds: float) -> None:
    summary, foreign, elapsed_s = fly_flooded(seconds)
    print(
        f"{foreign} foreign frames in {elapsed_s:.0f} s ({foreign / elapsed_s:.0f} Hz): "
        f"harness counted {summary['rejected_by_harness']['UNKNOWN_ID']} of them, "
        f"sockets dropped {summary['frames_dropped']} frames"
    )
    assert summary["failure"] == ""
    assert foreign > MANY_FRAMES
    assert summary["command_sha256"] == sha256_in_memory(seconds * FLOWN_RATIO)
    assert summary["rejected_by_flight_computer"]["UNKNOWN_ID"] == 0  # the kernel's filter
    assert summary["rejected_by_harness"]["UNKNOWN_ID"] > 0  # it hears everything


def test_a_flood_of_foreign_identifiers_changes_no_command() -> None:
    check_flooded(FLOOD_S)


def memory_mb(*processes: psutil.Process) -> float:
    """Resident memory of processes."""
    return float(sum(process.memory_info().rss for process in processes)) / 1e6


@pytest.mark.slow
def test_ten_minutes_of_foreign_identifiers_change_no_command() -> None:
    """One flight after the other while the flood goes on."""
    wanted = sha256_in_memory(LONG_PIECE_S)
    flights, dropped, taken = 0, 0, [0.0]
    began, start_s = frames_through(), time.monotonic()
    floods = (("cangen", INTERFACE, "-g", "0", "-i", *kind) for kind in (("-I", "123"), ("-e",)))
    with running(*floods):
        while time.monotonic() - start_s < LONG_FLOOD_S:
            summary = fly(time_max_s=LONG_PIECE_S)
            assert summary["failure"] == ""
            assert summary["command_sha256"] == wanted
            dropped += summary["frames_dropped"]  # while a computer starts, nobody reads
            flights += 1
            taken.append(memory_mb(psutil.Process()))
    carried, elapsed_s = frames_through() - began, time.monotonic() - start_s
    print(
        f"{flights} flights in {elapsed_s:.0f} s with {carried} frames on the bus "
        f"({carried / elapsed_s:.0f} Hz), {dropped} dropped by full sockets; "
        f"resident memory {taken[1]:.0f} to {taken[-1]:.0f} MB"
    )
    assert taken[-1] - taken[1] < GROWTH_MAX_MB


@pytest.mark.slow
def test_ten_minutes_of_random_data_under_our_identifiers_are_lived_through() -> None:
    """In real time: the flood is all that the box's one processor has left."""
    memory: list[float] = []

    def look(at_s: float) -> Trigger:
        return Trigger(lambda: memory.append(memory_mb(*psutil.Process().children())), at_s)

    false_ids = [m.can_id for m in icd.LAYOUT if m.name.startswith(("NAV_", "FSW_COMMAND"))]
    began = frames_through()
    floods = [("cangen", INTERFACE, "-g", "0", "-i", "-L", "8", "-I", f"{i:X}") for i in false_ids]
    with running(*floods):
        triggers = [look(LOOK_S), look(LONG_FLOOD_S - LOOK_S)]
        summary = fly(time_max_s=LONG_FLOOD_S, pace=1.0, trigger=triggers[0], also=triggers[1:])
    own = summary["frames_sent"] + summary["computer"]["frames_sent"]
    false = frames_through() - began - own
    by_computer = summary["rejected_by_flight_computer"]
    print(
        f"{false} false frames in {LONG_FLOOD_S:.0f} s: flight computer rejected {by_computer}, "
        f"harness {summary['rejected_by_harness']}; cycles without a whole set "
        f"{summary['incomplete_sets']}, without a fix {summary['without_fix_s']:.2f} s, slips "
        f"{summary['slips']}, late commands {summary['late_commands']}, ticks {summary['ticks']}, "
        f"dropped {summary['frames_dropped']}; the processes beside take {memory} MB"
    )
    assert summary["failure"] == ""
    assert summary["flight_time_s"] == pytest.approx(LONG_FLOOD_S)
    assert false > MANY_FRAMES
    assert sum(by_computer.values()) > MANY_FRAMES
    assert memory[-1] - memory[0] < GROWTH_MAX_MB


def test_false_frames_under_our_identifiers_are_rejected_and_counted() -> None:
    """The harness hears all of them; the flight computer those that it listens to.

    Random data passes an eight-bit checksum once in 256 times, and then its counter three times in
    sixteen; what passes the gates of plausibility too spoils the fix of its cycle at most.
    """
    false_ids = [m.can_id for m in icd.LAYOUT if m.name.startswith("NAV_")]
    processes: list[subprocess.Popen[bytes]] = []
    options = ("-g", str(FALSE_GAP_MS), "-L", "8", "-n", str(FALSE_EACH))

    def disturb() -> None:
        for can_id in false_ids:
            processes.append(start("cangen", INTERFACE, "-I", f"{can_id:X}", *options))

    summary = fly(time_max_s=20.0, pace=1.0, trigger=Trigger(disturb))
    ended = [process.poll() for process in processes]
    end(*processes)
    sent = FALSE_EACH * len(false_ids)
    rejected = sum(summary["rejected_by_flight_computer"].values())
    print(
        f"{sent} false frames: flight computer rejected {rejected} "
        f"{summary['rejected_by_flight_computer']}, cycles without a whole set "
        f"{summary['incomplete_sets']}, without a fix {summary['without_fix_s']:.2f} s, "
        f"late commands {summary['late_commands']}, slips {summary['slips']}"
    )
    assert summary["failure"] == ""
    assert ended == [0] * len(false_ids)
    assert summary["frames_dropped"] == 0
    assert summary["rejected_by_harness"]["FOREIGN"] == sent
    assert rejected >= (1.0 - LUCKY_RATIO) * sent
    assert summary["without_fix_s"] < 1.0


def test_false_commands_are_rejected_by_the_harness_and_the_flight_goes_on() -> None:
    processes: list[subprocess.Popen[bytes]] = []
    options = ("-g", str(FALSE_GAP_MS), "-L", "8", "-n", str(FALSE_EACH))

    def disturb() -> None:
        for can_id in (icd.layout("FSW_COMMAND").can_id, icd.layout("FSW_STATUS").can_id):
            processes.append(start("cangen", INTERFACE, "-I", f"{can_id:X}", *options))

    summary = fly(time_max_s=12.0, pace=1.0, trigger=Trigger(disturb))
    ended = [process.poll() for process in processes]
    end(*processes)
    sent = FALSE_EACH * 2
    rejected = sum(summary["rejected_by_harness"].values())
    print(f"{sent} false answers: harness rejected {rejected} {summary['rejected_by_harness']}")
    assert summary["failure"] == ""
    assert ended == [0, 0]
    assert rejected >= (1.0 - LUCKY_RATIO) * sent
    assert sum(summary["rejected_by_flight_computer"].values()) == 0  # filtered by the kernel


def test_identifiers_of_the_two_sides_share_none() -> None:
    ours, theirs = set(identifiers_from("FSW")), set(identifiers_from("HARNESS"))
    assert ours & theirs == set()
    assert ours | theirs == {message.can_id for message in icd.LAYOUT}
