"""What tracked files must not hold: package hosts, paths of one machine, and formats that print a
negative zero."""

import ast
import re
from pathlib import Path

import pytest

from tests.rules.sources import ROOT, name_of, tracked_files

HOST_NAMES = ("pypi", "pythonhosted", "debian", "npmjs")
HOSTS = re.compile(rf"(?:{'|'.join(HOST_NAMES)})\.(?:org|com)")
TOP_FOLDERS = ("work", "root", "farm", "home")
DECIMALS = re.compile(r"\.[^.]*[efg%]('|$)")
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


def signed_formats(tree: ast.AST) -> list[str]:
    """Formats with decimals that would print a small negative number as -0.00."""
    specs = [
        ast.unparse(node.format_spec)
        for node in ast.walk(tree)
        if isinstance(node, ast.FormattedValue) and node.format_spec is not None
    ]
    return [spec for spec in specs if DECIMALS.search(spec) and "z" not in spec]


def test_no_number_that_people_read_is_a_negative_zero() -> None:
    found = {}
    for path in sorted((ROOT / "tools").rglob("*.py")):
        if wrong := signed_formats(ast.parse(path.read_text(encoding="utf-8"))):
            found[name_of(path)] = wrong
    assert not found


def test_a_format_that_keeps_the_sign_of_zero_is_seen() -> None:
    assert signed_formats(ast.parse('f"{x:,.2f} {y:+.1%} {z:8.{n}f} {s:<8} {n:,}"'))
    assert len(signed_formats(ast.parse('f"{x:,.2f} {y:+.1%} {z:8.{n}f}"'))) == 3
    assert not signed_formats(ast.parse('f"{x:z,.2f} {y:+z.1%} {s:<8} {n:,}"'))


@pytest.mark.parametrize("top", TOP_FOLDERS)
def test_a_machine_path_is_seen(top: str) -> None:
    assert lines_with(PATHS, f"open('/{top}/x')")
    assert not lines_with(PATHS, f"docs/{top}/x and {Path('a') / top / 'b'}")
