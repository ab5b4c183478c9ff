"""Where paint would have been seen, and why not elsewhere."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.lane_markings import GroundCoverage, Sight
from percept.core.sight_lines import is_hidden
from percept.lanes.birdseye import BirdsEye
from percept.lanes.paint_config import PaintConfig

__all__ = ["ground_coverage"]

_F64 = NDArray[np.float64]
_CELL_M = 0.25
_MARGIN_M = 0.1
# A box that is both is an outline about walls and hedges, and shades less than it spans; a lorry,
# a bus or a straight wall is long alone.
_LONGEST_M, _WIDEST_M = 15.0, 3.5
_SATURATED = 252.0


def ground_coverage(
    view: BirdsEye, warped: NDArray[np.uint8], occluders_m: _F64, config: PaintConfig
) -> GroundCoverage:
    """Return which places around the vehicle an image shows well enough.

    Args:
        view: The view from above.
        warped: (rows, columns, 3) uint8 BGR, the image in it.
        occluders_m: (M, 7) boxes in the vehicle's frame.
        config: Settings.
    """
    grid = view.grid
    rows = max(round((grid.x_m[1] - grid.x_m[0]) / _CELL_M), 1)
    columns = max(round((grid.y_m[1] - grid.y_m[0]) / _CELL_M), 1)
    corner = (grid.x_m[0], grid.y_m[0])
    i, j = np.mgrid[0:rows, 0:columns]
    points = np.column_stack(
        [corner[0] + (i.ravel() + 0.5) * _CELL_M, corner[1] + (j.ravel() + 0.5) * _CELL_M]
    )
    places = np.rint(grid.cells(points)).astype(np.intp)
    places = np.clip(places, 0, np.array(grid.shape) - 1)
    at = (places[:, 0], places[:, 1])
    sights = np.full(len(points), np.uint8(Sight.SEEN))
    gray = cv2.blur(cv2.cvtColor(warped, cv2.COLOR_BGR2GRAY).astype(np.float32), (9, 3))
    brightness = gray[at]
    sights[(brightness < config.darkest) | (brightness > _SATURATED)] = Sight.TOO_DARK
    across, _ = view.footprint_m
    sights[across[at] > config.coarsest_m] = Sight.TOO_FAR
    sights[np.hypot(points[:, 0], points[:, 1]) > config.reach_m] = Sight.TOO_FAR
    seen = np.flatnonzero(sights == Sight.SEEN)
    on_ground = np.column_stack([points[seen], view.ground.height(points[seen])])
    hidden = is_hidden(view.eye_m, on_ground, _that_hide(occluders_m))
    sights[seen[hidden]] = Sight.OCCLUDED
    sights[~view.seen[at]] = Sight.OUT_OF_VIEW
    return GroundCoverage(corner, _CELL_M, sights.reshape(rows, columns))


def _that_hide(boxes_m: _F64) -> _F64:
    """Return the boxes that can hide the road, a little larger."""
    boxes: _F64 = np.array(boxes_m, dtype=np.float64).reshape(-1, 7)
    sides = np.sort(boxes[:, 3:5], axis=1)
    boxes = boxes[(sides[:, 1] < _LONGEST_M) | (sides[:, 0] < _WIDEST_M)]
    boxes[:, 3:6] += 2 * _MARGIN_M
    return boxes
