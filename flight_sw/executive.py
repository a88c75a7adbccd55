"""The cyclic loop: wait for frames, step, send, account for time.

It does its own poll, receive and send through the C library with the interpreter's lock released,
and comes back to Python a few times a second so that signals are seen. Three ways to wait:

* lockstep: for frames, however long they take; time is what the time message says.
* frame-synchronised: for frames, but a cycle whose time message is overdue is closed by a tick.
* clocked: for absolute deadlines a period apart, midway between arrivals; what has come by then is
  the cycle's. The first cycles are frame-synchronised, to learn when frames arrive.

An interface that goes down is not the end: the cycles go on by ticks, so that mode and time are
kept, until a frame goes through again or BUS_DOWN_MAX_NS have passed.
"""

import numpy as np

from flight_sw import icd
from flight_sw.can.address import ERROR_FLAG
from flight_sw.can.bursts import recv_rest
from flight_sw.can.codec import pack
from flight_sw.can.e2e import protect
from flight_sw.can.error_frames import ERRORS, note_error
from flight_sw.can.libc import monotonic_ns, sleep_until_ns
from flight_sw.can.sockets import BUS_DOWN, recv_frames, send_frames
from flight_sw.computer import COUNTER_MODULUS, minor_frame
from flight_sw.guidance import law_step
from flight_sw.reception.navigation_set import is_held_up
from flight_sw.records.dictionary import RX_CAPACITY, TICK_ID
from flight_sw.records.types_ import Frames, Record
from flight_sw.runtime.histogram import HISTOGRAM, add
from flight_sw.runtime.jit import kernel

RUNNING, STOPPED, BUS_LOST = 0, 1, 2
LOCKSTEP, FRAME_SYNCHRONISED, CLOCKED = 0, 1, 2
SYNCHRONISATIONS = ("lockstep", "frame", "clock")

TIMING = icd.slot("FSW_TIMING")
STEP_MAX = icd.value_index("FSW_TIMING", "step_max_us")
WAKE_UP_MAX = icd.value_index("FSW_TIMING", "wake_up_max_us")
SLIPS = icd.value_index("FSW_TIMING", "slips")
TICKS = icd.value_index("FSW_TIMING", "ticks")
COUNT_MAX = (1 << 10) - 1  # what the signals of counters carry
MICROSECONDS_MAX = 65535.0
NS_PER_MS = 1_000_000

EXECUTIVE = np.dtype(
    [
        ("synchronisation", "u4"),
        ("timing_counter", "u4"),  # of FSW_TIMING
        ("clocked", "i8"),  # 1: deadlines have replaced arrivals
        ("looked_ns", "i8"),  # when the bus was looked at without waiting; 0: it was waited for
        ("in_burst", "i8"),  # 1: the last frames did not close a cycle, more will follow at once
        ("silent_slices", "i8"),  # calls in a row that brought no frame
        ("full_in_row", "i8"),  # receptions that brought as many frames as there is room for
        ("period_ns", "i8"),  # of a minor frame on the clock; lockstep has none
        ("cycles", "i8"),
        ("frames_received", "i8"),
        ("frames_sent", "i8"),
        ("false_ticks", "i8"),  # frames from the bus that looked like the executive's own tick
        ("errors", ERRORS),  # what the interface told of itself
        ("bus_losses", "i8"),  # times the interface went down
        ("down_ns", "i8"),  # since when it is; 0: it is not
        ("down_total_ns", "i8"),  # in the losses that are over
        ("ticked", "i8"),  # 1: the cycle in hand is closed by a tick
        ("ticks", "i8"),  # cycles closed without a time message
        ("slips", "i8"),  # cycles not finished when the next was due
        ("due_ns", "i8"),  # when the next cycle is due, as the earliest arrivals tell; 0: none yet
        ("told_ns", "i8"),  # when timing was last telemetered
        ("step_recent_ns", "i8"),  # longest since then
        ("wake_up_recent_ns", "i8"),
        ("step_time", HISTOGRAM),
        ("wake_up", HISTOGRAM),  # how late a cycle began, after when it was due
        ("values", "f8", (icd.N_VALUES,)),  # of FSW_TIMING
    ],
    align=True,
)
"""The loop's own account; it reads the clock, so it stays outside the computer's state."""

