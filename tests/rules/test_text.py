"""What tracked files must not hold: package hosts, and paths of one machine."""

import re
from pathlib import Path

import pytest

from tests.rules.sources import name_of, tracked_files

HOST_NAMES = ("pypi", "pythonhosted", "debian", "npmjs")
HOSTS = re.compile(rf"(?:{'|'.join(HOST_NAMES)})\.(?:org|com)")
TOP_FOLDERS = ("work", "root", "farm", "home")
PATHS = re.compile(rf"(?<![\w.$)}}~-])/(?:{'|'.join(TOP_FOLDERS)})/")


def lines_with(pattern: re.Pattern[str], text: str) -> list[str]:
    """Numbered lines that match."""
    return [f"{n}: {line}" for n, line in enumerate(text.splitlines(), 1) if pattern.search(line)]


def test_tracked_files_name_no_package_host_and_no_machine_path() -> None:
    found: dict[str, list[str]] = {}
    for path in tracked_files():
        raw = path.read_bytes()
        if b"\0" not in raw:
            text = raw.decode("utf-8", errors="replace")
            if wrong := lines_with(HOSTS, text) + lines_with(PATHS, text):
                found[name_of(path)] = wrong[:5]
    assert not found


def test_text_files_end_with_one_newline_and_use_unix_line_ends() -> None:
    wrong = []
    for path in tracked_files():
        raw = path.read_bytes()
        if b"\0" not in raw and raw and (b"\r\n" in raw or not raw.endswith(b"\n")):
            wrong.append(name_of(path))
    assert not wrong


@pytest.mark.parametrize("top", TOP_FOLDERS)
def test_a_machine_path_is_seen(top: str) -> None:
    assert lines_with(PATHS, f"open('/{top}/x')")
    assert not lines_with(PATHS, f"docs/{top}/x and {Path('a') / top / 'b'}")
