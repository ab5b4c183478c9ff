"""Many small pictures in one, each with a line of text below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from percept.export.canvas import QUIET, TEXT, Image, blank, resized, text_width, write_text

__all__ = ["Tile", "picture_grid"]

_GAP = 8
_LINE = 17
_LEAST = "..."


@dataclass(frozen=True, slots=True, eq=False)
class Tile:
    """A small picture.

    Attributes:
        picture: (H, W, 3) uint8 BGR.
        caption: Line below it; what does not fit is left out in its middle.
        more: Second line, set quietly; empty for none.
    """

    picture: Image
    caption: str
    more: str = ""


def picture_grid(tiles: Sequence[Tile], *, columns: int = 4, width_px: int = 300) -> Image:
    """Return pictures beside and below each other, each made as wide as the others.

    Args:
        tiles: The pictures, row by row.
        columns: How many stand side by side.
        width_px: Width of each.

    Returns:
        (H, W, 3) uint8 BGR.
    """
    across = min(columns, max(len(tiles), 1))
    rows = [_row(tiles[at : at + across], across, width_px) for at in range(0, len(tiles), across)]
    return np.concatenate(rows) if rows else blank(width_px, _LINE)


def _row(tiles: Sequence[Tile], across: int, width_px: int) -> Image:
    pictures = [resized(tile.picture, width_px / tile.picture.shape[1]) for tile in tiles]
    tallest = max(picture.shape[0] for picture in pictures)
    lines = 1 + any(tile.more for tile in tiles)
    row = blank(across * (width_px + _GAP) + _GAP, tallest + _GAP + lines * _LINE + _GAP // 2)
    for place, (tile, picture) in enumerate(zip(tiles, pictures, strict=True)):
        left = _GAP + place * (width_px + _GAP)
        height, width = picture.shape[:2]
        row[_GAP : _GAP + height, left : left + width] = picture
        base = _GAP + tallest + 13
        write_text(row, _fitted(tile.caption, width_px), (left, base), TEXT)
        if tile.more:
            write_text(row, _fitted(tile.more, width_px), (left, base + _LINE), QUIET)
    return row


def _fitted(text: str, width_px: int) -> str:
    """Return a text that is no wider; its ends say most, so its middle goes."""
    kept = len(text)
    short = text
    while kept > 1 and text_width(short) > width_px:
        kept -= 1
        half = kept // 2
        short = f"{text[: kept - half]}{_LEAST}{text[-half:] if half else ''}"
    return short
