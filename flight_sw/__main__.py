"""`python -m flight_sw --load FILE --bus unix:PATH`: the flight computer by itself."""

import argparse
import sys
from pathlib import Path

from flight_sw import program

PACE_LOW, PACE_HIGH = 0.01, 1000.0


def main(arguments: list[str] | None = None) -> int:
    """Parse and boot; a refusal is one sentence and exit status 1."""
    return program.run("flight computer", lambda: _boot(arguments))


def _boot(arguments: list[str] | None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m flight_sw",
        description="Flight computer: serves a CAN bus until it is told to stop.",
    )
    parser.add_argument("--load", type=Path, required=True, help="load image to fly")
    parser.add_argument("--bus", required=True, help="unix:PATH or socketcan:INTERFACE")
    parser.add_argument(
        "--synchronisation",
        choices=("lockstep", "frame", "clock"),
        default="lockstep",
        help="wait for frames without a clock, for frames no longer than they may take, "
        "or for deadlines of the clock (default: %(default)s)",
    )
    parser.add_argument(
        "--pace",
        type=float,
        default=1.0,
        metavar="FACTOR",
        help="mission seconds per second of the clock, 0.01 to 1000 (default: %(default)s)",
    )
    options = parser.parse_args(arguments)
    if not PACE_LOW <= options.pace <= PACE_HIGH:
        parser.error(f"--pace is {options.pace:g}, allowed {PACE_LOW:g} to {PACE_HIGH:g}")
    from flight_sw.boot import Timing, boot  # the compiler is slow to import: not for --help

    boot(options.load, options.bus, Timing(options.synchronisation, options.pace))
    return program.DONE


if __name__ == "__main__":
    sys.exit(main())
