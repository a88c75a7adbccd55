"""What another load would have commanded, from the frames that a flight's computer heard.

Open loop: the vehicle goes on as it was recorded, whatever the other load would have done with it.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw.computer import COMMAND, CYCLE_MODULUS, STATUS, step
from flight_sw.errors import RecordingError
from flight_sw.load_image import LoadImage
from flight_sw.reception.navigation_set import receive
from flight_sw.reception.receiver import slot_of
from flight_sw.records.types_ import Record
from sim_harness.jit import kernel
from sim_harness.replay.feed import HEARD, Computers, Script, new_script
from sim_harness.replay.replayer import new_computer
from sim_harness.replay.script import COMMAND_NAME, STATUS_NAME, Heard, check_messages, computer_of
from sim_harness.telemetry.reader import Recording

F8 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint64]
Rows = npt.NDArray[np.void]

PERIOD_TOLERANCE = 1e-9  # of the minor frame

ANSWERED = np.dtype(
    [("t_s", "f8"), ("command", "u8"), ("status", "u8"), ("has_command", "i8")], align=True
)
"""What the computer said in one cycle, as frame words."""


class Compared(NamedTuple):
    """Commands of both loads, a row for each cycle that both have answered."""

    t_s: F8
    recorded: dict[str, F8]
    other: dict[str, F8]
    missing: int
    """Cycles that only one of them has answered."""


@kernel
def _note(codec: Record, answered: Record, frame: Record) -> None:
    slot = slot_of(codec, frame["can_id"])
    if slot == COMMAND:
        answered["command"] = frame["data"]
        answered["has_command"] = 1
    elif slot == STATUS:
        answered["status"] = frame["data"]


@kernel
def _close(computers: Computers, t_s: float, answered: Record) -> None:
    answered["t_s"] = t_s
    n_tx = step(computers.load[0], computers.states[0], computers.tx, 0)
    for i in range(n_tx):
        _note(computers.load[0]["codec"], answered, computers.tx[i])


@kernel
def answer_all(computers: Computers, script: Script, answered: Rows) -> int:
    """Run every cycle of a script; returns how many there were."""
    n = tick = heard = 0
    for row in range(len(script.rows)):
        t_s = script.rows[row]["t_s"]
        while tick < len(script.ticks) and script.ticks[tick] <= heard and n < len(answered):
            _close(computers, t_s, answered[n])
            tick += 1
            n += 1
        if script.kinds[row] != HEARD or n >= len(answered):
            continue
        heard += 1
        if receive(computers.load[0], computers.states[0], script.rows[row]["frame"]):
            _close(computers, t_s, answered[n])
            n += 1
    return n


def answers_to(recording: Recording, image: LoadImage, heard: Heard) -> Rows:
    """What a load answers to a recording's frames, cycle by cycle."""
    check_messages(recording)
    computers = new_computer(image, computer_of(recording))
    script = new_script(recording.bus, *heard)
    answered = np.zeros(len(recording.bus) + len(heard.ticks), ANSWERED)
    return answered[: answer_all(computers, script, answered)]


def _places(recording: Recording, message: str) -> I8:
    return np.flatnonzero(recording.slots == recording.decoder.slot(message))


def _signals(recording: Recording, message: str, words: U8) -> dict[str, F8 | I8]:
    return recording.decoder.columns(recording.decoder.slot(message), words)


def recorded_answers(recording: Recording) -> Rows:
    """What the computer that flew has answered: each status and the command before it."""
    data = recording.bus["frame"]["data"]
    commands, statuses = (_places(recording, name) for name in (COMMAND_NAME, STATUS_NAME))
    before = np.searchsorted(commands, statuses) - 1
    answered = np.zeros(len(statuses), ANSWERED)
    answered["t_s"], answered["status"] = recording.bus["t_s"][statuses], data[statuses]
    answered["has_command"] = before >= 0
    if len(commands):
        answered["command"] = data[commands[before]]
    return answered


def compare(recording: Recording, image: LoadImage, heard: Heard) -> Compared:
    """Both loads' commands, cycle by cycle, to what the computer heard."""
    period_s = recording.period_s
    if period_s is not None and abs(float(image.body["dt_s"][0]) - period_s) > PERIOD_TOLERANCE:
        raise RecordingError(
            f"{recording.path}: minor frame is {period_s:g} s, "
            f"the other load's is {float(image.body['dt_s'][0]):g} s"
        )
    theirs, ours = recorded_answers(recording), answers_to(recording, image, heard)
    cycle_a, a = _by_cycle(recording, theirs)
    cycle_b, b = _by_cycle(recording, ours)
    both, in_a, in_b = np.intersect1d(cycle_a, cycle_b, return_indices=True)
    columns = [_columns(recording, answered[where]) for answered, where in ((a, in_a), (b, in_b))]
    missing = len(cycle_a) + len(cycle_b) - 2 * len(both)
    return Compared(a["t_s"][in_a], columns[0], columns[1], missing)


def _by_cycle(recording: Recording, answered: Rows) -> tuple[I8, Rows]:
    """The number of each cycle, counted on past its modulus, and the last answer to it."""
    answered = answered[answered["has_command"] == 1]
    cycle = _signals(recording, STATUS_NAME, answered["status"])["cycle"].astype(np.int64)
    steps = (np.diff(cycle, prepend=cycle[:1]) + CYCLE_MODULUS // 2) % CYCLE_MODULUS
    count = np.cumsum(steps - CYCLE_MODULUS // 2) + (cycle[0] if len(cycle) else 0)
    last = np.flatnonzero(np.diff(count, append=np.iinfo(np.int64).max) != 0)
    return count[last], answered[last]


def _columns(recording: Recording, answered: Rows) -> dict[str, F8]:
    command = _signals(recording, COMMAND_NAME, answered["command"])
    status = _signals(recording, STATUS_NAME, answered["status"])
    kept = {**command, **{name: status[name] for name in ("mode", "phase", "tracking")}}
    return {name: column.astype(np.float64) for name, column in kept.items()}


class Spread(NamedTuple):
    """How far one signal of the commands goes apart."""

    name: str
    largest: float
    at_s: float
    rms: float


def spreads(compared: Compared) -> list[Spread]:
    """Largest and rms difference of bank and angle of attack, other minus recorded."""
    found = []
    for name, recorded in compared.recorded.items():
        if not name.endswith("_rad") or not len(recorded):
            continue
        difference = compared.other[name] - recorded
        place = int(np.abs(difference).argmax())
        rms = float(np.sqrt(np.mean(np.square(difference))))
        found.append(Spread(name, float(difference[place]), float(compared.t_s[place]), rms))
    return found
