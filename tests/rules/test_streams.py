"""Nothing of ours writes to the standard streams but the one module that cannot raise there."""

import ast
from pathlib import Path

import pytest

from tests.rules.sources import FLIGHT, ROOT, dotted, name_of, python_files, tree_of

WRITER = FLIGHT / "runtime" / "streams.py"
CONSOLES = ROOT / "tools" / "console.py"
CALLS = {
    "print", "pprint", "pprint.pprint", "typer.echo", "typer.secho", "click.echo", "click.secho",
    "rich.print", "traceback.print_exc", "traceback.print_exception", "logging.basicConfig",
    "logging.StreamHandler", "breakpoint", "input",
}  # fmt: skip
STREAMS = {"sys.stdout", "sys.stderr", "sys.__stdout__", "sys.__stderr__"}
CONSOLE = {"Console", "rich.console.Console", "console.Console", "get_console"}


def wrong_lines(tree: ast.AST, *, may_make_consoles: bool) -> list[int]:
    """Lines that write past the writer, or make a console of their own."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            called = dotted(node.func)
            first = node.args[0] if node.args else None
            to_standard = isinstance(first, ast.Constant) and first.value in (1, 2)
            if (
                called in CALLS
                or (called in CONSOLE and not may_make_consoles)
                or (called in ("os.write", "os.fdopen", "open") and to_standard)
            ):
                found.append(node.lineno)
        elif isinstance(node, ast.Attribute) and dotted(node) in STREAMS:
            found.append(node.lineno)
        elif isinstance(node, ast.ImportFrom) and node.module == "sys":
            found += [node.lineno for alias in node.names if f"sys.{alias.name}" in STREAMS]
    return found


@pytest.mark.parametrize(
    "path",
    [path for path in python_files("flight_sw", "sim_harness", "tools") if path != WRITER],
    ids=name_of,
)
def test_only_the_writer_writes_to_the_standard_streams(path: Path) -> None:
    assert not wrong_lines(tree_of(path), may_make_consoles=path == CONSOLES)


@pytest.mark.parametrize(
    "source",
    [
        "print('x')",
        "import sys\nsys.stderr.write('x')",
        "import sys\nout = sys.stdout",
        "from sys import stderr",
        "import typer\ntyper.echo('x')",
        "import os\nos.write(2, b'x')",
        "from rich.console import Console\nConsole().print('x')",
    ],
)
def test_every_way_to_write_is_seen(source: str) -> None:
    assert wrong_lines(ast.parse(source), may_make_consoles=False)
