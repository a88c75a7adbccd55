"""Files and functions stay small enough to be read in one go."""

import ast
from pathlib import Path

import pytest

from tests.rules.sources import functions_in, name_of, python_files, tree_of

FILE_LINES_MAX = 400
FUNCTION_LINES_MAX = 60
ARGUMENTS_MAX = 8


def lines_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines from `def` to the last statement."""
    return (function.end_lineno or function.lineno) - function.lineno + 1


def arguments_of(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Positional arguments that a caller has to put in order."""
    names = [arg.arg for arg in (*function.args.posonlyargs, *function.args.args)]
    return len([name for name in names if name not in ("self", "cls")])


@pytest.mark.parametrize("path", python_files(), ids=name_of)
def test_file_and_its_functions_are_short(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").count("\n")
    assert lines <= FILE_LINES_MAX, f"{name_of(path)} has {lines} lines"
    long = {f.name: lines_of(f) for f in functions_in(tree_of(path))}
    long = {name: n for name, n in long.items() if n > FUNCTION_LINES_MAX}
    assert not long, f"{name_of(path)}: lines by function {long}"


@pytest.mark.parametrize("path", python_files("flight_sw", "sim_harness", "tools"), ids=name_of)
def test_calls_have_few_arguments(path: Path) -> None:
    many = {f.name: arguments_of(f) for f in functions_in(tree_of(path))}
    many = {name: n for name, n in many.items() if n > ARGUMENTS_MAX}
    assert not many, f"{name_of(path)}: positional arguments by function {many}"
