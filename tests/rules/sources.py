"""The source files that the rules are about, parsed once."""

import ast
import functools
import subprocess
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FLIGHT = ROOT / "flight_sw"
HARNESS = ROOT / "sim_harness"
FOLDERS = ("flight_sw", "sim_harness", "tools", "tests", "benchmarks")


def python_files(*folders: str) -> list[Path]:
    """Every Python file below the folders (all of ours, if none is named), in order."""
    return sorted(p for f in folders or FOLDERS for p in (ROOT / f).rglob("*.py"))


def tracked_files() -> list[Path]:
    """Every file under version control; without git, every file of our folders."""
    command = ["git", "-C", str(ROOT), "ls-files", "-z"]
    try:
        listing = subprocess.run(command, capture_output=True, check=True, timeout=60).stdout
    except (OSError, subprocess.CalledProcessError):
        return [
            p for f in (*FOLDERS, "docs", "gains") for p in (ROOT / f).rglob("*") if p.is_file()
        ]
    paths = [ROOT / name for name in listing.decode().split("\0") if name]
    return [path for path in paths if path.is_file()]


def name_of(path: Path) -> str:
    """The path as test identifiers and messages show it."""
    return str(path.relative_to(ROOT))


@functools.cache
def tree_of(path: Path) -> ast.Module:
    """The file's syntax tree."""
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def functions_in(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Every function and method, at any depth."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def dotted(node: ast.AST) -> str:
    """`a.b.c` for a name or a chain of attributes, the function's name for a call, else ''."""
    if isinstance(node, ast.Call):
        return dotted(node.func)
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        head = dotted(node.value)
        return f"{head}.{node.attr}" if head else ""
    return ""
