"""Turns what pydantic reports about a mission into one sentence per error."""

import difflib
from collections.abc import Iterable
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from sim_harness.mission.documents import short
from sim_harness.mission.quantities import Quantity, Section, Text, plain

KEYS_TOLD = 16  # of a table, in a refusal
TAG = "model"
WORD_MAX = 100  # characters of a word that another is looked for
TOLD_CHARACTERS_MAX = 800  # about one file, beyond its first sentence


def nearest(word: str, known: Iterable[str]) -> str:
    """`, nearest is ...` when something known resembles the word, else nothing."""
    names, word = list(known), word[:WORD_MAX]
    leaves = {name.rsplit(".", 1)[-1]: name for name in names}
    if close := difflib.get_close_matches(word, names, 1, 0.5):
        return f", nearest is {close[0]}"
    if close := difflib.get_close_matches(word.rsplit(".", 1)[-1], leaves, 1, 0.5):
        return f", nearest is {leaves[close[0]]}"
    return ""


def sections_of(annotation: Any) -> list[type[Section]]:
    """The section classes an annotation allows: none for a leaf, several for a choice of models."""
    if get_origin(annotation) is Annotated:
        return sections_of(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return [found for part in get_args(annotation) for found in sections_of(part)]
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return [annotation]
    return []


def item_of(annotation: Any) -> Any:
    """What a list, or a table of tables by free names, holds; None for anything else."""
    if get_origin(annotation) is dict:
        return get_args(annotation)[1]
    return get_args(annotation)[0] if get_origin(annotation) is list else None


def tag_of(section: type[BaseModel]) -> str:
    """The model name that selects a section out of several."""
    return str(get_args(section.model_fields[TAG].annotation)[0])


def chosen(annotation: Any, raw: Any) -> type[Section] | None:
    """The section a piece of the file selects, None for a leaf or an unknown model."""
    options = sections_of(annotation)
    if len(options) == 1:
        return options[0]
    tag = raw.get(TAG) if isinstance(raw, dict) else None
    return next((option for option in options if tag_of(option) == tag), None)


def annotation_at(root: type[BaseModel], raw: Any, path: tuple[int | str, ...]) -> Any:
    """What a path of keys leads to: a section with the choice the file makes, or anything else."""
    found: Any = root
    for key in path:
        if isinstance(found, type) and issubclass(found, BaseModel):
            field = found.model_fields.get(str(key))
            found = field.annotation if field else None
        else:
            found = item_of(found)
        listed = isinstance(raw, list) and isinstance(key, int) and key < len(raw)
        raw = raw.get(key) if isinstance(raw, dict) else raw[key] if listed else None
        if sections_of(found):
            found = chosen(found, raw)
    return found


def section_at(
    root: type[BaseModel], raw: Any, path: tuple[int | str, ...]
) -> type[BaseModel] | None:
    """The section class a path of keys leads to."""
    found = annotation_at(root, raw, path)
    return found if isinstance(found, type) and issubclass(found, BaseModel) else None


def options_at(root: type[BaseModel], raw: Any, path: tuple[int | str, ...]) -> list[type[Section]]:
    """The sections that the file may choose from at a path of keys."""
    found = annotation_at(root, raw, path[:-1])
    if isinstance(found, type) and issubclass(found, BaseModel):
        field = found.model_fields.get(str(path[-1]))
        return sections_of(field.annotation) if field else []
    return sections_of(item_of(found))


def without_tags(
    root: type[BaseModel], loc: tuple[int | str, ...], raw: Any
) -> tuple[int | str, ...]:
    """Path of keys of an error, without the model names pydantic inserts after a choice."""
    path: list[int | str] = []
    was_choice = False
    for item in loc:
        if was_choice:
            was_choice = False
            continue
        path.append(item)
        was_choice = len(options_at(root, raw, tuple(path))) > 1
    return tuple(path)


def written(path: tuple[int | str, ...]) -> str:
    """A path of keys as the file writes it: list items counted from 1, no `keys` of a set."""
    text = ""
    for i, key in enumerate(path):
        if isinstance(key, int):
            text += f" {key + 1}"
        elif not (key == "keys" and i == 2 and path[0] == "dispersions" and len(path) > 3):
            text += f".{short(key)}" if text else short(key)
    return text


def allowed_of(section: type[BaseModel] | None, key: str) -> str:
    """What a key allows, in words."""
    field = section.model_fields.get(key) if section else None
    if field is None:
        return "see docs/missions.md"
    for mark in field.metadata:
        if isinstance(mark, Quantity | Text):
            return mark.allowed
    if get_origin(field.annotation) is Literal:
        return ", ".join(str(value) for value in get_args(field.annotation))
    if options := sections_of(field.annotation):
        return "a table with " + ", ".join(options[0].model_fields)
    return "a text"


def shape_of(error: ErrorDetails) -> str:
    """What is allowed where the kind of thing is wrong, empty for a wrong value."""
    if error["type"] in ("model_type", "dict_type", "model_attributes_type"):
        return "a table"
    if error["type"] == "too_short":
        return f"{error['ctx']['min_length']} or more entries"
    return "a list" if error["type"] == "list_type" else ""


def sentence(root: type[BaseModel], raw: Any, error: ErrorDetails) -> str:
    """One error in words: key, what is, what is allowed."""
    path = without_tags(root, error["loc"], raw)
    where = written(path)
    parent = section_at(root, raw, path[:-1])
    key = str(path[-1]) if path else ""
    match error["type"]:
        case "refused":
            return f"{where}{'' if error['msg'].startswith('.') else ' '}{error['msg']}".strip()
        case "missing":
            return f"{where} is missing, allowed {allowed_of(parent, key)}"
        case "extra_forbidden":
            known = list(parent.model_fields) if parent else []
            allowed = ", ".join(known[:KEYS_TOLD])
            if len(known) > KEYS_TOLD:
                allowed += f" and {len(known) - KEYS_TOLD} more"
            return f"{where} is not a known key{nearest(key, known)}; allowed {allowed}"
        case "union_tag_invalid" | "union_tag_not_found":
            options = options_at(root, raw, path)
            tags = ", ".join(tag_of(option) for option in options)
            found = error["input"].get(TAG) if isinstance(error["input"], dict) else error["input"]
            state = "missing" if found is None else plain(found)
            hint = nearest(str(found), tags.split(", "))
            return f"{where}.{TAG} is {state}{hint}; allowed {tags}"
        case _:
            allowed = shape_of(error) or allowed_of(parent, key)
            return f"{where} is {plain(error['input'])}, allowed {allowed}"


def sentences(root: type[BaseModel], raw: Any, error: ValidationError, label: str) -> list[str]:
    """What is wrong with a file, a sentence each; of very many the first ones."""
    found = error.errors(include_url=False)
    lines: list[str] = []
    for one in found:
        line = f"{label}: {sentence(root, raw, one)}"
        if lines and sum(map(len, lines)) + len(line) > TOLD_CHARACTERS_MAX:
            break
        lines.append(line)
    more = len(found) - len(lines)
    return [*lines, f"{label}: {more:,} more are refused"] if more else lines
