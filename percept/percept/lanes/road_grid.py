"""The bird's-eye view that lines are followed in: `BirdsEye`, laid along the lane.

Rows go ahead from the first that the image shows, columns from left to right, as windows and
segments want them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.rig import CameraSensor
from percept.lanes.birdseye import BirdsEye, BirdsEyeGrid
from percept.lanes.config import LaneConfig
from percept.lanes.ground import GroundSurface

__all__ = ["RoadGrid"]

_F64 = NDArray[np.float64]

_STEP_M = 0.1
_CELL_M = 0.03
_NEAREST_M = 1.0
_FEWEST_ROWS = 4
_HORIZON_PX = 8  # rows of pixels that are nearer to the horizon show too much road each


@dataclass(frozen=True, slots=True, eq=False)
class RoadGrid:
    """A grid in the road's frame: x along the lane, y to its left.

    Attributes:
        view: The view from above.
        eye_m: (3,) float64 where the camera is; its z is the height over the road.
        focal_px: Focal lengths of the camera.
        x_m: (rows,) float64 of the rows, growing.
        y_m: (columns,) float64 of the columns, falling.
        inside: (rows, columns) bool, whether the image shows the place.
    """

    view: BirdsEye
    eye_m: _F64
    focal_px: tuple[float, float]
    x_m: _F64
    y_m: _F64
    inside: NDArray[np.bool_]

    @classmethod
    def over(cls, camera: CameraSensor, ground: GroundSurface, config: LaneConfig) -> RoadGrid:
        """Lay a grid over what a camera sees of the road, up to the reach.

        Args:
            camera: The camera, with its place in the road's frame.
            ground: The road's surface in that frame.
            config: Settings.
        """
        start, end = _ends(BirdsEye(camera, ground), config)
        eye = BirdsEye(camera, ground).eye_m
        half = config.half_width_m
        sides = (float(eye[1]) - half, float(eye[1]) + half)
        view = BirdsEye(camera, ground, BirdsEyeGrid((start, end), sides, _STEP_M, _CELL_M))
        rows, columns = view.grid.shape
        first, last = view.grid.points(np.array([[0, columns - 1], [rows - 1, 0]]))
        return cls(
            view=view,
            eye_m=eye,
            focal_px=(camera.K[0], camera.K[1]),
            x_m=np.linspace(first[0], last[0], rows),
            y_m=np.linspace(first[1], last[1], columns),
            inside=view.seen[:, ::-1],
        )

    def warped(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return an image (H, W[, C]) as it is on the grid (rows, columns[, C]).

        Beside what the image shows a row goes on as at its border: an edge there would be taken
        for one of the road.
        """
        shown = self.view.image(image)[:, ::-1]
        columns = np.arange(len(self.y_m))
        first = np.argmax(self.inside, axis=1)[:, None]
        last = len(columns) - 1 - np.argmax(self.inside[:, ::-1], axis=1)[:, None]
        nearest = np.clip(columns, first, last)
        return np.ascontiguousarray(shown[np.arange(len(shown))[:, None], nearest])

    @property
    def footprint_m(self) -> NDArray[np.float32]:
        """(rows, columns) float32 of road across the lane that a pixel covers."""
        return self.view.footprint_m[0][:, ::-1]

    def cells(self, length_m: float) -> int:
        """Return how many columns a width is, at least 1."""
        return max(1, round(length_m / _CELL_M))

    def rows(self, length_m: float) -> int:
        """Return how many rows a length is, at least 1."""
        return max(1, round(length_m / _STEP_M))

    @property
    def step_m(self) -> float:
        """Distance of rows."""
        return _STEP_M

    @property
    def cell_m(self) -> float:
        """Distance of columns."""
        return _CELL_M

    def column(self, y_m: _F64) -> _F64:
        """Return columns, not rounded, of lateral places."""
        columns: _F64 = (self.y_m[0] - y_m) / _CELL_M
        return columns


def _ends(view: BirdsEye, config: LaneConfig) -> tuple[float, float]:
    """Return x of the first and of the last row: what the image shows and no crest hides."""
    x0, y0, up = view.eye_m
    _, fy, cx, _ = view.camera.K
    lowest = view.points(np.array([[cx, view.camera.image_size[1] - 1.0]]))[0, 0]
    start = max(float(np.nan_to_num(lowest, nan=x0)), float(x0) + _NEAREST_M)
    reach = float(x0) + min(config.reach_m, float(fy * up) / _HORIZON_PX)
    ahead = np.arange(start, max(reach, start + _FEWEST_ROWS * _STEP_M), _STEP_M)
    v = view.pixels(np.column_stack([ahead, np.full(len(ahead), y0)]))[0][:, 1]
    hidden = np.flatnonzero(np.diff(v) >= 0)
    count = max(int(hidden[0]) if len(hidden) else len(ahead), _FEWEST_ROWS)
    return start, start + count * _STEP_M
