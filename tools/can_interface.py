"""Raises a CAN interface where that is permitted; otherwise says what to run."""

import re
import shutil
import subprocess
from pathlib import Path

from flight_sw.can.address import INTERFACE_NAME_MAX
from flight_sw.errors import BusError

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
INTERFACES = Path("/sys/class/net")
ARP_TYPE_CAN = "280"
IP_TIMEOUT_S = 10.0
BITRATE_BPS = 1_000_000


def check_name(interface: str) -> None:
    """Refuse what cannot name an interface."""
    if not NAME.fullmatch(interface) or len(interface) > INTERFACE_NAME_MAX:
        raise BusError(
            f"interface '{interface}': allowed are 1 to {INTERFACE_NAME_MAX} letters, digits, "
            "'_', '-' and '.', such as vcan0"
        )


def _read(interface: str, name: str) -> str:
    try:
        return (INTERFACES / interface / name).read_text(encoding="ascii").strip()
    except OSError:
        return ""


def exists(interface: str) -> bool:
    """Whether the system has it."""
    return (INTERFACES / interface).exists()


def is_up(interface: str) -> bool:
    """Whether its flags say that it is up."""
    flags = _read(interface, "flags")
    return bool(flags) and bool(int(flags, 16) & 1)


def _is_virtual(interface: str) -> bool:
    path = INTERFACES / interface
    return "/virtual/" in str(path.resolve()) if path.exists() else interface.startswith("vcan")


def commands(interface: str) -> list[list[str]]:
    """What raises the interface from where it is; empty if it is up."""
    if exists(interface) and is_up(interface):
        return []
    up = ["ip", "link", "set", interface, "up"]
    if not _is_virtual(interface):
        rate = ["ip", "link", "set", interface, "type", "can", "bitrate", str(BITRATE_BPS)]
        return [rate, up]
    if exists(interface):
        return [up]
    return [["ip", "link", "add", "dev", interface, "type", "vcan"], up]


def raise_interface(interface: str) -> str:
    """Make and raise it; empty, or why that failed."""
    if exists(interface) and _read(interface, "type") != ARP_TYPE_CAN:
        raise BusError(f"{interface}: is an interface already, and not of CAN")
    if not exists(interface) and not _is_virtual(interface):
        raise BusError(
            f"{interface}: no such interface; virtual ones, which can be made, begin with 'vcan'"
        )
    if shutil.which("ip") is None and commands(interface):
        return "the program ip is not installed (package iproute2)"
    for command in commands(interface):
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=IP_TIMEOUT_S, check=False
        )
        if done.returncode != 0:
            words = (done.stderr.strip() or f"status {done.returncode}").splitlines()[0]
            return words.removeprefix("RTNETLINK answers: ").removeprefix("Error: ")
    return "" if is_up(interface) else "it stayed down"


def commands_to_run(interface: str) -> list[str]:
    """The lines for a shell, with the rights and the module that they need."""
    module = [] if exists(interface) or not _is_virtual(interface) else ["sudo modprobe vcan"]
    return module + [f"sudo {' '.join(command)}" for command in commands(interface)]
