"""Tiles of an image for small far objects, and one list of boxes from all of them.

A network sees an image at its own input size; a car of 12 pixels in a wide image becomes one of 4.
Cut into tiles that overlap, the image keeps its detail (sliced inference: Akyon, Altinuc and
Temizel, ICIP 2022). The whole image is looked at too, for what is larger than a tile.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from percept.detection.boxes.found import FoundBoxes

__all__ = ["Region", "join_regions", "regions_of"]

Region = tuple[int, int, int, int]

_MOSTLY_INSIDE = 0.7  # of a cut box, in another box, for it to be a part of that object
# A box of an object that a border cuts ends this near to it: input pixels, and a share of the box.
_CUT_WITHIN_PX = 4.0
_CUT_WITHIN_SHARE = 0.1


def regions_of(image_size: tuple[int, int], tiles: tuple[int, int], overlap: float) -> list[Region]:
    """Return the whole image and its tiles as x1, y1, x2, y2 in pixels.

    Args:
        image_size: (width, height), pixels.
        tiles: (columns, rows); (1, 1) gives the whole image only.
        overlap: Share of a tile that it has in common with its neighbour, 0 to below 1.
    """
    whole = (0, 0, *image_size)
    if tiles == (1, 1):
        return [whole]
    columns, rows = (
        _spans(length, count, overlap) for length, count in zip(image_size, tiles, strict=True)
    )
    cut = [(x1, y1, x2, y2) for y1, y2 in rows for x1, x2 in columns]
    return [whole, *(tile for tile in cut if tile != whole)]


def _spans(length: int, count: int, overlap: float) -> list[tuple[int, int]]:
    """Return equal spans that cover a length, neighbours sharing a part; fewer on tiny images."""
    size = int(np.ceil(length / (count - (count - 1) * overlap)))
    starts = np.linspace(0, length - size, count).round().astype(int)
    return sorted({(int(start), int(start) + size) for start in starts})


def join_regions(
    parts: Sequence[FoundBoxes],
    regions: Sequence[Region],
    gains: Sequence[float],
    image_size: tuple[int, int],
) -> FoundBoxes:
    """Join what was found in the regions of one image; duplicates are not suppressed yet.

    A box that a tile's border cuts goes where another region shows more of its object, under
    whatever class: half a car may be taken for a truck, and an object in front of another is seen
    whole by the next tile. What no other region shows more of stays, cut as it is.

    Args:
        parts: What was found in each region, in pixels of the region.
        regions: The regions.
        gains: Input pixels an image pixel, by region: the unit in which a box ends at a border.
        image_size: (width, height), pixels.
    """
    if len(parts) == 1:
        return parts[0]
    placed = [
        FoundBoxes(part.boxes_px + region[:2] * 2, part.class_ids, part.scores)
        for part, region in zip(parts, regions, strict=True)
    ]
    found = FoundBoxes.joined(placed)
    cut = np.concatenate(
        [
            _cut_at_borders(part.boxes_px, region, image_size, _CUT_WITHIN_PX / gain)
            for part, region, gain in zip(placed, regions, gains, strict=True)
        ]
    )
    numbers = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return found.select(~_parts_of_others(found, numbers, cut))


def _cut_at_borders(
    boxes_px: NDArray[np.float64], region: Region, image_size: tuple[int, int], within_px: float
) -> NDArray[np.bool_]:
    """Tell which boxes end at a border of their region that is none of the image."""
    borders = np.array(region, dtype=np.float64)
    inner = borders != (0, 0, *image_size)
    inward = np.array([1, 1, -1, -1]) * (boxes_px - borders)
    sizes = np.tile(boxes_px[:, 2:] - boxes_px[:, :2], 2)
    near = inward <= within_px + _CUT_WITHIN_SHARE * sizes
    cut: NDArray[np.bool_] = (near & inner).any(axis=1)
    return cut


def _parts_of_others(
    found: FoundBoxes, numbers: NDArray[np.int64], cut: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Tell which cut boxes lie mostly in a larger box from another region."""
    boxes = found.boxes_px
    areas = (boxes[:, 2:] - boxes[:, :2]).clip(0).prod(axis=1)
    is_part = np.zeros(len(found), np.bool_)
    for i in np.flatnonzero(cut):
        low = np.maximum(boxes[i, :2], boxes[:, :2])
        high = np.minimum(boxes[i, 2:], boxes[:, 2:])
        shared = (high - low).clip(0).prod(axis=1)
        holds = (shared >= _MOSTLY_INSIDE * areas[i]) & (areas > areas[i])
        is_part[i] = (holds & (numbers != numbers[i])).any()
    return is_part
