"""python-can on the hub: its bus class, filters, notifier, and its logger as a process."""

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path

import can
import pytest

from flight_sw import icd
from sim_harness.bus.hub import Hub
from sim_harness.bus.interface import UnixBus, bytes_of, message_of

WAIT_S = 20.0
ROOT = Path(__file__).parents[2]


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Hub]:
    with Hub(tmp_path / "bus") as running:
        yield running


@pytest.fixture
def pair(hub: Hub) -> Iterator[tuple[UnixBus, UnixBus]]:
    with UnixBus(str(hub.path)) as a, UnixBus(str(hub.path)) as b:
        wait_for_clients(hub, 2)
        yield a, b


def wait_for_clients(hub: Hub, count: int) -> None:
    deadline_s = time.monotonic() + WAIT_S
    while hub.stats.clients < count:
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


MESSAGES = [
    can.Message(arbitration_id=0x123, is_extended_id=False, data=bytes(range(8))),
    can.Message(arbitration_id=0x7FF, is_extended_id=False, data=b""),
    can.Message(arbitration_id=0x1ABCDEF0, is_extended_id=True, data=b"\x01\x02"),
    can.Message(arbitration_id=0x10, is_extended_id=False, is_remote_frame=True, dlc=3),
    can.Message(arbitration_id=0x20, is_extended_id=False, is_error_frame=True, data=b"\0" * 8),
]


@pytest.mark.parametrize("message", MESSAGES)
def test_a_message_arrives_as_it_was_sent(
    pair: tuple[UnixBus, UnixBus], message: can.Message
) -> None:
    before_s = time.time()
    pair[0].send(message)
    found = pair[1].recv(5.0)
    assert found is not None
    assert message.equals(found, timestamp_delta=None, check_channel=False, check_direction=False)
    assert before_s <= found.timestamp <= time.time()


@pytest.mark.parametrize("message", MESSAGES)
def test_a_message_is_one_can_frame(message: can.Message) -> None:
    packet = bytes_of(message)
    assert len(packet) == 16
    assert message.equals(message_of(packet, 0.0), timestamp_delta=None)


def test_the_frame_of_a_worked_message() -> None:
    assert bytes_of(MESSAGES[0]) == bytes.fromhex("23010000 08000000 0001020304050607")


def test_a_length_above_eight_is_read_as_eight() -> None:
    assert message_of(bytes.fromhex("23010000 0f000000 0001020304050607"), 0.0).dlc == 8


def test_a_flexible_data_frame_is_refused(pair: tuple[UnixBus, UnixBus]) -> None:
    long = can.Message(arbitration_id=1, is_fd=True, data=bytes(12))
    with pytest.raises(can.CanOperationError, match="frame of 12 bytes, this bus carries 0 to 8"):
        pair[0].send(long)


def test_a_timeout_ends_in_nothing(pair: tuple[UnixBus, UnixBus]) -> None:
    start_s = time.monotonic()
    assert pair[0].recv(0.05) is None
    assert pair[0].recv(0.0) is None
    assert 0.05 <= time.monotonic() - start_s < 2.0


def test_filters_keep_what_they_name(hub: Hub) -> None:
    filters = [{"can_id": 0x20, "can_mask": 0x7F0, "extended": False}]
    with UnixBus(str(hub.path)) as a, UnixBus(str(hub.path), can_filters=filters) as b:
        wait_for_clients(hub, 2)
        for identifier in (0x10, 0x21, 0x30, 0x2F):
            a.send(can.Message(arbitration_id=identifier, is_extended_id=False))
        found = [b.recv(5.0), b.recv(5.0)]
        assert [m and m.arbitration_id for m in found] == [0x21, 0x2F]
        assert b.recv(0.05) is None


