"""Regions of images that nobody may recognise: found by whoever is given, and made unreadable.

A region is left with a handful of coarse colours, so that there is nothing to restore: mosaics of
sixteen and more tiles a side still let networks tell faces (McPherson, Shokri, Shmatikov,
"Defeating Image Obfuscation with Deep Learning", 2016), and a mosaic of fine values lets one try
all number plates until one fits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from percept.core.errors import GeometryError

__all__ = ["Anonymised", "Anonymiser", "RegionFinder", "blur_regions"]

RegionFinder = Callable[[NDArray[Any]], NDArray[np.float64]]
"""Takes an image as `CameraImage.pixels`; returns boxes (N, 4) x1, y1, x2, y2 in its pixels."""

_MARGIN = 0.15
"""Of a region's sides, added on each side: detectors' boxes end at the chin and the hair."""
_LEAST_MARGIN_PX = 2
_MOST_TILES = 4
"""Along the longer side of a region."""
_LEVELS = 16
"""That a tile's colour can have, between black and white; white is the brightest pixel for
images of more than 8 bits."""


@dataclass(frozen=True, slots=True, eq=False)
class Anonymised:
    """An image in which regions are unreadable.

    Attributes:
        pixels: The image, of the shape and dtype of the one that was given; that one itself where
            nothing was found.
        regions_px: By kind, such as `faces`: boxes (N, 4) as they were found, before the margin.
    """

    pixels: NDArray[Any]
    regions_px: Mapping[str, NDArray[np.float64]]

    @property
    def counts(self) -> dict[str, int]:
        """Number of regions by kind; kinds of which none was found are there with 0."""
        return {kind: len(boxes) for kind, boxes in self.regions_px.items()}


@dataclass(frozen=True, slots=True)
class Anonymiser:
    """Finds regions and makes them unreadable; several threads may use it at once.

    Attributes:
        finders: By what they find, such as `faces`.
    """

    finders: Mapping[str, RegionFinder]

    def anonymise(self, pixels: NDArray[Any]) -> Anonymised:
        """Return an image without what the finders find in it.

        Every finder sees the image as it was given, so that the order is of no matter.

        Args:
            pixels: (H, W) or (H, W, 3); uint8, uint16 or float32. It is not changed.

        Raises:
            GeometryError: If it is no image, or a finder returns no boxes.
        """
        regions = {kind: _boxes(find(pixels)) for kind, find in self.finders.items()}
        return Anonymised(blur_regions(pixels, np.vstack([_boxes(()), *regions.values()])), regions)


def blur_regions(pixels: NDArray[Any], boxes_px: ArrayLike) -> NDArray[Any]:
    """Return an image in which regions keep a few coarse colours and nothing else.

    Each box grows by a margin and becomes a mosaic of four tiles along its longer side at most,
    so that the blur grows with the box; colours go to sixteen levels; tiles run into each other.
    The same image and boxes give the same pixels.

    Args:
        pixels: (H, W) or (H, W, 3); uint8, uint16 or float32. It is not changed.
        boxes_px: (N, 4) x1, y1, x2, y2. What lies outside the image is left out.

    Returns:
        A new image of the same shape and dtype; the given one where there is no box.

    Raises:
        GeometryError: If it is no image, or a box is not finite or the wrong way round.
    """
    if pixels.ndim not in (2, 3) or 0 in pixels.shape:
        raise GeometryError(f"an image is (H, W) or (H, W, 3), not {pixels.shape}")
    boxes = _boxes(boxes_px)
    if not len(boxes):
        return pixels
    blurred = pixels.copy()
    white = 255.0 if pixels.dtype == np.uint8 else float(pixels.max())
    for x1, y1, x2, y2 in _with_margin(boxes, (pixels.shape[1], pixels.shape[0])):
        region = blurred[y1:y2, x1:x2]
        if region.size:
            region[...] = _unreadable(region, white)
    return blurred


def _boxes(boxes_px: ArrayLike) -> NDArray[np.float64]:
    boxes = np.asarray(boxes_px, np.float64)
    boxes = boxes.reshape(-1, 4) if boxes.size == 0 else boxes
    if boxes.ndim != 2 or boxes.shape[1] != 4 or not np.isfinite(boxes).all():
        raise GeometryError(f"regions are (N, 4) finite numbers, not {boxes.shape}")
    if np.any(boxes[:, 2:] < boxes[:, :2]):
        raise GeometryError("a region has its corners the wrong way round")
    return boxes


def _with_margin(boxes: NDArray[np.float64], image_size: tuple[int, int]) -> NDArray[np.int64]:
    """Return boxes (N, 4) with their margin in whole pixels, cut at the border of the image."""
    margin = np.maximum((boxes[:, 2:] - boxes[:, :2]) * _MARGIN, _LEAST_MARGIN_PX)
    grown = np.hstack([np.floor(boxes[:, :2] - margin), np.ceil(boxes[:, 2:] + margin)])
    whole: NDArray[np.int64] = np.clip(grown, 0, [*image_size, *image_size]).astype(np.int64)
    return whole


def _unreadable(region: NDArray[Any], white: float) -> NDArray[Any]:
    height, width = region.shape[:2]
    tile_px = max(width, height) / _MOST_TILES
    size = (max(1, round(width / tile_px)), max(1, round(height / tile_px)))
    tiles = cv2.resize(region.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    step = max(white, 1e-12) / (_LEVELS - 1)
    coarse = np.round(tiles / step) * step
    smooth = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)
    if np.issubdtype(region.dtype, np.integer):
        smooth = np.clip(np.round(smooth), 0, np.iinfo(region.dtype).max)
    result: NDArray[Any] = smooth.reshape(region.shape).astype(region.dtype)
    return result
