"""What of a recording the flight computer heard, and what it answered."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flight_sw import icd
from flight_sw.can.address import ERROR_FLAG
from flight_sw.errors import RecordingError
from flight_sw.icd import Message
from flight_sw.load_image import LoadImage, parse_image
from flight_sw.records.dictionary import TICK_ID
from flight_sw.runtime.identity import ALONE
from sim_harness.replay.feed import ANSWER, HEARD, NEITHER, REPORT, TIMED
from sim_harness.telemetry.reader import Recording

I8 = npt.NDArray[np.int64]

COMPUTER, GROUND = "FSW", "HARNESS"
TIMING = "FSW_TIMING"
BOOT, BOOT_STATE, READY = "FSW_BOOT", "state", "READY"
ANNOUNCEMENTS, BY_COMPUTER = (BOOT, "FSW_LOAD"), "computer"
REQUEST, BY_HARNESS, HARNESS_KEY = "GROUND_REQUEST", "harness", "harness"
REPORTS = "RX_HEALTH_"
LOAD_SUFFIX = ".load"
COMMAND_NAME, STATUS_NAME = "FSW_COMMAND", "FSW_STATUS"
RECEPTION_NAME = "RX_HEALTH_C"


class Heard(NamedTuple):
    """What of a recording's rows its computer heard, and when its clock closed a cycle."""

    kinds: I8
    """HEARD, ANSWER, NEITHER, REPORT or TIMED, for each row."""
    ticks: I8
    """Frames heard before each tick that closed a cycle, ascending."""


def heard_by_computer(recording: Recording) -> Heard:
    """The rows that a computer heard, from where it says that it is ready.

    A frame with an identifier of the computer's but a wrong checksum was not sent by it: it heard
    it, like everything else on a hub. Its CAN socket hears the ground's identifiers alone.
    """
    kinds = kinds_of(recording)
    kinds[: _ready_at(recording)] = NEITHER
    return Heard(kinds, np.zeros(0, np.int64))


def kinds_of(recording: Recording) -> I8:
    """The kind of every row, for a computer that heard from the first."""
    rows, slots = recording.bus, recording.slots
    messages = recording.decoder.messages
    can_id = rows["frame"]["can_id"]
    of_computer = np.array([*(m.sender == COMPUTER for m in messages), False])
    reports = np.array([*(m.name.startswith(REPORTS) for m in messages), False])
    kinds = np.full(len(rows), HEARD)
    kinds[of_computer[slots]] = ANSWER  # NO_SLOT is -1: the last entry
    kinds[reports[slots]] = REPORT
    for message in ANNOUNCEMENTS:
        rows_of = _rows_of(recording, message)
        kinds[rows_of] = np.where(_is_ours(recording, rows_of, message), NEITHER, HEARD)
    kinds[_rows_of(recording, TIMING)] = TIMED if is_paced(recording) else HEARD
    kinds[(can_id == TICK_ID) | (can_id & ERROR_FLAG != 0)] = NEITHER
    if not hears_all(recording):
        filtered = [m.can_id for m in messages if m.sender == GROUND or m.name == BOOT]
        kinds[(kinds == HEARD) & ~np.isin(can_id, filtered)] = NEITHER
    return kinds


def _is_ours(recording: Recording, rows: I8, message: str) -> npt.NDArray[np.bool_]:
    """Which announcements are of the computer that flew: the others are another computer's."""
    named = _columns(recording, rows, message)[BY_COMPUTER]
    return np.asarray(named == computer_of(recording))


def computer_of(recording: Recording) -> int:
    """The number of the computer that flew: what the first request of our harness names."""
    columns = _columns(recording, _rows_of(recording, REQUEST), REQUEST)
    named = columns[BY_COMPUTER][columns[BY_HARNESS] == _harness_of(recording)]
    return int(named[0]) if len(named) else ALONE


def asked_at(recording: Recording) -> int:
    """The row of our harness's first request to the computer that flew; -1: there is none."""
    rows = _rows_of(recording, REQUEST)
    columns = _columns(recording, rows, REQUEST)
    ours = columns[BY_HARNESS] == _harness_of(recording)
    ours &= columns[BY_COMPUTER] == computer_of(recording)
    return int(rows[ours][0]) if ours.any() else -1


def _harness_of(recording: Recording) -> int:
    told = recording.manifest_number(HARNESS_KEY, 0)
    return ALONE if told is None else int(told)


def _rows_of(recording: Recording, message: str) -> I8:
    if message not in {m.name for m in recording.decoder.messages}:
        return np.zeros(0, np.int64)
    return np.flatnonzero(recording.slots == recording.decoder.slot(message))


def _columns(recording: Recording, rows: I8, message: str) -> Mapping[str, npt.NDArray[Any]]:
    slot = recording.decoder.slot(message)
    return recording.decoder.columns(slot, recording.bus["frame"]["data"][rows])


class Reports(NamedTuple):
    """What the computer told of its hearing, and what only looks so; arrays, a row a report."""

    rows: I8
    counters: I8
    heard: I8
    """Frames heard when the cycle was closed, modulo HEARD_MODULUS."""
    ticked: npt.NDArray[np.bool_]


def reports_of(recording: Recording) -> Reports:
    """All reports of hearing in a recording, in bus order."""
    rows = _rows_of(recording, RECEPTION_NAME)
    columns = _columns(recording, rows, RECEPTION_NAME)
    counters = (recording.bus["frame"]["data"][rows].astype(np.int64) >> 8) & 0xF
    return Reports(rows, counters, columns["heard"].astype(np.int64), columns["ticked"] != 0)


def hears_all(recording: Recording) -> bool:
    """Whether the computer hears every frame; a CAN socket hears the ground's identifiers alone."""
    return not recording.manifest.get("bus", "").startswith("socketcan:")


def _ready_at(recording: Recording) -> int:
    """The row in which the computer first says that it listens; 0 for one that never boots."""
    places = _rows_of(recording, BOOT)
    if not len(places):
        return 0
    columns = _columns(recording, places, BOOT)
    names = recording.value_names(BOOT).get(BOOT_STATE, {})
    says_so = np.isin(
        columns[BOOT_STATE], [value for value, name in names.items() if name == READY]
    )
    says_so &= _is_ours(recording, places, BOOT)
    found = places[says_so]
    return int(found[0]) if len(found) else 0


def is_paced(recording: Recording) -> bool:
    """Whether the computer flew against the clock: then it may have closed cycles by ticks."""
    return recording.manifest.get("pace", "") != "lockstep" and (
        recording.manifest.get("bus") != "memory"
    )


def attached_load(recording: Recording) -> LoadImage:
    """The load that flew; one of another layout is refused with both hashes."""
    return parse_image(recording.attachment(LOAD_SUFFIX), f"{recording.path}: its load image")


def check_dbc(recording: Recording) -> None:
    """Refuse frames that this version's flight computer would read otherwise."""
    if not recording.has_our_dbc:
        theirs, ours = recording.dbc_sha256
        raise RecordingError(
            f"{recording.path}: recorded with DBC {theirs[:16]}, this version has "
            f"{ours[:16]}; it can be read and exported through its own, but not replayed"
        )


def check_messages(recording: Recording) -> None:
    """Refuse frames unless what the computer hears and commands is laid out as in this version."""

    def used(messages: Sequence[Message]) -> list[Message]:
        names = (COMMAND_NAME, STATUS_NAME, BOOT)
        return [m for m in messages if m.sender == GROUND or m.name in names]

    if used(recording.decoder.messages) != used(icd.LAYOUT):
        check_dbc(recording)
