"""What the command line refuses: one clear sentence, a status above zero, nothing left behind."""

import errno
import os
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from flight_sw import load_image
from flight_sw.load_image import HEADER
from sim_harness.bus.hub import Hub
from sim_harness.mission.mission import GAINS
from tools.cli import main

Run = Callable[..., tuple[int, str, str]]
LQY = Path(__file__).parents[2] / "gains" / "hyperion-1" / "lqy.load"
MISSION = Path(__file__).parents[2] / "sim_harness" / "missions" / "hyperion-1.toml"


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """The command line in an empty folder: status, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str, str]:
        status = main(list(arguments))
        out, err = capsys.readouterr()
        return status, out, err

    return call


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fly", "hyperion-2"], ['mission "hyperion-2" is not shipped', "nearest is hyperion-1"]),
        (
            ["fly", "mars-lander", "--set", "lead_s=1"],
            ["lead_s: no table [lqy]", "drag-state,"],
        ),
        (["fly", "mars-lander", "--set", "design.sag.x=1"], ["design.sag.x is not a known key"]),
        (["fly", "hyperion-1", "--set", "k=1"], ["k is not a known key"]),
        (["fly", "hyperion-1", "--law", "lqx"], ["law 'lqx'", "nearest is lqy", "nominal, lqy"]),
        (
            ["fly", "hyperion-1", "--set", "heat_flux_max=1700"],
            ["heat_flux_max is not a known key", "limits.heat_flux_max_kwpm2"],
        ),
        (
            ["fly", "hyperion-1", "--set", "heat_flux_max_kwpm2=-5"],
            ["limits.heat_flux_max_kwpm2 is -5", "allowed 1 to 1000000 kW/m2, or inf"],
        ),
        (
            ["fly", "hyperion-1", "--set", "heat_flux_max_kwpm2=nan"],
            ["limits.heat_flux_max_kwpm2 is nan", "kW/m2"],
        ),
        (
            ["fly", "hyperion-1", "--set", "lead_s=hot"],
            ["lqy.lead_s", "hot", "allowed 0 to 1000 s"],
        ),
        (["fly", "hyperion-1", "--set", "lead_s"], ["--set lead_s", "KEY=VALUE"]),
        (["fly", "hyperion-1", "--set", "law=nominal"], ["chosen with --law"]),
        (["fly", "hyperion-1", "--bus", "can0"], ["--bus can0", "memory, unix, unix:PATH"]),
        (["fly", "hyperion-1", "--bus", "unix:nowhere.bus"], ["nowhere.bus", "does not exist"]),
        (["fly", "hyperion-1", "--external-computer"], ["--external-computer", "unix:PATH"]),
        (["fly", "no.toml"], ["mission file no.toml does not exist"]),
        (["gains", "hyperion-9"], ['mission "hyperion-9" is not shipped']),
        (["gains", "./design.toml"], ["design file ./design.toml does not exist"]),
    ],
)
def test_a_wrong_word_is_refused_with_what_is_allowed(
    run: Run, arguments: list[str], words: list[str]
) -> None:
    status, out, err = run(*arguments)
    assert status == 1
    assert out == ""
    assert err.startswith("aeroshell: ")
    assert err.count("\n") == 1
    for word in words:
        assert word in err
    assert not Path("runs").exists() or not list(Path("runs").iterdir())


def spoilt_loads() -> dict[str, tuple[bytes, str]]:
    """Load images that must not fly, and what is said of them."""
    raw = LQY.read_bytes()
    flipped = bytearray(raw)
    flipped[HEADER.itemsize + 1000] ^= 4
    layout = bytearray(raw)
    layout[HEADER.fields["layout"][1]] ^= 1  # type: ignore[index]
    image = load_image.parse_image(raw, "lqy")
    body = image.body.copy()
    body["law"]["inner_loop"]["lead_s"] = float("nan")
    header = bytearray(raw[: HEADER.itemsize])
    at = HEADER.fields["crc32"][1]  # type: ignore[index]
    header[at : at + 4] = bytes(4)
    crc = zlib.crc32(bytes(header) + body.tobytes())
    header[at : at + 4] = crc.to_bytes(4, "little")
    return {
        "truncated": (raw[:-7], "bytes, its header says"),
        "empty": (b"", "not a load image"),
        "flipped": (bytes(flipped), "crc32 is"),
        "layout": (bytes(layout), "crc32 is"),
        "not finite": (bytes(header) + body.tobytes(), "lead_s is nan"),
    }


@pytest.mark.parametrize("kind", spoilt_loads())
def test_a_spoilt_load_image_is_refused_before_anything_flies(
    run: Run, tmp_path: Path, kind: str
) -> None:
    raw, words = spoilt_loads()[kind]
    path = tmp_path / "spoilt.load"
    path.write_bytes(raw)
    status, _, err = run("fly", "hyperion-1", "--load", str(path))
    assert status == 1
    assert str(path) in err
    assert words in err


@pytest.mark.parametrize(
    ("mission", "load", "words"),
    [
        ("hyperion-1", "rlv/planned-lqr", ["made for mission rlv", "onboard.vehicle.mass_kg is"]),
        ("rlv", "hyperion-1/lqy", ["made for mission hyperion-1", "as in rlv"]),
        ("hyperion-1", "mars-lander/drag-state", ["onboard.planet.radius_m is"]),
    ],
)
def test_a_load_of_another_vehicle_or_planet_is_refused(
    run: Run, mission: str, load: str, words: list[str]
) -> None:
    path = GAINS / f"{load}.load"
    status, out, err = run("fly", mission, "--load", str(path), "--bus", "memory")
    assert (status, out) == (1, "")
    assert str(path) in err and err.count("\n") == 1
    assert all(word in err for word in words), err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("mass_kg = 450.0", "mass_kg = -450.0"), ["vehicle.mass_kg is -450", "kg"]),
        (("mass_kg = 450.0", 'mass_kg = "heavy"'), ['vehicle.mass_kg is "heavy"']),
        (("mass_kg = 450.0", "mas_kg = 450.0"), ["vehicle.mas_kg", "mass_kg"]),
        (("[limits]", "[limits"), ["is not TOML"]),
    ],
)
def test_a_corrupt_mission_names_file_key_and_what_is_allowed(
    run: Run, tmp_path: Path, change: tuple[str, str], words: list[str]
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(MISSION.read_text().replace(*change))
    status, _, err = run("fly", str(path))
    assert status == 1
    assert "mine.toml" in err
    for word in words:
        assert word in err


def test_a_bus_path_in_use_is_refused(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "bus"
    with Hub(path):
        status, _, err = run("bus", "hub", str(path))
    assert status == 1
    assert "in use by another hub" in err


def test_wrong_usage_has_its_own_status(run: Run) -> None:
    assert run("fly")[0] == 2
    assert run("fly", "hyperion-1", "--seed", "-1")[0] == 2
    assert run("nonsense")[0] == 2


def test_a_refused_telemetry_rate_leaves_no_folder(run: Run, tmp_path: Path) -> None:
    status, out, err = run("fly", "hyperion-1", "--telemetry-rate", "0", "--out", "a")
    assert (status, out) == (1, "")
    assert err == "aeroshell: --telemetry-rate 0: allowed are above 0 to 1000 Hz\n"
    assert not (tmp_path / "a").exists()


def test_a_load_made_for_the_flight_that_cannot_be_stored_leaves_no_folder(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, content: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("tools.gains.image.write_atomically", full)
    status, out, err = run("fly", "hyperion-1", "--set", "lead_s=10", "--out", "a")
    assert (status, out) == (1, "")
    assert err == "aeroshell: a/lqy.load: cannot be written, No space left on device\n"
    assert not (tmp_path / "a").exists()


@pytest.mark.jit_only
def test_a_summary_that_cannot_be_written_does_not_take_the_result_with_it(
    run: Run, tmp_path: Path
) -> None:
    (tmp_path / "a" / "summary.json.new").mkdir(parents=True)
    flight = ("fly", "hyperion-1", "--bus", "memory", "--set", "time_max_s=1", "--no-record")
    status, out, err = run(*flight, "--out", "a")
    assert status == 1
    assert "50 minor frames on bus memory" in out
    assert err.splitlines()[-1] == "aeroshell: a/summary.json: cannot be written, Is a directory"
