"""`aeroshell bus`: the bus by itself."""

import dataclasses
import json
import math
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from flight_sw.can.address import open_bus
from flight_sw.runtime.streams import say, tell
from sim_harness.bus.hub import Hub, HubStats
from sim_harness.bus.load_model import BITRATE_BPS, LOAD_LIMIT, BusLoad, bus_load
from sim_harness.bus.traffic import Traffic, listen, traffic_as_json
from tools.can_interface import check_name, commands_to_run, is_up, raise_interface
from tools.console import show
from tools.monitor import comparison_table, show_live

REFUSED = 1
BITRATE_MIN_BPS, BITRATE_MAX_BPS = 10_000, 1_000_000  # of classical CAN
END_SIGNALS = (signal.SIGINT, signal.SIGTERM)
PERCENT = 100.0

BitRate = Annotated[
    int, typer.Option(min=BITRATE_MIN_BPS, max=BITRATE_MAX_BPS, help="speed of the bus")
]

app = typer.Typer(help="The CAN bus between harness and flight computer.", no_args_is_help=True)


@contextmanager
def _end_signals() -> Iterator[threading.Event]:
    """Ctrl-C and SIGTERM set an event here, so that a second one ends nothing.

    They are not blocked and waited for: a library's thread, which blocks none, would be ended.
    """
    over = threading.Event()
    before = {number: signal.signal(number, lambda *_: over.set()) for number in END_SIGNALS}
    try:
        yield over
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _print_statistics(stats: HubStats) -> None:
    tell(f"clients connected  {stats.connections}")
    tell(f"frames received    {stats.frames_received}")
    tell(f"frames delivered   {stats.frames_sent}")
    tell(f"frames dropped     {stats.frames_dropped}  (a client did not read)")
    tell(f"packets refused    {stats.packets_refused}  (not of 16 bytes)")
    tell(f"clients refused    {stats.clients_refused}  (of other users, or one too many)")


@app.command()
def hub(
    path: Annotated[Path, typer.Argument(help="socket file to create")],
    prompt: Annotated[
        bool,
        typer.Option(help="Serve the first frame of a burst at once, for flights in real time."),
    ] = True,
) -> None:
    """Run a bus on PATH until Ctrl-C or SIGTERM, then print what it moved."""
    with _end_signals() as over, Hub(path, prompt=prompt, tell=say) as running:
        say(f"bus on {path}, Ctrl-C ends it")
        over.wait()
        stats = running.stats
    _print_statistics(stats)


def _verdict(load: BusLoad) -> str:
    verdict = "below" if load.is_within_limit else "NOT below"
    return (
        f"{PERCENT * load.total_ratio:z.2f} % of {load.bitrate_bps} bit/s at worst, "
        f"{verdict} the limit of {PERCENT * LOAD_LIMIT:z.0f} %"
    )


def _print_table(load: BusLoad) -> None:
    table = Table(title="Worst-case bus load")
    for heading in ("id", "message", "sender"):
        table.add_column(heading)
    for heading in ("cycle ms", "bits a frame", "load %"):
        table.add_column(heading, justify="right")
    for row in load.messages:
        table.add_row(
            f"0x{row.can_id:03X}",
            row.message,
            row.sender,
            str(row.cycle_ms) if row.cycle_ms else "event",
            str(row.frame_bits),
            f"{PERCENT * row.load_ratio:z.3f}",
        )
    show(table)
    tell(_verdict(load))


def _as_json(load: BusLoad) -> dict[str, Any]:
    return {
        "bitrate_bps": load.bitrate_bps,
        "limit_ratio": LOAD_LIMIT,
        "total_ratio": load.total_ratio,
        "within_limit": load.is_within_limit,
        "messages": [dataclasses.asdict(message) for message in load.messages],
    }


def _measure(address: str, seconds: float, bitrate_bps: int) -> tuple[Traffic, dict[str, Any]]:
    """Listen for so long; the traffic and its account for scripts, taken at the same moment."""
    with open_bus(address) as bus:
        traffic = Traffic()
        for _ in listen(bus, traffic, address, seconds):
            pass
        return traffic, traffic_as_json(traffic, address, bitrate_bps, bus)


@app.command()
def load(
    bitrate_bps: BitRate = BITRATE_BPS,
    measure: Annotated[
        str | None, typer.Option(metavar="BUS", help="a bus to listen to and to compare with")
    ] = None,
    seconds: Annotated[float, typer.Option(min=0.1, help="how long to listen")] = 5.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Print what each message takes of the bus at worst; exit 1 at or above 50 %."""
    of_bus = bus_load(bitrate_bps)
    summary = _as_json(of_bus)
    traffic: Traffic | None = None
    if measure is not None:
        traffic, summary["measured"] = _measure(measure, seconds, bitrate_bps)
    if as_json:
        tell(json.dumps(summary, indent=2))
    elif traffic is None:
        _print_table(of_bus)
    else:
        show(comparison_table(of_bus, traffic))
        tell(_verdict(of_bus))
        tell(f"{PERCENT * summary['measured']['load_ratio']:z.2f} % measured on {measure}")
    if not of_bus.is_within_limit:
        raise typer.Exit(REFUSED)


@app.command()
def monitor(
    bus: Annotated[str, typer.Argument(help="unix:PATH or socketcan:INTERFACE")],
    seconds: Annotated[
        float | None, typer.Option(min=0.1, help="how long to listen [default: until Ctrl-C]")
    ] = None,
    bitrate_bps: BitRate = BITRATE_BPS,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object at the end.")] = (
        False
    ),
) -> None:
    """Show what goes over BUS: each message's rate, last values and errors."""
    duration_s = math.inf if seconds is None else seconds
    if as_json:
        tell(json.dumps(_measure(bus, duration_s, bitrate_bps)[1], indent=2))
        return
    with open_bus(bus) as listening:
        show_live(listening, bus, duration_s, bitrate_bps)


@app.command()
def up(
    interface: Annotated[str, typer.Argument(help="CAN interface; vcan... is made if need be")],
) -> None:
    """Make and raise a CAN interface; where that is not permitted, print the commands, exit 1."""
    check_name(interface)
    if is_up(interface):
        raise_interface(interface)  # refuses what is no CAN interface
        tell(f"{interface} is up already")
        return
    if failure := raise_interface(interface):
        say(f"{interface} could not be raised: {failure}. To be run by hand:")
        for line in commands_to_run(interface):
            tell(line)
        raise typer.Exit(REFUSED)
    tell(f"{interface} is up: --bus socketcan:{interface}")
