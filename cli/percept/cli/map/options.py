"""Options that the commands of `percept map` share."""

from __future__ import annotations

from typing import Annotated

import typer

__all__ = ["OriginOption"]

OriginOption = Annotated[
    str | None,
    typer.Option(
        "--origin",
        metavar="LAT,LON[,ALT]",
        help="Where the map's frame lies: points are then placed east, north and up of it by "
        "latitude and longitude. Without it the map's own local coordinates or origin count.",
        show_default=False,
    ),
]