def test_a_packet_that_is_no_frame_is_passed_over(
    hub: Hub, monkeypatch: pytest.MonkeyPatch
) -> None:
    packets = [b"x", b"x" * 17, bytes_of(MESSAGES[0])]
    with UnixBus(str(hub.path)) as bus, UnixBus(str(hub.path)) as other:
        wait_for_clients(hub, 2)
        other.send(MESSAGES[1])  # makes the socket readable

        class Replayed:
            def fileno(self) -> int:
                return real.fileno()

            def recv(self, *_: int) -> bytes:
                return packets.pop(0)

            def close(self) -> None:
                real.close()

        real = bus._socket
        monkeypatch.setattr(bus, "_socket", Replayed())
        found = bus.recv(5.0)
        assert found is not None
        assert found.arbitration_id == 0x123


def test_the_notifier_listens_on_the_descriptor(pair: tuple[UnixBus, UnixBus]) -> None:
    assert pair[1].fileno() >= 0
    reader = can.BufferedReader()
    notifier = can.Notifier(pair[1], [reader], timeout=0.1)
    try:
        pair[0].send(MESSAGES[0])
        found = reader.get_message(5.0)
    finally:
        notifier.stop()
    assert found is not None
    assert found.arbitration_id == 0x123


def test_the_end_of_the_hub_is_an_error_with_a_sentence(tmp_path: Path) -> None:
    hub = Hub(tmp_path / "bus").start()
    bus = UnixBus(str(hub.path))
    wait_for_clients(hub, 1)
    hub.stop()
    with pytest.raises(can.CanOperationError, match=f"aeroshell bus {hub.path} has ended"):
        bus.recv(5.0)
    with pytest.raises(can.CanOperationError, match=f"aeroshell bus {hub.path}: "):
        bus.send(MESSAGES[0], timeout=5.0)
    bus.shutdown()


def test_a_path_without_a_hub_is_refused_with_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(can.CanInitializationError, match="does not exist, start a hub there"):
        UnixBus(str(tmp_path / "none"))


def test_a_bus_that_was_shut_down_is_refused(hub: Hub) -> None:
    bus = UnixBus(str(hub.path))
    bus.shutdown()
    bus.shutdown()
    with pytest.raises(can.CanOperationError, match="connection closed"):
        bus.recv(0.1)


def registered() -> bool:
    return any(e.name == "aeroshell" for e in entry_points(group="can.interface"))


def test_the_interface_is_registered_by_its_name() -> None:
    assert registered(), "the package is not installed: make setup"


def test_can_bus_opens_it_by_name(hub: Hub) -> None:
    with can.Bus(interface="aeroshell", channel=str(hub.path)) as bus:
        wait_for_clients(hub, 1)
        assert isinstance(bus, UnixBus)
        assert bus.protocol == can.CanProtocol.CAN_20


def test_the_logger_of_python_can_logs_the_bus(hub: Hub, tmp_path: Path) -> None:
    log = tmp_path / "bus.asc"
    command = [sys.executable, "-m", "can.logger", "-i", "aeroshell", "-c", str(hub.path)]
    with subprocess.Popen(
        [*command, "-f", str(log)], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    ) as logger:
        wait_for_clients(hub, 1)
        with UnixBus(str(hub.path)) as bus:
            wait_for_clients(hub, 2)
            for message in icd.LAYOUT:
                bus.send(
                    can.Message(arbitration_id=message.can_id, is_extended_id=False, data=bytes(8))
                )
            deadline_s = time.monotonic() + WAIT_S
            while hub.stats.frames_sent < icd.N_MESSAGES:
                assert time.monotonic() < deadline_s
        time.sleep(0.5)
        logger.send_signal(2)
        try:
            output, _ = logger.communicate(timeout=WAIT_S)
        finally:
            logger.kill()  # nothing to a process that has ended; no test waits for one that has not
    found = re.findall(r"^ *[0-9.]+ +\d+ +([0-9A-F]+) +Rx", log.read_text(), re.MULTILINE)
    assert [int(identifier, 16) for identifier in found] == [m.can_id for m in icd.LAYOUT], output
