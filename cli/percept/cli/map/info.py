"""`percept map info`: what a map holds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.map.options import OriginOption
from percept.cli.options import JsonOption

__all__ = ["info"]


def info(
    map_file: Annotated[
        Path,
        typer.Argument(
            metavar="MAP",
            help="A Lanelet2 map (.osm), or an OpenDRIVE file (.xodr) for its lane markings.",
            show_default=False,
        ),
    ],
    *,
    origin: OriginOption = None,
    as_json: JsonOption = False,
) -> None:
    """Say what a map holds: lanelets, lines by type and colour, lights, rules, where it lies.

    What could not be used, and what was assumed, is counted by reason. Elements that an editor
    has marked as deleted do not count.

    Example: percept demo --out demo && percept map info demo/map.osm
    """
    from percept.cli.map.info_show import show_summary
    from percept.cli.track.maps import named_place
    from percept.hdmap import load_map
    from percept.hdmap.summary import summarise_map

    summary = summarise_map(load_map(map_file, named_place(origin), anywhere=True))
    if as_json:
        typer.echo(json.dumps({"map": str(map_file), **summary}, indent=2, allow_nan=False))
    else:
        show_summary(map_file, summary)
