"""Parts of images around boxes that changed, before and after, on one sheet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.clock import iso_from_ns
from percept.datasets.labelling.corrections.compare import ImageDiff, SetDiff
from percept.datasets.labelling.corrections.diff_figures import BoxChange, Change
from percept.datasets.labels.image_size import image_file_size
from percept.export.camera_pictures import jpeg_data_uri
from percept.export.canvas import (
    BACKGROUND,
    FIXED_SHIFT,
    Image,
    Rgb,
    as_bgr,
    blank,
    fixed_point,
    write_text,
)
from percept.export.report import Block, Picture, Table

__all__ = ["COLOURS", "MOST_PICTURES", "change_pictures"]

COLOURS: Mapping[str, Rgb] = {"A": (230, 159, 0), "B": (86, 180, 233)}
"""Orange and light blue: how the boxes of A and B are drawn."""

MOST_PICTURES = 16
"""Boxes on a sheet at most."""

_TILE_PX = (300, 225)
_GAP_PX = 6
_IN_A_ROW = 4
_AROUND = 0.6
_LEAST_PX = 72.0
_HEADER = ("no.", "in A", "in B", "from", "score", "IoU", "moved, px", "camera", "time")
_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Shown:
    image: ImageDiff
    change: BoxChange


def change_pictures(
    diff: SetDiff, folders: Sequence[Path], kind: Change
) -> tuple[tuple[Block, ...], int]:
    """Return a sheet of boxes with which one thing happened, and a table of them.

    The most telling come first: boxes that moved farthest by their size, the surest detections
    that were removed or got another class, the largest that were added.

    Args:
        diff: What differs.
        folders: Where the files of the images are looked for, in this order.
        kind: What happened.

    Returns:
        The sheet and the table, nothing where there are no such boxes; and how many there are.
    """
    found = [
        _Shown(image, change)
        for image in diff.images
        for change in image.changes
        if change.change is kind
    ]
    if not found:
        return (), 0
    shown = sorted(found, key=_telling)[:MOST_PICTURES]
    tiles = [_tile(one, folders, number) for number, one in enumerate(shown, 1)]
    rows = tuple((str(number), *_cells(one)) for number, one in enumerate(shown, 1))
    sheet = Picture(jpeg_data_uri(_sheet(tiles)), f"boxes that were {kind}, by their numbers")
    return (sheet, Table(_HEADER, rows)), len(found)


def _telling(one: _Shown) -> float:
    change = one.change
    if change.change is Change.MOVED:
        return change.iou
    if change.row_a is not None:
        return -float(np.nan_to_num(one.image.a.boxes.confidences[change.row_a], nan=-1.0))
    x1, y1, x2, y2 = one.image.b.boxes.boxes_px[change.row_b or 0]
    return -float((x2 - x1) * (y2 - y1))


def _sheet(tiles: Sequence[Image]) -> Image:
    """Return pictures of one size side by side, with gaps."""
    wide, tall = (side + _GAP_PX for side in _TILE_PX)
    rows = -(-len(tiles) // _IN_A_ROW)
    sheet = blank(_IN_A_ROW * wide - _GAP_PX, rows * tall - _GAP_PX)
    for place, tile in enumerate(tiles):
        row, column = divmod(place, _IN_A_ROW)
        top, left = row * tall, column * wide
        sheet[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return sheet


def _tile(one: _Shown, folders: Sequence[Path], number: int) -> Image:
    boxes = dict(_boxes(one))
    view, left, top, scale = _cut_out(one, np.array(list(boxes.values())), folders)
    for side, box in boxes.items():
        shown = (box - [left, top, left, top]) * scale
        near, far = fixed_point(shown.reshape(2, 2) - 0.5).tolist()
        for thickness, rgb in ((4, BACKGROUND), (2, COLOURS[side])):
            cv2.rectangle(view, near, far, rgb[::-1], thickness, cv2.LINE_AA, FIXED_SHIFT)
    write_text(view, str(number), (6, 16))
    return view


def _boxes(one: _Shown) -> Iterator[tuple[str, _F64]]:
    if one.change.row_a is not None:
        yield "A", one.image.a.boxes.boxes_px[one.change.row_a]
    if one.change.row_b is not None:
        yield "B", one.image.b.boxes.boxes_px[one.change.row_b]


def _cut_out(
    one: _Shown, boxes: _F64, folders: Sequence[Path]
) -> tuple[Image, float, float, float]:
    """Return the image around boxes (N, 4), where its left and top are, and its scale."""
    width, height = _TILE_PX
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    wide, tall = np.maximum((high - low) * (1 + 2 * _AROUND), _LEAST_PX)
    scale = min(width / wide, height / tall)
    left, top = (low + high) / 2 - np.array([width, height]) / (2 * scale)
    pixels = _pixels(one, folders)
    if pixels is None:
        return blank(width, height), float(left), float(top), float(scale)
    # Pixels count from the centre of the first one, boxes from its edge.
    move = np.array(
        [[scale, 0, 0.5 * (scale - 1) - left * scale], [0, scale, 0.5 * (scale - 1) - top * scale]]
    )
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    view = cv2.warpAffine(pixels, move, (width, height), flags=how, borderValue=BACKGROUND[::-1])
    return np.asarray(view, np.uint8), float(left), float(top), float(scale)


def _pixels(one: _Shown, folders: Sequence[Path]) -> Image | None:
    """Return the image, if a file of its name and size is in one of the folders."""
    for folder in folders:
        file = folder / one.image.a.file
        if image_file_size(file) == one.image.a.image_size:
            pixels = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
            if pixels is not None:
                return as_bgr(pixels[..., :3])
    return None


def _cells(one: _Shown) -> tuple[str, ...]:
    image, change = one.image, one.change
    before = after = source = sure = ""
    if change.row_a is not None:
        before, source = image.a.boxes.labels[change.row_a], image.a.boxes.sources[change.row_a]
        sure = _number(image.a.boxes.confidences[change.row_a], 2)
    if change.row_b is not None:
        after = image.b.boxes.labels[change.row_b]
    return (
        before, after, source, sure, _number(change.iou, 2), _number(change.shift, 1),
        image.a.camera, iso_from_ns(image.a.stamp_ns),
    )  # fmt: skip


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else ""
