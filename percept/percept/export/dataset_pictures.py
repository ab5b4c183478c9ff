"""Grids of images for the report of a data set: chosen ones with boxes, and those left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from percept.core.clock import seconds_from_ns
from percept.datasets.labelling.dropped import DroppedFrame, drop_counts
from percept.datasets.labelling.labelled_set import SPLITS, Keyframe, LabelledFrame, LabelledSet
from percept.export.canvas import FIXED_SHIFT, Image, Rgb, blank, fixed_point, resized
from percept.export.palette import class_colours
from percept.export.picture_grid import Tile, picture_grid

__all__ = ["Grid", "chosen_pictures", "dropped_pictures"]

_CHOSEN = 12
_DROPPED = 6
_COLUMNS = 3
_WIDTH_PX = 300
_PAIR_GAP_PX = 6

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Images side by side.

    Attributes:
        picture: (H, W, 3) uint8 BGR.
        shown: How many images are in it.
        count: How many there are.
    """

    picture: Image
    shown: int
    count: int


def chosen_pictures(labelled: LabelledSet) -> dict[str, Grid]:
    """Return by split the images of a set with their boxes, a dozen spread evenly.

    An image that cannot be read is left out.
    """
    colours = class_colours(labelled.categories)
    grids: dict[str, Grid] = {}
    for split in SPLITS:
        frames = [both for both in labelled.frames() if both[0].split == split]
        tiles = [_chosen(labelled, *both, colours) for both in _spread(frames, _CHOSEN)]
        _keep(grids, split, tiles, len(frames))
    return grids


def dropped_pictures(dropped: Sequence[DroppedFrame], folder: Path) -> dict[str, Grid]:
    """Return by reason images that were left out, as far as their pictures are there.

    A duplicate stands on the right of what it repeats.

    Args:
        dropped: All that was left out.
        folder: Folder of the set, which `DroppedFrame.of` is relative to.
    """
    grids: dict[str, Grid] = {}
    for reason, count in drop_counts(dropped).items():
        alike = [one for one in dropped if one.reason == reason and one.picture is not None]
        tiles = [_left_out(one, folder) for one in _spread(alike, _DROPPED)]
        _keep(grids, reason, tiles, count)
    return grids


def _keep(grids: dict[str, Grid], name: str, tiles: Sequence[Tile | None], count: int) -> None:
    there = [tile for tile in tiles if tile is not None]
    if there:
        grids[name] = Grid(
            picture_grid(there, columns=_COLUMNS, width_px=_WIDTH_PX), len(there), count
        )


def _spread(items: Sequence[_T], most: int) -> list[_T]:
    """Return items evenly from the first to the last."""
    places = np.linspace(0, len(items) - 1, min(most, len(items))).astype(int)
    return [items[place] for place in places.tolist()]


def _chosen(
    labelled: LabelledSet, keyframe: Keyframe, frame: LabelledFrame, colours: Mapping[str, Rgb]
) -> Tile | None:
    picture = _small(labelled.folder / frame.file)
    if picture is None:
        return None
    boxes = frame.boxes
    scale = picture.shape[1] / frame.image_size[0]
    corners = fixed_point(boxes.boxes_px * scale - 0.5).reshape(-1, 2, 2).tolist()
    for (top_left, bottom_right), label in zip(corners, boxes.labels, strict=True):
        bgr = colours[label][::-1]
        cv2.rectangle(picture, top_left, bottom_right, bgr, 1, cv2.LINE_AA, FIXED_SHIFT)
    start_ns = labelled.drives[keyframe.drive].start_ns
    at_s = seconds_from_ns(frame.stamp_ns - start_ns)
    more = f"{at_s:.1f} s, {len(boxes)} boxes, for {keyframe.reason}"
    return Tile(picture, f"{keyframe.drive} {frame.camera}", more)


def _left_out(one: DroppedFrame, folder: Path) -> Tile | None:
    picture = None if one.picture is None else _small(one.picture)
    if picture is None:
        return None
    more = f"stamp {one.stamp_ns} ns"
    repeated = _small(folder / one.of) if one.of else None
    if repeated is not None:
        picture = _side_by_side(repeated, picture)
        more = f"repeats {Path(one.of).stem}"
    return Tile(picture, f"{one.drive} {one.camera}", more)


def _small(path: Path) -> Image | None:
    """Return an image of a file, as wide as a tile; None where there is none."""
    try:
        content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except OSError:
        return None
    if not len(content):
        return None
    pixels = cv2.imdecode(content, cv2.IMREAD_COLOR)
    if pixels is None:
        return None
    return resized(np.asarray(pixels, dtype=np.uint8), _WIDTH_PX / pixels.shape[1])


def _side_by_side(left: Image, right: Image) -> Image:
    height = max(left.shape[0], right.shape[0])
    pair = blank(left.shape[1] + _PAIR_GAP_PX + right.shape[1], height)
    pair[: left.shape[0], : left.shape[1]] = left
    pair[: right.shape[0], left.shape[1] + _PAIR_GAP_PX :] = right
    return pair
