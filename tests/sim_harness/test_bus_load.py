"""The worst-case load, from the length of a stuffed frame to the printed verdict."""

import dataclasses
import json

import pytest
from typer.testing import CliRunner

from flight_sw import icd
from sim_harness.bus.load_model import LOAD_LIMIT, bus_load, worst_frame_bits
from tools.commands.bus import app

RUN = CliRunner()


def longest_stuffed_frame(data_bytes: int) -> int:
    """Bits of the longest frame: the worst data for stuffing, stuffed bit by bit."""
    stuffed_part = 34 + 8 * data_bytes  # start of frame to checksum
    bits = [0] * 5 + [1] * 4  # then four alike after each stuffed bit
    while len(bits) < stuffed_part:
        bits += [1 - bits[-1]] * 4
    length = run = 0
    last = -1
    for bit in bits[:stuffed_part]:
        length += 1
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            length += 1
            last, run = 1 - bit, 1
    return length + 13  # delimiters, acknowledge, end of frame, pause


@pytest.mark.parametrize(("data_bytes", "bits"), [(0, 55), (1, 65), (8, 135)])
def test_a_frame_takes_55_and_ten_bits_a_byte(data_bytes: int, bits: int) -> None:
    assert worst_frame_bits(data_bytes) == bits  # [DAVIS07]


@pytest.mark.parametrize("data_bytes", range(9))
def test_no_stuffed_frame_is_longer(data_bytes: int) -> None:
    assert longest_stuffed_frame(data_bytes) == worst_frame_bits(data_bytes)


def test_the_total_is_that_of_the_agreed_rates() -> None:
    rate_hz = sum(1000.0 / m.cycle_ms for m in icd.LAYOUT if m.cycle_ms)
    assert bus_load().total_ratio == pytest.approx(rate_hz * 135 / 1e6, rel=1e-12)
    assert bus_load(500_000).total_ratio == pytest.approx(2 * bus_load().total_ratio)


def test_the_bus_is_loaded_below_the_limit_at_one_megabit() -> None:
    assert bus_load(1_000_000).is_within_limit


def test_half_a_bus_is_at_the_limit_and_not_below() -> None:
    message = dataclasses.replace(icd.layout("NAV_TIME"), cycle_ms=1)
    assert not bus_load(2 * 135 * 1000, (message,)).is_within_limit
    assert bus_load(2 * 135 * 1000 + 1, (message,)).is_within_limit
    assert LOAD_LIMIT == 0.5


def test_a_message_on_an_event_adds_nothing() -> None:
    row = next(m for m in bus_load().messages if m.message == "GROUND_REQUEST")
    assert (row.load_ratio, row.cycle_ms, row.frame_bits) == (0.0, 0, 135)


def test_the_command_prints_each_message_and_a_verdict() -> None:
    result = RUN.invoke(app, ["load"])
    assert result.exit_code == 0
    for message in icd.MESSAGES:
        assert message in result.stdout
    total = 100 * bus_load().total_ratio
    assert result.stdout.splitlines()[-1] == (
        f"{total:.2f} % of 1000000 bit/s at worst, below the limit of 50 %"
    )


def test_the_command_refuses_an_overloaded_bus() -> None:
    result = RUN.invoke(app, ["load", "--bitrate-bps", "125000"])
    assert result.exit_code == 1
    assert result.stdout.splitlines()[-1].endswith("NOT below the limit of 50 %")


def test_json_is_one_object_and_nothing_else() -> None:
    summary = json.loads(RUN.invoke(app, ["load", "--json", "--bitrate-bps", "500000"]).stdout)
    assert summary["bitrate_bps"] == 500_000
    assert summary["within_limit"] is True
    assert summary["total_ratio"] == pytest.approx(
        sum(m["load_ratio"] for m in summary["messages"])
    )
    assert [m["message"] for m in summary["messages"]] == list(icd.MESSAGES)


@pytest.mark.parametrize("bitrate", ["0", "-5", "9999", "1000001", "fast"])
def test_a_bit_rate_that_classical_can_has_not_is_a_usage_error(bitrate: str) -> None:
    result = RUN.invoke(app, ["load", "--bitrate-bps", bitrate])
    assert result.exit_code == 2
    assert "--bitrate-bps" in result.output
