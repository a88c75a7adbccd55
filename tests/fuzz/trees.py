"""Damages documents by their structure: another value, key or depth at a place that exists."""

import copy
import json
import random
from collections.abc import Callable, Sequence
from typing import Any

from tests.fuzz.mutate import mutated

VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**63, -(2**63) - 1, 10**199, 1e308, -1e308, 5e-324, float("inf"),
    float("nan"), "", "x" * 5000, "../../etc/hosts", "a\nb\x1b[2J", "\u202e", "inf", "nan", [], {},
    [[]], [1.0, 1.0], [0.0] * 600, {"model": "table"}, {"model": 5}, {"csv": "x.csv"},
    {"a": {"b": 1}}, ["lqy"], "lqy", [{}], [None],
)  # fmt: skip


def places(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of all that a tree holds."""
    found = [path] if path else []
    keys = tree if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ()
    for key in keys:
        found += places(tree[key], (*path, key))
    return found


def changed(tree: Any, rng: random.Random) -> Any:
    """A copy with a value replaced, nested, taken out, given another key, or of another size."""
    tree = copy.deepcopy(tree)
    for _ in range(rng.randint(1, 3)):
        paths = places(tree)
        if not paths:
            return tree
        *parents, key = rng.choice(paths)
        above = tree
        for parent in parents:
            above = above[parent]
        _CHANGES[rng.randrange(len(_CHANGES))](above, key, rng)
    return tree


def _replace(above: Any, key: Any, rng: random.Random) -> None:
    above[key] = copy.deepcopy(rng.choice(VALUES))


def _scale(above: Any, key: Any, rng: random.Random) -> None:
    if isinstance(above[key], int | float):
        above[key] = above[key] * rng.choice((-1, 0, 0.5, 2, 10, 1e3, 1e-3, 1e300))


def _nest(above: Any, key: Any, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 2, 40))):
        above[key] = [above[key]] if rng.random() < 0.5 else {"x": above[key]}


def _take_out(above: Any, key: Any, rng: random.Random) -> None:
    del above[key]


def _rename(above: Any, key: Any, rng: random.Random) -> None:
    if isinstance(above, dict):
        above[rng.choice(("x", "k" * 3000, "../x", "model", "keys", "csv", ""))] = above.pop(key)
    else:
        above.extend(copy.deepcopy(above[:50]))


_CHANGES: tuple[Callable[[Any, Any, random.Random], None], ...] = (
    _replace, _replace, _scale, _nest, _take_out, _rename,
)  # fmt: skip


def toml_value(value: Any) -> str:
    """A value as TOML writes it; null, which it has not, as a word that it does not take."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {toml_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value)


def toml_bytes(tree: dict[str, Any]) -> bytes:
    """Tables as a TOML file."""
    return "".join(f"{json.dumps(k)} = {toml_value(v)}\n" for k, v in tree.items()).encode()


Mutate = Callable[[bytes, random.Random, Sequence[bytes]], bytes]


def by_structure_or_bytes(read: Callable[[bytes], Any], write: Callable[[Any], bytes]) -> Mutate:
    """Damages half of the files by their structure, the others by their bytes."""

    def mutate(data: bytes, rng: random.Random, others: Sequence[bytes]) -> bytes:
        if rng.random() < 0.5:
            return mutated(data, rng, others)
        return write(changed(read(data), rng))

    return mutate
