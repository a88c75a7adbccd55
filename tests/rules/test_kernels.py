"""A kernel is a bounded function of records: what the compiler would allow but flight does not."""

import ast
from pathlib import Path

import pytest

from tests.rules.sources import (
    FLIGHT,
    HARNESS,
    dotted,
    functions_in,
    name_of,
    python_files,
    tree_of,
)

ARGUMENTS_MAX = 8
DECORATORS = {"kernel", "seldom_kernel"}
DECORATOR_FILES = (FLIGHT / "runtime" / "jit.py", HARNESS / "jit.py")
COMPILERS = {"njit", "jit", "cfunc", "vectorize", "guvectorize", "stencil", "jitclass"}
SCALARS = {
    f"np.{kind}{bits}" for kind in ("int", "uint", "float") for bits in (8, 16, 32, 64)
} | {"np.bool_"}  # fmt: skip

STATEMENTS = {
    ast.Raise: "raise",
    ast.Try: "try",
    ast.TryStar: "try",
    ast.Assert: "assert",
    ast.With: "with",
    ast.Global: "global",
    ast.Nonlocal: "nonlocal",
    ast.FunctionDef: "closure",
    ast.Lambda: "closure",
    ast.JoinedStr: "f-string",
    ast.List: "list",
    ast.ListComp: "list",
    ast.Dict: "dict",
    ast.DictComp: "dict",
    ast.Set: "set",
    ast.SetComp: "set",
    ast.GeneratorExp: "generator",
    ast.Yield: "generator",
    ast.Pow: "**",
    ast.MatMult: "@",
}
CALLS = {"print", "open", "list", "dict", "set", "str", "bytes", "getattr", "setattr", "sorted"}


def is_kernel(function: ast.AST) -> bool:
    """True for a function under one of the decorators, however it was imported."""
    decorators = getattr(function, "decorator_list", [])
    return any(dotted(d).split(".")[-1] in DECORATORS for d in decorators)


def kernels_in(tree: ast.AST) -> list[ast.FunctionDef]:
    """The kernels of one file."""
    return [f for f in functions_in(tree) if isinstance(f, ast.FunctionDef) and is_kernel(f)]


def faults(kernel: ast.FunctionDef) -> list[str]:
    """What in the body or the signature a kernel must not have."""
    args = kernel.args
    found = []
    if args.defaults or any(args.kw_defaults) or args.kwonlyargs:
        found.append("default or keyword argument")
    if args.vararg or args.kwarg:
        found.append("open argument list")
    if len(args.posonlyargs) + len(args.args) > ARGUMENTS_MAX:
        found.append(f"more than {ARGUMENTS_MAX} arguments")
    for node in (n for statement in kernel.body for n in ast.walk(statement)):
        if word := STATEMENTS.get(type(node)):
            found.append(word)
        if isinstance(node, ast.Call):
            name = dotted(node)
            if name in CALLS or (name.startswith("np.") and name not in SCALARS):
                found.append(f"{name}()")
    return found


def compilers_in(tree: ast.AST) -> list[str]:
    """Uses of numba's own decorators and of fastmath."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("numba"):
            found += [a.name for a in node.names if a.name in COMPILERS]
        elif isinstance(node, ast.Attribute) and dotted(node).startswith(("numba.", "nb.")):
            found += [dotted(node)] if node.attr in COMPILERS else []
        elif isinstance(node, ast.keyword) and node.arg == "fastmath":
            found.append("fastmath")
    return found


@pytest.mark.parametrize("path", python_files("flight_sw", "sim_harness"), ids=name_of)
def test_kernels_have_the_flight_shape(path: Path) -> None:
    wrong = {k.name: faults(k) for k in kernels_in(tree_of(path))}
    wrong = {name: found for name, found in wrong.items() if found}
    assert not wrong, f"{name_of(path)}: {wrong}"


@pytest.mark.parametrize("path", python_files("flight_sw", "sim_harness", "tools"), ids=name_of)
def test_the_compiler_is_called_in_one_place(path: Path) -> None:
    if path not in DECORATOR_FILES:
        assert not compilers_in(tree_of(path)), f"{name_of(path)} compiles by itself"


def test_the_rules_see_kernels_at_all() -> None:
    assert sum(len(kernels_in(tree_of(p))) for p in python_files("flight_sw")) > 0


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("raise ValueError", "raise"),
        ("assert x > 0", "assert"),
        ("y = x**2", "**"),
        ("x **= 2", "**"),
        ("y = np.zeros(3)", "np.zeros()"),
        ("y = np.sqrt(x)", "np.sqrt()"),
        ("y = [x, x]", "list"),
        ("y = {}", "dict"),
        ("y = f'{x}'", "f-string"),
        ("if x:\n        print(x)", "print()"),
        ("y = a @ x", "@"),
        ("y = lambda z: z", "closure"),
    ],
)
def test_a_fault_in_the_body_is_seen(body: str, fault: str) -> None:
    source = f"@kernel\ndef f(x):\n    {body}\n"
    assert faults(kernels_in(ast.parse(source))[0]) == [fault]


@pytest.mark.parametrize(
    "signature", ["x=1.0", "*x", "**x", "x, *, y", "a, b, c, d, e, f, g, h, i"]
)
def test_a_fault_in_the_signature_is_seen(signature: str) -> None:
    source = f"@jit.kernel\ndef f({signature}):\n    return 0\n"
    assert len(faults(kernels_in(ast.parse(source))[0])) == 1


def test_scalars_of_fixed_width_are_allowed() -> None:
    source = "@kernel\ndef f(x):\n    return np.uint64(x) ^ np.uint64(1)\n"
    assert faults(kernels_in(ast.parse(source))[0]) == []


@pytest.mark.parametrize(
    "source",
    [
        "from numba import njit",
        "import numba\n@numba.njit\ndef f(): ...",
        "import numba as nb\n@nb.jit(nopython=True)\ndef f(): ...",
        "@kernel(fastmath=True)\ndef f(): ...",
    ],
)
def test_a_compiler_used_directly_is_seen(source: str) -> None:
    assert len(compilers_in(ast.parse(source))) == 1