SILENT_SLICES = 2  # in lockstep, then a set whose time message was refused is a cycle all the same
OVERDUE_DIVIDER = 2  # a time message is overdue half a period after it was due
PHASE_SHIFT = 3  # a late arrival moves the next by an eighth of its lateness, an early one wholly
PHASE_CYCLES = 32  # frame-synchronised ones before a clocked computer trusts their phase
FULL_IN_ROW_MAX = 64  # receptions; a bus that floods us for so long does not hold ticks up
NAP_NS = 100_000  # between two looks at the bus in the last millisecond before a deadline
BUS_DOWN_MAX_NS = 5_000_000_000
DOWN_PAUSE_NS = 1_000_000  # between two tries to wait on an interface that is down
TELEMETRY_NS = icd.layout("FSW_TIMING").cycle_ms * NS_PER_MS


@kernel
def _keep_data(rx: Frames, n_rx: int, executive: Record) -> int:
    """Take out what is not for the minor frame: false ticks, error frames."""
    kept = 0
    for i in range(n_rx):
        if rx[i]["can_id"] == TICK_ID:
            executive["false_ticks"] += 1
            continue
        if rx[i]["can_id"] & ERROR_FLAG != 0:
            note_error(executive["errors"], rx[i]["can_id"], rx[i]["data"])
            continue
        if kept != i:
            rx[kept]["can_id"] = rx[i]["can_id"]
            rx[kept]["dlc"] = rx[i]["dlc"]
            rx[kept]["data"] = rx[i]["data"]
        kept += 1
    return kept


@kernel
def _note_down(executive: Record) -> None:
    """The interface is down: count it once, and remember since when."""
    if executive["down_ns"] == 0:
        executive["bus_losses"] += 1
        executive["down_ns"] = monotonic_ns()


@kernel
def _note_up(executive: Record) -> None:
    """A frame went through: the interface is up."""
    if executive["down_ns"] != 0:
        executive["down_total_ns"] += monotonic_ns() - executive["down_ns"]
        executive["down_ns"] = 0


@kernel
def _is_lost(executive: Record, now_ns: int) -> bool:
    """Whether the interface has been down for too long."""
    return executive["down_ns"] != 0 and now_ns - executive["down_ns"] > BUS_DOWN_MAX_NS


@kernel
def _overdue_ns(executive: Record) -> int:
    """When a cycle is closed without its time message."""
    return executive["due_ns"] + executive["period_ns"] // OVERDUE_DIVIDER


@kernel
def _tick(rx: Frames, executive: Record) -> int:
    rx[0]["can_id"] = TICK_ID
    executive["ticked"] = 1
    executive["ticks"] += 1
    return 1


@kernel
def _receive(fd: int, io: Record, executive: Record, rx: Frames, timeout_ms: int) -> int:
    """Frames for the minor frame; below 0 bus lost. An interface that is down brings none."""
    executive["looked_ns"] = monotonic_ns() if timeout_ms == 0 else 0
    n_rx = 0
    if executive["in_burst"] == 1:
        n_rx = recv_rest(fd, io, rx, RX_CAPACITY)
    if n_rx == 0:
        n_rx = recv_frames(fd, io, rx, RX_CAPACITY, timeout_ms)
    executive["full_in_row"] = executive["full_in_row"] + 1 if n_rx == RX_CAPACITY else 0
    if n_rx == BUS_DOWN:
        _note_down(executive)
        sleep_until_ns(monotonic_ns() + DOWN_PAUSE_NS)
        return 0
    if n_rx > 0:
        _note_up(executive)
        executive["frames_received"] += n_rx
        return _keep_data(rx, n_rx, executive)
    return n_rx


