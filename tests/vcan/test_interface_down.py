"""An interface that goes down in mid-flight: the harness ends, the flight computer keeps time."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from flight_sw import modes
from flight_sw.can.address import open_bus
from flight_sw.errors import BusError
from sim_harness.bus.traffic import Traffic, listen
from sim_harness.telemetry.reader import open_recording
from tests.vcan.flying import (
    BUS,
    INTERFACE,
    PEAK,
    Trigger,
    fly,
    frames_through,
    piece,
    set_interface,
)

pytestmark = [pytest.mark.vcan, pytest.mark.jit_only]

STATUS_ID = 0x030
DOWN_S = 2.0
RATE_HZ = 50.0
RAISE = f"interface is down, raise it with `ip link set {INTERFACE} up`"


@pytest.fixture(autouse=True)
def interface_up() -> Iterator[None]:
    yield
    set_interface("up")


def test_an_interface_that_goes_down_ends_the_harness_with_a_readable_recording(
    tmp_path: Path,
) -> None:
    options = [f"--set={setting}" for setting in (*PEAK, "time_max_s=60")]
    with subprocess.Popen(
        [sys.executable, "-m", "tools.cli", "fly", "hyperion-1", f"--bus={BUS}", *options,
         "--pace=realtime", f"--out={tmp_path}", "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as flight:  # fmt: skip
        before = frames_through()
        while frames_through() - before < 500:
            assert flight.poll() is None, flight.communicate()
            time.sleep(0.05)
        set_interface("down")
        _, words = flight.communicate(timeout=30.0)
    assert flight.returncode == 1
    assert re.search(
        rf"aeroshell: bus {BUS} was lost at \d+\.\d\d s of flight: interface is down, "
        rf"raise it with `ip link set {INTERFACE} up`",
        words,
    )
    recording = open_recording(tmp_path / "flight.mcap")
    assert recording.is_complete


@contextmanager
def computer() -> Iterator[subprocess.Popen[str]]:
    """A flight computer that is nobody's child but the test's."""
    with subprocess.Popen(
        [sys.executable, "-m", "flight_sw", "--load", str(piece(60.0).load_path), "--bus", BUS,
         "--synchronisation", "frame"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        try:
            yield process
        finally:
            process.terminate()


def status_heard() -> dict[str, float]:
    """The last FSW_STATUS of half a second."""
    traffic = Traffic()
    with open_bus(BUS) as bus:
        for _ in listen(bus, traffic, BUS, 0.5):
            pass
    return traffic.heard[STATUS_ID].values()


def test_the_flight_computer_keeps_time_and_goes_on_when_the_bus_is_back() -> None:
    with computer() as flying:
        went_down_s: list[float] = []

        def go_down() -> None:
            went_down_s.append(time.monotonic())
            set_interface("down")

        drop = Trigger(go_down, at_s=2.0)
        summary = fly(time_max_s=60.0, pace=1.0, trigger=drop, own_computer=False)
        lost_s = time.monotonic()
        assert RAISE in summary["failure"]
        time.sleep(DOWN_S)
        set_interface("up")
        down_s = time.monotonic() - went_down_s[0]
        status = status_heard()
        elapsed_cycles = RATE_HZ * (time.monotonic() - lost_s)
        flying.terminate()
        text, words = flying.communicate(timeout=30.0)
    assert flying.returncode == 0, words
    report = json.loads(text.splitlines()[-1])
    print(f"down for {report['bus_down_s']} s: {report['ticks']} ticks, status {status}")
    assert report["bus_losses"] == 1
    assert report["bus_down_s"] == pytest.approx(down_s, abs=1.0)
    assert status["mode"] == modes.SAFE
    assert status["cycle"] == pytest.approx(summary["minor_frames"] + elapsed_cycles, rel=0.1)


def test_the_flight_computer_ends_after_five_seconds_without_a_bus() -> None:
    with computer() as flying:
        drop = Trigger(lambda: set_interface("down"), at_s=1.0)
        fly(time_max_s=60.0, pace=1.0, trigger=drop, own_computer=False)
        start_s = time.monotonic()
        _, words = flying.communicate(timeout=30.0)
    assert flying.returncode == 1
    assert 4.0 < time.monotonic() - start_s < 12.0
    assert re.search(
        rf"flight computer: {BUS}: the bus was lost after \d+ cycles, "
        r"its interface down for 5\.\d s\n$",
        words,
    )


def test_an_interface_that_is_down_is_refused_with_the_way_to_raise_it() -> None:
    set_interface("down")
    with pytest.raises(BusError, match=f"^{BUS}: {re.escape(RAISE)}$"):
        open_bus(BUS)


def test_an_interface_that_is_missing_or_not_of_can_is_refused() -> None:
    with pytest.raises(BusError, match=r"^socketcan:vcan9: no such interface, `aeroshell bus up"):
        open_bus("socketcan:vcan9")
    with pytest.raises(BusError, match=r"^socketcan:lo: is not a CAN interface"):
        open_bus("socketcan:lo")
