"""Reads every TOML, JSON and CSV file of the project: bounded, and refused in one sentence.

A file that is too large, too deep, no text or no document raises the error that the caller names,
and nothing else: what a reader of a library throws (RecursionError, OverflowError, its limit on the
digits of a number) never reaches the caller. Sizes are far above what any document of the project
has, and small enough that what is made of them stays below 256 MB.
"""

import csv
import io
import json
import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from flight_sw.errors import AeroshellError, MissionError

TOML_BYTES_MAX = 1_000_000
JSON_BYTES_MAX = 3_000_000
CSV_BYTES_MAX = 1_000_000
DEPTH_MAX = 32  # tables and lists within each other, and parts of a dotted key
NUMBER_CHARACTERS_MAX = 200
ECHO_CHARACTERS = 200  # of a value that a sentence repeats
REST = "..."
SURROGATE = b"\\ud"  # of JSON: half of a character, which no text may hold alone
BYTE_ORDER_MARK = "\ufeff"

# Each alternative takes all it can reach, whether it ends as it should or not: one pass, whatever
# the text is.
TOKEN = re.compile(
    r'''"""(?:[^"\\]|\\.|"(?!""))*+"*+|\'\'\'(?:[^']|'(?!''))*+'*+'''
    r"""|"(?:[^"\\\n]|\\.)*+"?|'[^'\n]*+'?|\#[^\n]*+|[A-Za-z0-9_+-]++|[ \t]++|.""",
    re.DOTALL,
)


class DocumentError(ValueError):
    """What is wrong, to follow a file's name."""


def short(text: str) -> str:
    """A text as a sentence repeats it: cut, and without what a terminal would act on."""
    shown = "".join(
        c if c.isprintable() else f"\\u{ord(c):04x}" for c in text[: 2 * ECHO_CHARACTERS]
    )
    return shown if len(shown) <= ECHO_CHARACTERS else shown[: ECHO_CHARACTERS - len(REST)] + REST


def quoted(text: str) -> str:
    """A text of a file in quotes, in one line and without what a terminal would act on."""
    return '"' + short(json.dumps(text[: 2 * ECHO_CHARACTERS], ensure_ascii=False)[1:-1]) + '"'


def content_of(path: Path, bytes_max: int) -> bytes:
    """A regular file's bytes; raises DocumentError for anything else, and for too many."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with open(descriptor, "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise DocumentError("is not a file")
            raw = file.read(bytes_max + 1)
    except OSError as error:
        raise DocumentError(f"cannot be read: {error.strerror}") from None
    except ValueError as error:
        if isinstance(error, DocumentError):
            raise
        raise DocumentError("cannot be read: its name holds a zero byte") from None
    if len(raw) > bytes_max:
        raise DocumentError(f"has more than {bytes_max:,} bytes")
    return raw


def text_of(raw: bytes) -> str:
    """UTF-8 text, with or without a byte-order mark."""
    try:
        return raw.decode("utf-8").removeprefix(BYTE_ORDER_MARK)
    except UnicodeDecodeError as error:
        raise DocumentError(f"is not UTF-8 text at byte {error.start}") from None


def check_depth(tree: Any) -> None:
    """Refuse tables and lists that lie too deep within each other."""
    below = [tree]
    for _ in range(DEPTH_MAX + 1):
        lists = [item for item in below if isinstance(item, list)]
        tables = [item for item in below if isinstance(item, dict)]
        below = [item for values in lists for item in values if isinstance(item, list | dict)]
        below += [v for table in tables for v in table.values() if isinstance(v, list | dict)]
        if not below:
            return
    raise DocumentError(f"has tables or lists more than {DEPTH_MAX} deep")


def check_toml_text(text: str) -> None:
    """Refuse what a reader of TOML would take for ever for, or end on: depth and long words."""
    depth = parts = 0
    for found in TOKEN.finditer(text):
        token = found.group()
        if token in "[{":
            depth += 1
        elif token in "]}":
            depth = max(depth - 1, 0)
        elif token == ".":
            parts += 1
        elif not token.isspace() or token == "\n":
            is_word = token[0].isalnum() or token[0] in "\"'_+-"
            parts = parts if is_word else 0
            if token[0] in "+-0123456789" and len(token) > NUMBER_CHARACTERS_MAX:
                raise DocumentError(
                    f"line {text.count(chr(10), 0, found.start()) + 1} has a number of "
                    f"{len(token):,} characters, allowed to {NUMBER_CHARACTERS_MAX}"
                )
            if token == "\n":
                parts = 0
        if depth > DEPTH_MAX or parts > DEPTH_MAX:
            line = text.count("\n", 0, found.start()) + 1
            raise DocumentError(f"line {line} has tables or lists more than {DEPTH_MAX} deep")


def toml_of(raw: bytes) -> dict[str, Any]:
    """The tables of a TOML text; raises DocumentError."""
    if len(raw) > TOML_BYTES_MAX:
        raise DocumentError(f"has more than {TOML_BYTES_MAX:,} bytes")
    text = text_of(raw)
    check_toml_text(text)
    try:
        tree = tomllib.loads(text)
    except (ValueError, OverflowError, RecursionError) as error:
        raise DocumentError(f"is not TOML: {short(str(error))}") from None
    check_depth(tree)
    return tree


def json_of(raw: bytes) -> Any:
    """The value of a JSON text; raises DocumentError."""
    if len(raw) > JSON_BYTES_MAX:
        raise DocumentError(f"has more than {JSON_BYTES_MAX:,} bytes")
    try:
        value = json.loads(text_of(raw))
    except DocumentError:
        raise
    except RecursionError:
        raise DocumentError(f"has tables or lists more than {DEPTH_MAX} deep") from None
    except ValueError as error:
        raise DocumentError(f"is not JSON: {short(str(error))}") from None
    check_depth(value)
    if SURROGATE in raw.lower():
        try:
            json.dumps(value, ensure_ascii=False).encode("utf-8")
        except UnicodeEncodeError:
            raise DocumentError("is not JSON: half of a surrogate pair in a text") from None
    return value


def read_toml(
    path: Path, error: type[AeroshellError] = MissionError, label: str | None = None
) -> dict[str, Any]:
    """The file as nested dictionaries; `label` is what a refusal calls it."""
    try:
        return toml_of(content_of(path, TOML_BYTES_MAX))
    except DocumentError as found:
        raise error(f"{label or path.name}: {found}") from None


def read_json(path: Path, error: type[AeroshellError]) -> Any:
    """The file's value."""
    try:
        return json_of(content_of(path, JSON_BYTES_MAX))
    except DocumentError as found:
        raise error(f"{path}: {found}") from None


def csv_rows(raw: bytes) -> list[tuple[int, list[str]]]:
    """Numbered lines of a comma-separated table as spreadsheets write it; raises DocumentError.

    A byte-order mark, quoted fields, either line end and empty lines at the end are all right.
    """
    text = text_of(raw)
    try:
        reader = csv.reader(io.StringIO(text, newline=""), strict=True)
        rows = [(reader.line_num, [field.strip() for field in row]) for row in reader]
    except csv.Error as error:
        raise DocumentError(f"line {reader.line_num} is not CSV: {short(str(error))}") from None
    while rows and not any(rows[-1][1]):
        rows.pop()
    return rows


def read_csv(path: Path) -> list[tuple[int, list[str]]]:
    """The lines of a CSV file."""
    try:
        return csv_rows(content_of(path, CSV_BYTES_MAX))
    except DocumentError as found:
        raise MissionError(f"{path.name}: {found}") from None