@kernel
def _wait(fd: int, io: Record, executive: Record, rx: Frames, end_ns: int) -> int:
    """Frames for the minor frame: 0 at the end of the slice or overdue, below 0 bus lost."""
    now_ns = monotonic_ns()
    executive["ticked"] = 0
    if executive["clocked"] == 1:
        if executive["due_ns"] > end_ns:
            sleep_until_ns(end_ns)
            executive["looked_ns"] = 0
            return 0
        sleep_until_ns(executive["due_ns"])
        return _receive(fd, io, executive, rx, 0)
    wait_ms = max((end_ns - now_ns + NS_PER_MS - 1) // NS_PER_MS, 0)
    if executive["synchronisation"] != LOCKSTEP and executive["due_ns"] > 0:
        left_ns = _overdue_ns(executive) - now_ns
        if 0 < left_ns < NS_PER_MS:  # nearer than poll can tell
            sleep_until_ns(now_ns + min(left_ns, NAP_NS))
        wait_ms = min(wait_ms, max(left_ns // NS_PER_MS, 0))
    return _receive(fd, io, executive, rx, wait_ms)


@kernel
def _next_deadline(executive: Record, done_ns: int) -> None:
    """A clocked cycle is over: each deadline that passed before its end is a slip."""
    period_ns = executive["period_ns"]
    executive["due_ns"] += period_ns
    if done_ns > executive["due_ns"]:
        passed = (done_ns - executive["due_ns"]) // max(period_ns, 1)
        executive["slips"] += passed + 1
        executive["due_ns"] += passed * period_ns


@kernel
def _next_arrival(executive: Record, cycles: int, woken_ns: int, done_ns: int) -> None:
    """A cycle is closed by its time message: when the next is to be expected."""
    period_ns = executive["period_ns"]
    late_ns = woken_ns - executive["due_ns"]
    if executive["due_ns"] > 0:
        executive["slips"] += cycles - 1
    if executive["due_ns"] > 0 and 0 < late_ns < period_ns:
        executive["due_ns"] += late_ns >> PHASE_SHIFT
    else:
        executive["due_ns"] = woken_ns
    executive["due_ns"] += period_ns
    if done_ns > executive["due_ns"]:
        executive["slips"] += 1
    if executive["synchronisation"] == CLOCKED and executive["cycles"] >= PHASE_CYCLES:
        executive["clocked"] = 1
        executive["due_ns"] += period_ns // 2


@kernel
def _account(executive: Record, cycles: int, woken_ns: int, done_ns: int) -> None:
    """Durations, lateness and slips of the cycles that one call has closed."""
    step_ns = done_ns - woken_ns
    add(executive["step_time"], step_ns)
    executive["cycles"] += cycles
    executive["step_recent_ns"] = max(executive["step_recent_ns"], step_ns)
    if executive["synchronisation"] == LOCKSTEP:
        return
    if executive["ticked"] == 1 and executive["clocked"] == 0:
        executive["due_ns"] += executive["period_ns"]  # keeps the time of the missing frames
        return
    if executive["due_ns"] > 0:
        late_ns = max(woken_ns - executive["due_ns"], 0)
        add(executive["wake_up"], late_ns)
        executive["wake_up_recent_ns"] = max(executive["wake_up_recent_ns"], late_ns)
    if executive["clocked"] == 1:
        _next_deadline(executive, done_ns)
    else:
        _next_arrival(executive, cycles, woken_ns, done_ns)


@kernel
def _telemeter(load: Record, executive: Record, tx: Frames, n_tx: int, now_ns: int) -> int:
    """FSW_TIMING behind the frames to be sent, once its cycle time has passed."""
    if executive["synchronisation"] == LOCKSTEP or now_ns - executive["told_ns"] < TELEMETRY_NS:
        return n_tx
    executive["told_ns"] = now_ns
    values = executive["values"]
    values[STEP_MAX] = min(executive["step_recent_ns"] / 1e3, MICROSECONDS_MAX)
    values[WAKE_UP_MAX] = min(executive["wake_up_recent_ns"] / 1e3, MICROSECONDS_MAX)
    values[SLIPS] = min(executive["slips"], COUNT_MAX)
    values[TICKS] = min(executive["ticks"], COUNT_MAX)
    executive["step_recent_ns"] = 0
    executive["wake_up_recent_ns"] = 0
    codec = load["codec"]
    word, code = pack(codec, TIMING, values)
    if code != 0 or n_tx >= len(tx):
        return n_tx
    frame = tx[n_tx]
    frame["can_id"] = codec["can_id"][TIMING]
    frame["dlc"] = codec["dlc"][TIMING]
    frame["pad"] = 0
    frame["res0"] = 0
    frame["len8_dlc"] = 0
    frame["data"] = protect(codec, TIMING, word, executive["timing_counter"])
    executive["timing_counter"] = (executive["timing_counter"] + 1) % COUNTER_MODULUS
    return n_tx + 1


@kernel
def _is_overdue(account: Record, state: Record, before: int) -> bool:
    """Whether a look at the bus, taken when the time message was overdue, has not brought it."""
    if account["synchronisation"] == LOCKSTEP:
        return account["silent_slices"] >= SILENT_SLICES and is_held_up(state)
    if account["due_ns"] == 0 or state["stop"] == 1:
        return False
    if int(state["cycles_run"]) != before or 0 < account["full_in_row"] < FULL_IN_ROW_MAX:
        return False
    deadline_ns = account["due_ns"] if account["clocked"] == 1 else _overdue_ns(account)
    return account["looked_ns"] >= deadline_ns


@kernel
def _send(fd: int, io: Record, executive: Record, tx: Frames, n_tx: int) -> bool:
    """Send a cycle's answer; False if the bus is lost. An interface that is down takes none."""
    sent = send_frames(fd, io, tx, n_tx)
    if sent == BUS_DOWN:
        _note_down(executive)
        return True
    if sent > 0:
        _note_up(executive)
        executive["frames_sent"] += sent
    return sent >= 0


@kernel
def _rehearse(load: Record, state: Record, executive: Record, rx: Frames, tx: Frames) -> None:
    """Run everything that a cycle runs once, on records that are thrown away."""
    law_step(load, state["law"], state["nav"], state["guidance"])
    now_ns = monotonic_ns()
    for synchronisation in range(LOCKSTEP, CLOCKED + 1):
        executive["synchronisation"] = synchronisation
        executive["ticked"] = 0
        executive["clocked"] = 0
        n_tx = minor_frame(load, state, rx, _tick(rx, executive), tx)
        for cycle in range(2):
            executive["ticked"] = cycle
            executive["clocked"] = 1 - cycle
            _account(executive, 1, now_ns, monotonic_ns())
        _telemeter(load, executive, tx, n_tx, now_ns)


@kernel
def serve(
    fd: int,
    io: Frames,
    load: Frames,
    state: Frames,
    executive: Frames,
    rx: Frames,
    tx: Frames,
    slice_ns: int,
) -> int:
    """Serve the bus for about `slice_ns`; returns RUNNING, STOPPED or BUS_LOST.

    The records have shape (1,). A slice of zero compiles and touches everything: it takes a state
    and an account that are thrown away.
    """
    account = executive[0]
    end_ns = monotonic_ns() + slice_ns
    if slice_ns == 0:
        _rehearse(load[0], state[0], account, rx, tx)
        return RUNNING
    while True:
        n_rx = _wait(fd, io[0], account, rx, end_ns)
        woken_ns = monotonic_ns()
        if n_rx < 0 or _is_lost(account, woken_ns):
            return BUS_LOST
        before = int(state[0]["cycles_run"])
        if n_rx > 0:
            account["silent_slices"] = 0
        elif woken_ns >= end_ns:
            account["silent_slices"] += 1
        n_tx = minor_frame(load[0], state[0], rx, n_rx, tx)
        in_burst = account["synchronisation"] == LOCKSTEP and n_rx > 0 and n_tx == 0
        account["in_burst"] = 1 if in_burst else 0
        if _is_overdue(account, state[0], before):
            n_tx = minor_frame(load[0], state[0], rx, _tick(rx, account), tx)
        if n_tx > 0:
            cycles = int(state[0]["cycles_run"]) - before
            done_ns = monotonic_ns()
            _account(account, cycles, woken_ns, done_ns)
            n_tx = _telemeter(load[0], account, tx, n_tx, done_ns)
            if not _send(fd, io[0], account, tx, n_tx):
                return BUS_LOST
        if state[0]["stop"] == 1:
            return STOPPED
        if woken_ns >= end_ns:
            return RUNNING
