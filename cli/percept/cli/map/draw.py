"""`percept map draw`: a map as a picture or as GeoJSON."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from percept.cli.map.options import OriginOption
from percept.core.errors import UsageError

if TYPE_CHECKING:
    from percept.hdmap import HdMap

__all__ = ["draw"]

_KINDS = (".png", ".svg", ".geojson")


def draw(
    map_file: Annotated[
        Path,
        typer.Argument(
            metavar="MAP",
            help="A Lanelet2 map (.osm), or an OpenDRIVE file (.xodr).",
            show_default=False,
        ),
    ],
    *,
    to: Annotated[
        Path,
        typer.Option("--to", help="The file to write: .png, .svg or .geojson.", show_default=False),
    ],
    size: Annotated[
        int, typer.Option("--size", min=200, max=8000, help="Longer side of a picture, pixels.")
    ] = 1600,
    origin: OriginOption = None,
    force: Annotated[bool, typer.Option("--force", help="Replace --to where it exists.")] = False,
) -> None:
    """Draw a map from above, or write it as GeoJSON of longitudes and latitudes.

    Paint is drawn in its colour, dashes as dashes, pairs as pairs; what is not painted in grey;
    arrows point in the driving direction.

    Example: percept demo --out demo && percept map draw demo/map.osm --to map.png
    """
    from percept.cli.track.maps import named_place
    from percept.hdmap import load_map

    if to.suffix.lower() not in _KINDS:
        raise UsageError(
            f"--to {to} is no .png, .svg or .geojson", remedy="Name the kind of file by its suffix"
        )
    is_the_map = to.exists() and map_file.exists() and to.samefile(map_file)
    if to.exists() and (is_the_map or not force or not to.is_file()):
        raise UsageError("exists", where=to, remedy="Name another file, or give --force")
    hd_map = load_map(map_file, named_place(origin), anywhere=True)
    _write(to, _content(hd_map, to.suffix.lower(), map_file.name, size))
    typer.echo(f"look at it: {to}")


def _content(hd_map: HdMap, kind: str, title: str, size: int) -> bytes:
    if kind == ".geojson":
        from percept.export.map_geojson import map_geojson

        return map_geojson(hd_map).encode()
    from percept.export.map_scene import map_scene

    scene = map_scene(hd_map, size)
    if kind == ".svg":
        from percept.export.map_drawing import map_svg

        return map_svg(scene, title).encode()
    from percept.export.map_drawing import map_png

    return map_png(scene, title)


def _write(path: Path, content: bytes) -> None:
    """Write a file that gets its name when it is whole."""
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        unfinished.write_bytes(content)
        unfinished.replace(path)
    except OSError as error:
        raise UsageError(f"cannot be written ({error.strerror})", where=path) from error
