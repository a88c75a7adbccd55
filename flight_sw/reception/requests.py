"""Who may ask this computer for what: requests name it, and the harness that it flies with.

A harness names its computer in HARNESS_PRESENT and in each GROUND_REQUEST. Once armed, a computer
obeys the harness that armed it, and heeds the presence of no other.
"""

from flight_sw import icd
from flight_sw.records.types_ import Record
from flight_sw.runtime.jit import kernel

REQUEST = icd.slot("GROUND_REQUEST")
PRESENT = icd.slot("HARNESS_PRESENT")
REQUEST_CODE = icd.value_index("GROUND_REQUEST", "request")
REQUEST_COMPUTER = icd.value_index("GROUND_REQUEST", "computer")
REQUEST_HARNESS = icd.value_index("GROUND_REQUEST", "harness")
PRESENT_HARNESS = icd.value_index("HARNESS_PRESENT", "harness")
PRESENT_COMPUTER = icd.value_index("HARNESS_PRESENT", "computer")
PRESENT_STATE = icd.value_index("HARNESS_PRESENT", "state")
ARM, STOP = 1, 2


@kernel
def is_meant(state: Record, computer: float, harness: float) -> bool:
    """Whether a harness may name this computer: once it is armed, only the one that armed it."""
    if int(computer) != int(state["number"]):
        return False
    return state["armed"] == 0 or int(harness) == int(state["harness"])


@kernel
def is_misdirected(state: Record, slot: int) -> bool:
    """Whether the request or presence just received is not for this computer, or not theirs.

    Before it is armed any harness may say that it is here.
    """
    received = state["received"]
    if slot == REQUEST:
        return not is_meant(state, received[REQUEST_COMPUTER], received[REQUEST_HARNESS])
    if slot == PRESENT and state["armed"] == 1:
        return not is_meant(state, received[PRESENT_COMPUTER], received[PRESENT_HARNESS])
    return False


@kernel
def take_request(state: Record) -> None:
    """Arm or stop."""
    received = state["accepted"]
    state["harness"] = int(received[REQUEST_HARNESS])
    request = int(received[REQUEST_CODE])
    if request == ARM:
        state["armed"] = 1
    elif request == STOP:
        state["stop"] = 1


@kernel
def take_presence(state: Record) -> None:
    """A harness says which computer it flies with: if that is this one, it may answer."""
    accepted = state["accepted"]
    harness = accepted[PRESENT_HARNESS]
    if is_meant(state, accepted[PRESENT_COMPUTER], harness):
        state["harness"] = int(harness)
    if state["armed"] == 0:  # the next word may be another harness's
        state["rx"]["received"][PRESENT] = 0
