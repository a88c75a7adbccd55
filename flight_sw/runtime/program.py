"""How a program of ours ends: refusals and errors of the system as one sentence and a status.

Exit status: 0 done, 1 refused or a result that could not be written, 130 interrupted. A reader of
stdout that has had enough (`| head`) is no error: the program goes on to its end without a word.
"""

import os
from collections.abc import Callable
from typing import Any

from flight_sw.errors import AeroshellError
from flight_sw.runtime.streams import say, standard_streams

DONE, REFUSED, INTERRUPTED = 0, 1, 130
SHOWN_MAX = 200  # characters of a name that a sentence repeats


def shown(name: Any) -> str:
    """A name from outside, short enough for a sentence."""
    text = os.fsdecode(name) if isinstance(name, bytes) else str(name)
    return text if len(text) <= SHOWN_MAX else f"{text[:SHOWN_MAX]}..."


def sentence_of(error: OSError) -> str:
    """An error of the system, with the file that it is about."""
    reason = error.strerror or str(error) or type(error).__name__
    about = (error.filename, error.filename2)
    names = [shown(n) for n in about if isinstance(n, str | bytes | os.PathLike)]
    return ": ".join([*names, " ".join(reason.split())])


def sentence_of_text(error: UnicodeError) -> str:
    """A text that a name or a file cannot hold."""
    if isinstance(error, UnicodeEncodeError):
        return f"{shown(ascii(error.object))}: cannot be written as {error.encoding}"
    if isinstance(error, UnicodeDecodeError):
        wrong = bytes(error.object[error.start : error.end]).hex(" ")
        return f"bytes {shown(wrong)}: are not {error.encoding}, from byte {error.start} on"
    return shown(error)


def check_arguments(arguments: list[str]) -> None:
    """Refuse names that are no text: they go into manifests, reports and messages."""
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError:
            raise AeroshellError(f"{shown(ascii(argument))}: is not UTF-8") from None


def check_working_folder() -> None:
    """Refuse to begin where nothing can be written, and half the libraries fail."""
    try:
        os.getcwd()
    except OSError as error:
        reason = "it was removed" if isinstance(error, FileNotFoundError) else error.strerror
        raise AeroshellError(f"the working folder cannot be used, {reason}") from error


def _ended(name: str, main: Callable[[], int]) -> int:
    try:
        check_working_folder()
        return int(main())
    except AeroshellError as error:
        say(f"{name}: {error}")
    except OSError as error:
        say(f"{name}: {sentence_of(error)}")
    except UnicodeError as error:
        say(f"{name}: {sentence_of_text(error)}")
    except KeyboardInterrupt:
        return INTERRUPTED
    except SystemExit as leaving:
        return leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None)
    return REFUSED


def run(name: str, main: Callable[[], int]) -> int:
    """Run a program to its end, and tell in a sentence why it ended early; its exit status."""
    with standard_streams() as (out, _):
        status = _ended(name, main)
        if status == INTERRUPTED:
            say(f"{name}: interrupted")
        elif out.failure is not None and not out.reader_is_gone:
            say(f"{name}: standard output: {out.failure.strerror}")
            status = status or REFUSED
    return status
