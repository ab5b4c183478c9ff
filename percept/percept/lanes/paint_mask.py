"""How much each place of the bird's-eye view looks like a line of paint.

A line of paint is a narrow ridge: brighter, or more yellow, than the road on both of its sides,
by the width that lines have. The contrast is taken of logarithms, so that a shadow or a
cloud does not change it, and must stand out of the contrasts around it, so that the grain of
concrete does not count. (The filter matched to the width: the symmetrical local threshold of Veit
et al. 2008, "Evaluation of road marking feature extraction".)
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.lanes.config import LaneConfig
from percept.lanes.road_grid import RoadGrid

__all__ = ["lightness", "paint_evidence", "ridge", "yellowness"]

_F32 = NDArray[np.float32]

_DARK = 12.0  # grey levels: below it, noise of the sensor is all that a logarithm shows
_LOGARITHMS = np.log(np.arange(256) + _DARK).astype(np.float32)
_AROUND_M = (6.0, 2.0)  # along and across: where the usual contrast is taken from


def lightness(image: NDArray[np.uint8]) -> _F32:
    """Return the logarithmic lightness (H, W) of an image (H, W, 3) BGR."""
    return np.asarray(cv2.LUT(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), _LOGARITHMS), np.float32)


def yellowness(image: NDArray[np.uint8]) -> _F32:
    """Return the logarithm (H, W) of red and green over blue of an image (H, W, 3) BGR."""
    blue, green, red = cv2.split(image)
    warm = cv2.LUT(cv2.min(green, red), _LOGARITHMS)
    return np.asarray(cv2.subtract(warm, cv2.LUT(blue, _LOGARITHMS)), np.float32)


def paint_evidence(
    warped: NDArray[np.uint8], grid: RoadGrid, config: LaneConfig, *, whole: bool
) -> _F32:
    """Return evidence (rows, columns) float32 0..1 of paint on the grid.

    Args:
        warped: (rows, columns, 3) uint8 BGR, the image on the grid.
        grid: The grid.
        config: Settings.
        whole: Whether to leave out paint that the border of the image cuts, whose middle is
            elsewhere. That matters for centimetres; for pixels a cut dash tells more than it
            misleads.
    """
    light, yellow = lightness(warped), yellowness(warped)
    best = np.zeros(light.shape, dtype=np.float32)
    for factor in (1.0, 2.0):
        width = grid.cells(config.line_width_m * factor)
        for values in (light, yellow):
            best = np.maximum(best, _standing_out(ridge(values, width, grid), grid, config))
    # Paint is a stroke along the road; a speck is not.
    along = np.asarray(cv2.blur(best, (1, grid.rows(1.0))), dtype=np.float32)
    usable = grid.inside
    if whole:
        border = np.ones((1, 2 * grid.cells(config.line_width_m) + 1), np.uint8)
        usable = cv2.erode(usable.astype(np.uint8), border) > 0
    evidence: _F32 = np.where(usable, np.minimum(best, 2 * along), 0).astype(np.float32)
    return evidence


def ridge(values: _F32, width: int, grid: RoadGrid) -> _F32:
    """Return by how much a middle of `width` columns is above both of its sides, or below zero."""
    side, gap = max(2, grid.cells(0.1)), grid.cells(0.04)
    middle = cv2.blur(values, (width, 1))
    flank = cv2.blur(values, (side, 1))
    shift = (width + 1) // 2 + gap + side // 2
    left, right = np.roll(flank, shift, axis=1), np.roll(flank, -shift, axis=1)
    found = np.asarray(middle - np.maximum(left, right), dtype=np.float32)
    found[:, :shift] = found[:, -shift:] = 0
    return found


def _standing_out(contrast: _F32, grid: RoadGrid, config: LaneConfig) -> _F32:
    size = (grid.cells(_AROUND_M[1]), grid.rows(_AROUND_M[0]))
    usual = cv2.blur(np.clip(np.abs(contrast), 0, 2 * config.contrast), size)
    least = np.maximum(config.contrast, config.noise * usual)
    return np.asarray(np.clip(contrast / least - 0.5, 0, 1), dtype=np.float32)
