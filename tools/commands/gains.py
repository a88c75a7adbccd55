"""`aeroshell gains`: design the gains of a mission, or check that the stored ones regenerate."""

from typing import Annotated

import typer

from flight_sw.runtime.streams import say, tell


def gains(
    target: Annotated[
        str, typer.Argument(metavar="MISSION|DESIGN", help="a shipped mission, or a design.toml")
    ],
    check: Annotated[
        bool, typer.Option("--check", help="write nothing; exit 1 if what is stored differs")
    ] = False,
) -> None:
    """Design the gains of each law of a design.toml; write load images and provenance beside it.

    What is stored already and the same up to round-off stays as it is.
    """
    from flight_sw.load_image import parse_image
    from tools.gains.compare import compare, keep_or_write
    from tools.gains.image import design_path, image_path, make_all

    path = design_path(target)
    made_all = make_all(path)
    n_different = 0
    for made in made_all:
        verdict = compare(path.parent, made) if check else keep_or_write(path.parent, made)
        image = image_path(path.parent, made.law)
        raw = image.read_bytes() if verdict.is_kept else made.raw
        told = str(verdict)
        if not check:
            told = f"{verdict}, left as it is" if verdict.is_kept else "written"
        tell(f"{image}  crc32 0x{parse_image(raw, made.law).crc32:08x}  {len(raw)} bytes  {told}")
        n_different += not verdict.is_kept
    if check and n_different:
        count = f"{n_different} of {len(made_all)}"
        say(f"aeroshell: {count} load images differ from what {path} gives")
        raise typer.Exit(1)
