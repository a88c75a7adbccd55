"""`aeroshell bus`: the bus by itself."""

import dataclasses
import json
import signal
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from sim_harness.bus.hub import Hub, HubStats
from sim_harness.bus.load_model import BITRATE_BPS, LOAD_LIMIT, BusLoad, bus_load

REFUSED = 1
BITRATE_MIN_BPS, BITRATE_MAX_BPS = 10_000, 1_000_000  # of classical CAN
END_SIGNALS = (signal.SIGINT, signal.SIGTERM)
PERCENT = 100.0

app = typer.Typer(help="The CAN bus between harness and flight computer.", no_args_is_help=True)


def _wait_for_end() -> None:
    """Return at Ctrl-C or SIGTERM; the signals stay blocked, so that a second one ends nothing."""
    signal.sigwait(END_SIGNALS)


def _print_statistics(stats: HubStats) -> None:
    print(f"clients connected  {stats.connections}")
    print(f"frames received    {stats.frames_received}")
    print(f"frames delivered   {stats.frames_sent}")
    print(f"frames dropped     {stats.frames_dropped}  (a client did not read)")
    print(f"packets refused    {stats.packets_refused}  (not of 16 bytes)")


@app.command()
def hub(
    path: Annotated[Path, typer.Argument(help="socket file to create")],
    prompt: Annotated[
        bool,
        typer.Option(help="Serve the first frame of a burst at once, for flights in real time."),
    ] = True,
) -> None:
    """Run a bus on PATH until Ctrl-C or SIGTERM, then print what it moved."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, END_SIGNALS)
    try:
        with Hub(path, prompt=prompt) as running:
            print(f"bus on {path}, Ctrl-C ends it", file=sys.stderr, flush=True)
            _wait_for_end()
            stats = running.stats
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    _print_statistics(stats)


def _verdict(load: BusLoad) -> str:
    verdict = "below" if load.is_within_limit else "NOT below"
    return (
        f"{PERCENT * load.total_ratio:.2f} % of {load.bitrate_bps} bit/s at worst, "
        f"{verdict} the limit of {PERCENT * LOAD_LIMIT:.0f} %"
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
            f"{PERCENT * row.load_ratio:.3f}",
        )
    Console().print(table)
    print(_verdict(load))


def _as_json(load: BusLoad) -> str:
    summary = {
        "bitrate_bps": load.bitrate_bps,
        "limit_ratio": LOAD_LIMIT,
        "total_ratio": load.total_ratio,
        "within_limit": load.is_within_limit,
        "messages": [dataclasses.asdict(message) for message in load.messages],
    }
    return json.dumps(summary, indent=2)


@app.command()
def load(
    bitrate_bps: Annotated[
        int, typer.Option(min=BITRATE_MIN_BPS, max=BITRATE_MAX_BPS, help="speed of the bus")
    ] = BITRATE_BPS,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Print what each message takes of the bus at worst; exit 1 at or above 50 %."""
    of_bus = bus_load(bitrate_bps)
    if as_json:
        print(_as_json(of_bus))
    else:
        _print_table(of_bus)
    if not of_bus.is_within_limit:
        raise typer.Exit(REFUSED)
