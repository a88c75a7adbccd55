"""The standard streams take whatever comes: full, closed, left by their reader, asleep, ASCII."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
AT_ONCE_S = 5.0
HEAD = "from flight_sw.runtime import program, streams\n"


def ended(body: str, redirection: str, **environment: str) -> tuple[int, str, str]:
    """A program with this body, its streams as a shell redirects them: status, stdout, stderr."""
    text = f"{HEAD}def main():\n  {body}\n  return 0\nraise SystemExit(program.run('p', main))"
    done = subprocess.run(
        ["bash", "-c", f'"$0" -c "$1" {redirection}', sys.executable, text],
        capture_output=True, text=True, timeout=60.0, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


GONE = 'cd "$2" && rmdir "$2" && "$0" -c "$1"'
SPEAKS = "streams.say('told'); streams.tell('result')"


@pytest.mark.parametrize("redirection", ["2>/dev/full", "2>&-", "0<&- 2>&-", "2> >(exit)"])
def test_what_cannot_be_told_changes_nothing(redirection: str) -> None:
    assert ended(SPEAKS, redirection) == (0, "result\n", "")


@pytest.mark.parametrize(
    ("redirection", "why"),
    [(">/dev/full", "No space left on device"), (">&-", "it is closed"),
     ("0<&- >&-", "it is closed")],
)  # fmt: skip
def test_a_result_that_cannot_be_written_is_one_sentence_and_status_1(
    redirection: str, why: str
) -> None:
    assert ended(SPEAKS, redirection) == (1, "", f"told\np: standard output: {why}\n")


def test_a_program_without_a_result_does_not_need_stdout() -> None:
    assert ended("streams.say('told')", ">&-") == (0, "", "told\n")


def test_a_reader_that_has_had_enough_is_no_error() -> None:
    body = "[streams.tell('line') for _ in range(50_000)]"
    assert ended(body, "| head -n 1; exit ${PIPESTATUS[0]}") == (0, "line\n", "")


def test_a_reader_that_sleeps_does_not_hold_the_program_up() -> None:
    """A pipe of 64 kB that nobody empties: a plain write would wait for ever."""
    reader, writer = os.pipe()
    body = "[streams.say('x' * 1000) for _ in range(1000)]"
    text = f"{HEAD}def main():\n  {body}\n  return 0\nraise SystemExit(program.run('p', main))"
    begun_s = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", text], stderr=writer, timeout=60.0, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0
    assert time.monotonic() - begun_s < AT_ONCE_S
    os.close(writer)
    assert os.read(reader, 1001) == b"x" * 1000 + b"\n"
    os.close(reader)


def test_a_line_is_there_at_once() -> None:
    body = "with streams.standard_streams():\n  streams.tell('now')\n  time.sleep(60)"
    text = f"{HEAD}import time\n{body}"
    with subprocess.Popen(
        [sys.executable, "-c", text], stdout=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as process:  # fmt: skip
        assert process.stdout is not None
        assert process.stdout.readline() == "now\n"
        process.kill()


def test_a_character_that_an_encoding_lacks_is_written_as_its_number() -> None:
    body = r"streams.tell('m/s\u00b2'); streams.tell('x\udcff')"
    status, out, err = ended(body, "| od -An -c", PYTHONIOENCODING="ascii")
    assert (status, err) == (0, "")
    assert "".join(out.split()) == r"m/s\xb2\nx377\n"


def test_a_file_opened_next_is_not_taken_for_a_standard_stream(tmp_path: Path) -> None:
    """With descriptor 2 closed, the next file would be 2, and libraries' last words end in it."""
    opened = f"import os; f = open({str(tmp_path / 'a')!r}, 'w')"
    body = f"{opened}; os.write(2, b'!'); streams.tell(f.fileno() > 2)"
    assert ended(body, "2>&-") == (0, "True\n", "")
    assert (tmp_path / "a").read_text() == ""


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ("open('nowhere/x')", "nowhere/x: No such file or directory"),
        ("open('a' * 300)", "a" * 200 + "...: File name too long"),
        ("'x\\udcff'.encode()", "'x\\udcff': cannot be written as utf-8"),
        ("b'ab\\xff'.decode()", "bytes ff: are not utf-8, from byte 2 on"),
        ("raise TimeoutError()", "TimeoutError"),
        ("raise OSError(28, 'No space left\\non device')", "No space left on device"),
    ],
)
def test_an_error_of_the_system_is_one_sentence(body: str, sentence: str) -> None:
    assert ended(body, "") == (1, "", f"p: {sentence}\n")


def test_a_working_folder_that_was_removed_is_told() -> None:
    folder = subprocess.run(["mktemp", "-d"], capture_output=True, text=True, check=True).stdout
    text = f"{HEAD}raise SystemExit(program.run('p', lambda: 0))"
    done = subprocess.run(
        ["bash", "-c", GONE, sys.executable, text, folder.strip()],
        capture_output=True, text=True, timeout=60.0, check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == "p: the working folder cannot be used, it was removed\n"
