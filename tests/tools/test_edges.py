"""The edges of the program: no room, no reader, no folder, strange names, poor terminals."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from sim_harness.bus.socket_path import UNIQUE_BYTES, places, socket_path
from sim_harness.flight.computer_process import PACKAGE_PARENT, own_environment, own_module
from sim_harness.flight.flight import FlightRun
from tools.cli import main
from tools.commands.campaign import ProgressOfMany
from tools.show import ProgressLine

ROOT = Path(__file__).parents[2]
PROGRAM = Path(sys.executable).with_name("aeroshell")
LONG = "a" * 300
NOT_UTF8 = "x\udcff"
SHORT = ("fly", "hyperion-1", "--bus", "memory", "--set", "time_max_s=2", "--out", "o")
RECORDINGS = ("info", "export", "replay", "review", "timing", "report")
TIMEOUT_S = 300.0  # of a first run that has to compile

Told = tuple[int, str, str]


def shell(folder: Path, line: str, *arguments: str, **environment: str | None) -> Told:
    """A command as a shell runs it, "$@" being our program with arguments."""
    changed = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    done = subprocess.run(
        ["bash", "-c", line, "bash", str(PROGRAM), *arguments],
        capture_output=True, text=True, timeout=TIMEOUT_S, check=False, cwd=folder,
        env={name: value for name, value in changed.items() if value is not None},
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


def refused(told: Told) -> str:
    """The one sentence of a refusal."""
    status, out, err = told
    err = "".join(line for line in err.splitlines(True) if not line.startswith("compiling"))
    assert (status, out) == (1, "")
    assert err.startswith("aeroshell: ") and err.count("\n") == 1, err
    return err


@pytest.mark.parametrize(
    ("arguments", "redirection", "why"),
    [
        (("missions",), ">&-", "it is closed"),
        (("bus", "load"), ">/dev/full", "No space left on device"),
        (("--help",), ">/dev/full", "No space left on device"),
    ],
)
def test_a_result_that_cannot_be_written_is_refused(
    tmp_path: Path, arguments: tuple[str, ...], redirection: str, why: str
) -> None:
    told = refused(shell(tmp_path, f'"$@" {redirection}', *arguments))
    assert told == f"aeroshell: standard output: {why}\n"


def test_a_reader_that_has_had_enough_is_no_error(tmp_path: Path) -> None:
    line = '"$@" | head -n 1; exit ${PIPESTATUS[0]}'
    status, out, err = shell(tmp_path, line, "bus", "load", "--json")
    assert (status, out, err) == (0, "{\n", "")


def test_usage_that_cannot_be_told_keeps_its_status(tmp_path: Path) -> None:
    assert shell(tmp_path, '"$@" 2>&-', "missions", "--no-such-option")[0] == 2


@pytest.mark.jit_only
@pytest.mark.parametrize(
    ("line", "options"),
    [
        ('"$@" 2>/dev/full', ()),
        ('"$@" 0<&- 2>&-', ()),
        ('"$@" 2> >(exit)', ("--bus", "unix", "--pace", "40x")),
    ],
)
def test_what_cannot_be_told_never_decides_on_a_flight(
    tmp_path: Path, line: str, options: tuple[str, ...]
) -> None:
    status, out, err = shell(tmp_path, line, *SHORT, *options)
    assert (status, err) == (0, "")
    assert "100 minor frames" in out
    assert json.loads((tmp_path / "o/summary.json").read_text())["outcome"] == "time out"


@pytest.mark.jit_only
def test_a_flight_whose_result_cannot_be_printed_is_kept(tmp_path: Path) -> None:
    told = shell(tmp_path, '"$@" >/dev/full', *SHORT, "--json")
    assert refused(told).endswith("standard output: No space left on device\n")
    assert json.loads((tmp_path / "o/summary.json").read_text())["outcome"] == "time out"


@pytest.mark.jit_only
def test_a_campaign_that_cannot_be_told_is_flown(tmp_path: Path) -> None:
    options = ("--dispersions", "sensitivity", "-n", "2", "--set", "time_max_s=2", "--no-report")
    status, _, err = shell(
        tmp_path, '"$@" 2>/dev/full', "campaign", "hyperion-1", *options, "--out", "c"
    )
    assert (status, err) == (0, "")
    assert json.loads((tmp_path / "c/campaign.json").read_text())["state"] == "done"


@pytest.fixture
def run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Told]:
    """The command line in this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> Told:
        status = main([*arguments])
        return status, *capsys.readouterr()

    return call


