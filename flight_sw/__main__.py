"""`python -m flight_sw --load FILE --bus unix:PATH`: the flight computer by itself."""

import argparse
import sys
from pathlib import Path

from flight_sw.errors import AeroshellError


def main(arguments: list[str] | None = None) -> int:
    """Parse, boot, and turn a refusal into one sentence and exit status 1."""
    parser = argparse.ArgumentParser(
        prog="python -m flight_sw",
        description="Flight computer: serves a CAN bus until it is told to stop.",
    )
    parser.add_argument("--load", type=Path, required=True, help="load image to fly")
    parser.add_argument("--bus", required=True, help="unix:PATH or socketcan:INTERFACE")
    options = parser.parse_args(arguments)
    from flight_sw.boot import boot  # the compiler is slow to import: not for --help

    try:
        boot(options.load, options.bus)
    except AeroshellError as error:
        sys.stderr.write(f"flight computer: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
