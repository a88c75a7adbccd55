"""Turns what pydantic reports about a mission into one sentence per error."""

import difflib
from collections.abc import Iterable
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from sim_harness.quantities import Quantity, Section, Text, plain

TAG = "model"


def nearest(word: str, known: Iterable[str]) -> str:
    """`, nearest is ...` when something known resembles the word, else nothing."""
    names = list(known)
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


def section_at(root: type[BaseModel], raw: Any, path: tuple[str, ...]) -> type[BaseModel] | None:
    """The section class a dotted path leads to."""
    section: type[BaseModel] | None = root
    for key in path:
        if section is None or key not in section.model_fields:
            return None
        raw = raw.get(key) if isinstance(raw, dict) else None
        section = chosen(section.model_fields[key].annotation, raw)
    return section


def without_tags(root: type[BaseModel], loc: tuple[int | str, ...], raw: Any) -> tuple[str, ...]:
    """Path of keys of an error, without the model names pydantic inserts after a choice."""
    path: list[str] = []
    was_choice = False
    for item in loc:
        if was_choice:
            was_choice = False
            continue
        parent = section_at(root, raw, tuple(path))
        path.append(str(item))
        field = parent.model_fields.get(str(item)) if parent else None
        was_choice = field is not None and len(sections_of(field.annotation)) > 1
    return tuple(path)


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


def sentence(root: type[BaseModel], raw: Any, error: ErrorDetails) -> str:
    """One error in words: key, what is, what is allowed."""
    path = without_tags(root, error["loc"], raw)
    where = ".".join(path)
    parent = section_at(root, raw, path[:-1])
    key = path[-1] if path else ""
    match error["type"]:
        case "refused":
            return f"{where}{'' if error['msg'].startswith('.') else ' '}{error['msg']}".strip()
        case "missing":
            return f"{where} is missing, allowed {allowed_of(parent, key)}"
        case "extra_forbidden":
            known = list(parent.model_fields) if parent else []
            return f"{where} is not a known key{nearest(key, known)}; allowed {', '.join(known)}"
        case "union_tag_invalid" | "union_tag_not_found":
            options = sections_of(parent.model_fields[key].annotation) if parent else []
            tags = ", ".join(tag_of(option) for option in options)
            found = error["input"].get(TAG) if isinstance(error["input"], dict) else error["input"]
            state = "missing" if found is None else plain(found)
            hint = nearest(str(found), tags.split(", "))
            return f"{where}.{TAG} is {state}{hint}; allowed {tags}"
        case _:
            return f"{where} is {plain(error['input'])}, allowed {allowed_of(parent, key)}"