DISPERSED = ("campaign", "hyperion-1", "--dispersions", "sensitivity", "-n", "1")


@pytest.mark.parametrize(
    "arguments",
    [
        ("fly", "hyperion-1", "--out", LONG),
        ("fly", LONG),
        ("fly", "hyperion-1", "--load", LONG),
        ("fly", "--from", LONG, "--run", "1"),
        ("fly", "hyperion-1", "--bus", f"unix:{LONG}"),
        ("gains", LONG),
        ("bus", "hub", LONG),
        ("bus", "monitor", f"unix:{LONG}"),
        (*DISPERSED, "--out", LONG),
        *((name, LONG) for name in RECORDINGS),
    ],
)
def test_a_name_of_300_bytes_is_refused(
    run: Callable[..., Told], arguments: tuple[str, ...]
) -> None:
    told = refused(run(*arguments))
    assert any(why in told for why in ("File name too long", "300 bytes", "is not shipped"))


@pytest.mark.parametrize(
    "arguments",
    [
        ("fly", "hyperion-1", "--out", NOT_UTF8),
        (*DISPERSED, "--out", NOT_UTF8),
        ("bus", "hub", NOT_UTF8),
        *((name, NOT_UTF8) for name in RECORDINGS),
    ],
)
def test_a_name_that_is_no_text_is_refused(
    run: Callable[..., Told], arguments: tuple[str, ...]
) -> None:
    assert refused(run(*arguments)) == "aeroshell: 'x\\udcff': is not UTF-8\n"


