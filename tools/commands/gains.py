"""`aeroshell gains`: design the gains of a mission, or check that the stored ones regenerate."""

from typing import Annotated

import typer

from flight_sw.streams import say, tell


def gains(
    target: Annotated[
        str, typer.Argument(metavar="MISSION|DESIGN", help="a shipped mission, or a design.toml")
    ],
    check: Annotated[
        bool, typer.Option("--check", help="write nothing; exit 1 if what is stored differs")
    ] = False,
) -> None:
    """Design the gains of each law of a design.toml; write load images and provenance beside it."""
    from tools.gains.image import design_path, differences, image_path, make_all, write

    path = design_path(target)
    found = []
    for made in make_all(path):
        if check:
            found += differences(path.parent, made)
        else:
            write(path.parent, made)
        tell(
            f"{image_path(path.parent, made.law)}  crc32 0x{made.crc32:08x}  {len(made.raw)} bytes"
        )
    for difference in found:
        say(f"aeroshell: {difference}")
    if found:
        raise typer.Exit(1)
