"""What a CAN interface tells of itself reaches the log, the summary and the computer's report.

A hub makes no error frames; a third client sends what an interface would.
"""

import threading
from pathlib import Path

import pytest

from flight_sw.can.address import open_bus
from sim_harness.bus.hub import Hub
from sim_harness.bus.traffic import CAN_FRAME
from sim_harness.flight.bus_flight import fly_bus
from sim_harness.flight.flight import FlightPlan, FlightRun
from sim_harness.flight.summary import summary_of
from tools.overrides import prepare
from tools.show import ProgressLine

pytestmark = pytest.mark.jit_only

BUS_OFF = CAN_FRAME.pack(0x20000060, 8, bytes((0, 0, 0, 0, 0, 0, 255, 7)))
EVERY_S = 0.02
WORDS = ["bus off", "no acknowledgement"]


def test_bus_off_is_told_in_flight_in_the_summary_and_by_the_computer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    prepared = prepare("hyperion-1", "lqy", ["time_max_s=20"], None)
    over = threading.Event()
    with Hub(tmp_path / "bus") as hub, open_bus(f"unix:{hub.path}") as third:

        def send() -> None:
            while not over.wait(EVERY_S):
                third.send(BUS_OFF)

        sender = threading.Thread(target=send)
        sender.start()
        plan = FlightPlan(
            mission=prepared.mission, law="lqy", load_image=prepared.load_image,
            load_path=prepared.load_path, bus=f"unix:{hub.path}", recorded=False, pace=20.0,
        )  # fmt: skip
        with ProgressLine(prepared.mission, quiet=True) as line:
            run = FlightRun(plan, [line])
            try:
                assert fly_bus(run) == ""
            finally:
                over.set()
                sender.join()
    summary = summary_of(run)
    for account in (summary, run.computer):
        assert account["bus_errors"] == WORDS
        assert account["error_frames"] == account["bus_off"] > 0
    told = [text for text in capsys.readouterr().err.splitlines() if "interface reports" in text]
    assert told[0].endswith("counters 255 sending, 7 receiving")
    assert f"{', '.join(WORDS)}" in told[0]
    assert len(told) <= summary["bus_off"].bit_length()
    assert summary["outcome"] == "time out"
    assert summary["minor_frames"] == 1000