@pytest.mark.parametrize(
    "arguments",
    [("fly", "hyperion-1", "--out", "file/o"), (*DISPERSED, "--out", "file/o")],
)
def test_a_folder_below_a_file_is_refused(
    run: Callable[..., Told], tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    (tmp_path / "file").touch()
    assert "Not a directory" in refused(run(*arguments))


@pytest.mark.jit_only
def test_gains_that_cannot_be_written_are_refused(run: Callable[..., Told], tmp_path: Path) -> None:
    for name in ("sim_harness/missions/hyperion-1.toml", "gains/hyperion-1/design.toml"):
        (tmp_path / Path(name).name).write_bytes((ROOT / name).read_bytes())
    design = tmp_path / "design.toml"
    text = design.read_text().replace('mission = "hyperion-1"', 'mission = "hyperion-1.toml"')
    design.write_text(text)
    (tmp_path / "nominal.load.new").mkdir()  # where the image is written to, even for root
    assert "nominal.load" in refused(run("gains", "design.toml"))


def test_a_working_folder_that_was_removed_is_told(tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    told = shell(tmp_path, 'cd gone && rmdir ../gone && "$@"', "missions")
    assert refused(told) == "aeroshell: the working folder cannot be used, it was removed\n"


@pytest.mark.parametrize(
    "environment",
    [
        {"HOME": None, "LC_ALL": "C", "PYTHONIOENCODING": "ascii"},
        {"HOME": "/nowhere/at/all", "NO_COLOR": "1", "TERM": "dumb", "COLUMNS": "20"},
        {"TERM": None, "LANG": "xx_YY.nonsense", "COLUMNS": "1", "LINES": "1"},
    ],
    ids=str,
)
def test_a_poor_environment_changes_how_it_looks_alone(
    tmp_path: Path, environment: dict[str, str | None]
) -> None:
    status, out, err = shell(tmp_path, '"$@"', "bus", "load", **environment)
    assert (status, err) == (0, "")
    assert "% of 1000000 bit/s at worst, below the limit of 50 %" in out


IMPOSTOR = "raise SystemExit('the impostor was imported')\n"


@pytest.mark.jit_only
@pytest.mark.parametrize("place", [None, f"{ROOT}:."])
def test_the_working_folder_never_says_what_flies(tmp_path: Path, place: str | None) -> None:
    """With PYTHONPATH unset, and with the working folder in it."""
    for name in ("flight_sw", "sim_harness", "numba", "numpy"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(IMPOSTOR)
        (tmp_path / name / "__main__.py").write_text(IMPOSTOR)
    for name in ("can.py", "typer.py", "rich.py", "cantools.py"):
        (tmp_path / name).write_text(IMPOSTOR)
    status, out, err = shell(tmp_path, '"$@"', *SHORT, "--bus", "unix", PYTHONPATH=place)
    assert "impostor" not in err
    assert (status, "100 minor frames" in out) == (0, True), err


def test_a_process_of_ours_imports_this_installation_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    kept = tmp_path / "lib"
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(["", "lib", str(tmp_path), str(kept)]))
    assert own_environment()["PYTHONPATH"] == f"{PACKAGE_PARENT}{os.pathsep}{kept}"
    assert own_module("flight_sw") == [sys.executable, "-P", "-m", "flight_sw"]


@pytest.mark.parametrize("length", [107, 120, 200])
def test_a_bus_finds_a_shorter_place_than_a_long_tmpdir(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, length: int
) -> None:
    long = tmp_path / ("t" * max(length - len(str(tmp_path)) - 1, 1))
    long.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(long))
    with socket_path() as path:
        assert len(os.fsencode(path)) <= 107
        assert path.parent.is_dir()
    assert not path.parent.exists()


def test_a_usual_tmpdir_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = "/" + "t" * (107 - UNIQUE_BYTES - 1)  # the longest that leaves room
    monkeypatch.setattr("tempfile.tempdir", usual)
    assert places()[0] == usual
    monkeypatch.setattr("tempfile.tempdir", usual + "t")
    assert usual + "t" not in places()


def test_where_no_place_is_short_enough_tmpdir_is_named(
    run: Callable[..., Told], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", "/" + "t" * 119)
    monkeypatch.setattr("sim_harness.bus.socket_path.SHORT_PLACES", ("/nowhere",))
    told = refused(run("fly", "hyperion-1", "--set", "time_max_s=1"))
    assert f"TMPDIR /{'t' * 119}: path of 120 bytes" in told


def test_the_hub_says_where_it_is_before_it_ends(tmp_path: Path) -> None:
    with subprocess.Popen(
        [str(PROGRAM), "bus", "hub", "b"], cwd=tmp_path, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as hub:  # fmt: skip
        assert hub.stderr is not None and hub.stdout is not None
        assert hub.stderr.readline() == "bus on b, Ctrl-C ends it\n"
        hub.send_signal(signal.SIGTERM)
        assert hub.stdout.readline() == "clients connected  0\n"
        hub.communicate(timeout=TIMEOUT_S)
        assert hub.returncode == 0


LONGER = ("fly", "hyperion-1", "--bus", "memory", "--set", "time_max_s=400", "--out", "o")


@pytest.mark.jit_only
def test_a_folder_removed_in_flight_is_told_at_once_and_the_flight_goes_on(
    run: Callable[..., Told], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = ProgressLine.progress

    def removing(line: ProgressLine, flight: FlightRun) -> None:
        shutil.rmtree(tmp_path / "o", ignore_errors=True)
        shown(line, flight)

    monkeypatch.setattr(ProgressLine, "progress", removing)
    status, out, err = run(*LONGER)
    assert status == 1
    assert "20,000 minor frames" in out
    lost = "was removed, what is written there is lost"
    told = [line for line in err.splitlines() if lost in line]
    assert len(told) == 1
    assert 0.0 < float(told[0].partition(" s: the folder o ")[0]) < 200.0
    last = err.splitlines()[-1]
    assert last.startswith("aeroshell: flight.mcap: recording ended at ")
    assert last.endswith("the file was removed; o/summary.json: cannot be written, "
                         "No such file or directory")  # fmt: skip


@pytest.mark.jit_only
def test_a_recording_that_finds_no_room_is_told_and_the_flight_goes_on(tmp_path: Path) -> None:
    assert shell(tmp_path, '"$@"', *SHORT)[0] == 0  # what is compiled has room to be kept
    status, out, err = shell(tmp_path, 'ulimit -f 300; "$@"', *LONGER, "--force")
    assert status == 1
    assert "20,000 minor frames" in out
    summary = json.loads((tmp_path / "o/summary.json").read_text())
    assert summary["recording_failure"].endswith("File too large")
    assert summary["outcome"] == "time out"
    assert err.splitlines()[-1] == f"aeroshell: {summary['recording_failure']}"


@pytest.mark.jit_only
def test_a_campaign_whose_folder_is_removed_ends_with_a_sentence(
    run: Callable[..., Told], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = ProgressOfMany.__call__

    def removing(line: ProgressOfMany, done: int, n: int) -> None:
        told(line, done, n)
        if done == 1:
            shutil.rmtree(tmp_path / "c")

    monkeypatch.setattr(ProgressOfMany, "__call__", removing)
    options = ("-n", "4", "--jobs", "1", "--set", "time_max_s=2", "--out", "c")
    told_last = refused(run(*DISPERSED[:4], *options))
    assert "c/flights.jsonl: cannot be written (the file was removed)" in told_last
