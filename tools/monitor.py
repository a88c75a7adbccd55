"""Live tables of what goes over a bus."""

import math
import socket
import time

from rich.live import Live
from rich.table import Table

from flight_sw import icd
from flight_sw.runtime.streams import is_heard
from sim_harness.bus.load_model import BusLoad
from sim_harness.bus.traffic import Heard, Traffic, listen
from tools.console import result_console

PERCENT = 100.0
REFRESH_HZ = 4
RATE_WINDOW_S = 2.0
VALUES_SHOWN = 3
DIGITS_MAX = 8  # behind the point
CHECKSUM_SUFFIX = "crc32"


class Rates:
    """Frames a second of each identifier over the last seconds."""

    def __init__(self) -> None:
        self._marks: list[tuple[float, dict[int, int]]] = [(time.monotonic(), {})]

    def update(self, traffic: Traffic) -> dict[int, float]:
        """Rates since the oldest mark kept."""
        now_s = time.monotonic()
        counts = {key: heard.frames for key, heard in traffic.heard.items()}
        while len(self._marks) > 1 and now_s - self._marks[1][0] > RATE_WINDOW_S:
            self._marks.pop(0)
        since_s, before = self._marks[0]
        self._marks.append((now_s, counts))
        elapsed_s = max(now_s - since_s, 1e-3)
        return {key: (n - before.get(key, 0)) / elapsed_s for key, n in counts.items()}


def _value_text(signal: icd.Signal, value: float) -> str:
    """A name where the value has one, a checksum as its bytes, else as many digits as are sent."""
    digits = min(max(math.ceil(-math.log10(abs(signal.scale))), 0), DIGITS_MAX)
    text = dict(signal.names).get(round(value)) or f"{value:z.{digits}f}"
    if signal.name.endswith(CHECKSUM_SUFFIX):
        text = f"0x{round(value):0{signal.bits // 4}x}"
    return f"{signal.name} {text}"


def values_text(heard: Heard) -> str:
    """The first signals of the last frame, or the bytes of a foreign one."""
    if heard.message is None:
        return heard.data.hex(" ")
    values = heard.values()
    shown = [_value_text(s, values[s.name]) for s in heard.message.signals if s.name in values]
    more = ["..."] if len(shown) > VALUES_SHOWN else []
    return "  ".join(shown[:VALUES_SHOWN] + more)


def traffic_table(traffic: Traffic, rates: dict[int, float], bitrate_bps: int) -> Table:
    """All identifiers heard so far."""
    load = traffic.bits / traffic.elapsed_s / bitrate_bps
    table = Table(
        title=f"{traffic.frames} frames in {traffic.elapsed_s:z.1f} s",
        caption=f"{PERCENT * load:z.2f} % of {bitrate_bps} bit/s at worst; {traffic.errors.text}",
    )
    for heading in ("id", "message", "sender"):
        table.add_column(heading, no_wrap=True)
    for heading in ("frames", "Hz", "errors"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("last values")
    for key in sorted(traffic.heard):
        heard = traffic.heard[key]
        table.add_row(
            heard.can_id,
            heard.name or "(foreign)",
            heard.message.sender if heard.message else "",
            str(heard.frames),
            f"{rates.get(key, 0.0):z.1f}",
            str(heard.errors) if heard.message else "",
            values_text(heard),
        )
    return table


def show_live(bus: socket.socket, address: str, seconds: float, bitrate_bps: int) -> None:
    """A table on the terminal until the time is over or Ctrl-C; the last one stays."""
    traffic, rates = Traffic(), Rates()
    with Live(
        traffic_table(traffic, {}, bitrate_bps),
        console=result_console(),
        refresh_per_second=REFRESH_HZ,
        auto_refresh=False,
    ) as live:
        shown_s = 0.0
        try:
            for _ in listen(bus, traffic, address, seconds):
                if not is_heard():
                    return
                if time.monotonic() - shown_s >= 1.0 / REFRESH_HZ:
                    shown_s = time.monotonic()
                    table = traffic_table(traffic, rates.update(traffic), bitrate_bps)
                    live.update(table, refresh=True)
        except KeyboardInterrupt:
            return
        finally:
            final = {key: h.frames / traffic.elapsed_s for key, h in traffic.heard.items()}
            live.update(traffic_table(traffic, final, bitrate_bps), refresh=True)


def comparison_table(load: BusLoad, traffic: Traffic) -> Table:
    """What each message takes at worst beside what it took."""
    table = Table(title="Bus load, worst case and measured")
    for heading in ("id", "message", "sender"):
        table.add_column(heading)
    for heading in ("cycle ms", "Hz", "load %", "measured Hz", "measured %"):
        table.add_column(heading, justify="right")
    elapsed_s = traffic.elapsed_s
    left = dict(traffic.heard)
    for row in load.messages:
        heard = left.pop(row.can_id, Heard(row.can_id))
        table.add_row(
            f"0x{row.can_id:03X}",
            row.message,
            row.sender,
            str(row.cycle_ms) if row.cycle_ms else "event",
            f"{1e3 / row.cycle_ms:z.1f}" if row.cycle_ms else "",
            f"{PERCENT * row.load_ratio:z.3f}",
            f"{heard.frames / elapsed_s:z.1f}",
            f"{PERCENT * heard.bits / elapsed_s / load.bitrate_bps:z.3f}",
        )
    for heard in sorted(left.values(), key=lambda h: h.key):
        share = f"{PERCENT * heard.bits / elapsed_s / load.bitrate_bps:z.3f}"
        rate = f"{heard.frames / elapsed_s:z.1f}"
        table.add_row(heard.can_id, "(foreign)", "", "", "", "", rate, share)
    return table
