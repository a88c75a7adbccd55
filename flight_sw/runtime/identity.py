"""Who a process on the bus is: the number that it draws, and the sources that it was built from.

Two computers with one load, or two harnesses, differ by their numbers alone. A number has as many
bits as a request has room for beside a second one; two of 2^20 are equal once in a million times.
"""

import hashlib
import secrets
from pathlib import Path

FLIGHT_ROOT = Path(__file__).parents[1]
SOURCE_SUFFIXES = (".py", ".dbc")
NOBODY = 0
ALONE = 1
"""The number of whoever shares its bus with nobody: a flight in memory draws none."""
NUMBERS = 1 << 20
SOURCES_SHIFT = 256 - 20  # of the hash, the first bits of which are sent


def draw_number() -> int:
    """A number that nobody else on the bus is likely to have."""
    return 1 + secrets.randbelow(NUMBERS - 1)


def name_of(number: int) -> str:
    """A number as sentences and tables have it."""
    return f"0x{number:05x}"


def sources_sha256(root: Path) -> str:
    """Hash over the sources and the DBC below `root`: their paths from there, and their bytes."""
    digest = hashlib.sha256()
    for path in sorted(p for p in root.rglob("*") if p.suffix in SOURCE_SUFFIXES):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(root).as_posix()} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()


SOURCES = int(sources_sha256(FLIGHT_ROOT), 16) >> SOURCES_SHIFT
"""What FSW_BOOT tells of the sources of this process."""
