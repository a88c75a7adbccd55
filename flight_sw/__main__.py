"""`python -m flight_sw --load FILE --bus unix:PATH`: the flight computer by itself."""

import argparse
import math
import sys
from pathlib import Path

from flight_sw.runtime import program
from flight_sw.timing import (
    PACE_HIGH,
    PACE_LOW,
    SILENCE_TIMEOUT_S,
    TIMEOUT_LOW_S,
    Timing,
)


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
    parser.add_argument(
        "--silence-timeout-s",
        type=float,
        default=SILENCE_TIMEOUT_S,
        metavar="S",
        help="end once armed and without a frame from a harness for so long by the clock, "
        "1 or more, inf: never (default: %(default)s)",
    )
    parser.add_argument(
        "--waiting-timeout-s",
        type=float,
        default=math.inf,
        metavar="S",
        help="the same before it is armed (default: %(default)s)",
    )
    options = parser.parse_args(arguments)
    for name in ("silence_timeout_s", "waiting_timeout_s"):
        if not getattr(options, name) >= TIMEOUT_LOW_S:
            parser.error(
                f"--{name.replace('_', '-')} is {getattr(options, name):g}, "
                f"allowed {TIMEOUT_LOW_S:g} or more"
            )
    if not PACE_LOW <= options.pace <= PACE_HIGH:
        parser.error(f"--pace is {options.pace:g}, allowed {PACE_LOW:g} to {PACE_HIGH:g}")
    from flight_sw.boot import boot  # the compiler is slow to import: not for --help

    timing = Timing(
        options.synchronisation,
        options.pace,
        options.silence_timeout_s,
        options.waiting_timeout_s,
    )
    boot(options.load, options.bus, timing)
    return program.DONE


if __name__ == "__main__":
    sys.exit(main())
