"""What of a recording the flight computer heard, and what it answered."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from flight_sw import icd
from flight_sw.can.address import ERROR_FLAG
from flight_sw.dictionary import TICK_ID
from flight_sw.errors import RecordingError
from flight_sw.icd import Message
from flight_sw.load_image import LoadImage, parse_image
from sim_harness.replay.feed import ANSWER, HEARD, NEITHER, REPORT
from sim_harness.telemetry.decode import NO_SLOT
from sim_harness.telemetry.reader import Recording

I8 = npt.NDArray[np.int64]

COMPUTER, GROUND = "FSW", "HARNESS"
BY_EXECUTIVE = ("FSW_BOOT", "FSW_TIMING")  # sent by the process around the minor frame
BOOT, BOOT_STATE, BOOT_LOAD, READY = "FSW_BOOT", "state", "load_crc32", "READY"
REPORTS = "RX_HEALTH_"
LOAD_SUFFIX = ".load"
COMMAND_NAME, STATUS_NAME = "FSW_COMMAND", "FSW_STATUS"


def kinds_of(recording: Recording) -> I8:
    """HEARD, ANSWER, NEITHER or REPORT for every row of the bus.

    Where a third sender is on the bus, what the computer heard of it before it was ready and in
    which order is not known: its reports of refused frames may then count otherwise.

    A frame with an identifier of the computer's but a wrong checksum was not sent by it: it heard
    it, like everything else on a hub. Its CAN socket hears the ground's identifiers alone.
    """
    rows, slots = recording.bus, recording.slots
    messages = recording.decoder.messages
    can_id = rows["frame"]["can_id"]
    of_computer = np.array([*(m.sender == COMPUTER for m in messages), False])
    by_executive = np.array([*(m.name in BY_EXECUTIVE for m in messages), False])
    kinds = np.full(len(rows), HEARD)
    kinds[of_computer[slots]] = ANSWER  # NO_SLOT is -1: the last entry
    kinds[by_executive[slots]] = NEITHER
    kinds[(can_id == TICK_ID) | (can_id & ERROR_FLAG != 0)] = NEITHER
    if recording.manifest.get("bus", "").startswith("socketcan:"):
        filtered = [m.can_id for m in messages if m.sender == GROUND]
        kinds[(kinds == HEARD) & ~np.isin(can_id, filtered)] = NEITHER
    kinds[: _ready_at(recording)] = NEITHER
    if np.any((kinds == HEARD) & (slots == NO_SLOT)) and recording.manifest.get("bus") != "memory":
        reports = np.array([*(m.name.startswith(REPORTS) for m in messages), False])
        kinds[(kinds == ANSWER) & reports[slots]] = REPORT
    return kinds


def _ready_at(recording: Recording) -> int:
    """The row in which the computer first says that it listens; 0 for one that never boots."""
    names = [message.name for message in recording.decoder.messages]
    if BOOT not in names:
        return 0
    places = np.flatnonzero(recording.slots == recording.decoder.slot(BOOT))
    _, columns = recording.message(BOOT)
    ready = [value for value, name in recording.value_names(BOOT)[BOOT_STATE].items()
             if name == READY]  # fmt: skip
    says_so = np.isin(columns[BOOT_STATE], ready)
    if crc32 := recording.manifest.get("load_crc32"):
        says_so &= columns[BOOT_LOAD] == int(crc32, 16)  # a false frame names another load
    found = places[says_so]
    return int(found[0]) if len(found) else 0


def is_paced(recording: Recording) -> bool:
    """Whether the computer flew against the clock: then it may have closed cycles by ticks."""
    return recording.manifest.get("pace", "") != "lockstep" and (
        recording.manifest.get("bus") != "memory"
    )


def attached_load(recording: Recording) -> LoadImage:
    """The load that flew; one of another layout is refused with both hashes."""
    return parse_image(recording.attachment(LOAD_SUFFIX), f"{recording.path.name}: its load image")


def check_dbc(recording: Recording) -> None:
    """Refuse frames that this version's flight computer would read otherwise."""
    if not recording.has_our_dbc:
        theirs, ours = recording.dbc_sha256
        raise RecordingError(
            f"{recording.path.name}: recorded with DBC {theirs[:16]}, this version has "
            f"{ours[:16]}; it can be read and exported through its own, but not replayed"
        )


def check_messages(recording: Recording) -> None:
    """Refuse frames unless what the computer hears and commands is laid out as in this version."""

    def used(messages: Sequence[Message]) -> list[Message]:
        return [m for m in messages if m.sender == GROUND or m.name in (COMMAND_NAME, STATUS_NAME)]

    if used(recording.decoder.messages) != used(icd.LAYOUT):
        check_dbc(recording)
