"""The bird's-eye view: what a camera sees of the road, as a grid in metres on the ground.

Every cell is projected with the exact model of the camera, distortion and all, from the
surface of the ground; no plane and no homography is assumed (Bertozzi and Broggi 1998 call the
flat case inverse perspective mapping).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.errors import ConfigError
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.lanes.ground import GroundSurface
from percept.lanes.paint_config import PaintConfig

__all__ = ["BirdsEye", "BirdsEyeGrid"]

_F64 = NDArray[np.float64]
_F32 = NDArray[np.float32]

# Columns between which the lens is followed by a straight line: below 0.1 px for lenses
# whose coefficients are those of a camera for driving.
_LATTICE = 4
_NEWTON_STEPS = 15
_BEFORE_CAMERA_M = 0.5
_ON_GROUND_M = 1e-4


@dataclass(frozen=True, slots=True)
class BirdsEyeGrid:
    """A grid on the ground in the vehicle's frame: rows along +x, columns along +y.

    For a picture that a person looks at, forward up and left at the left, turn both axes:
    `image[::-1, ::-1]`.

    Attributes:
        x_m: First and last edge along x.
        y_m: First and last edge along y.
        along_m: Size of a cell along x.
        across_m: Size of a cell along y.
    """

    x_m: tuple[float, float] = (3.0, 25.0)
    y_m: tuple[float, float] = (-9.0, 9.0)
    along_m: float = 0.1
    across_m: float = 0.03

    @classmethod
    def ahead_of(cls, camera: CameraSensor, config: PaintConfig) -> BirdsEyeGrid:
        """Return the grid ahead of a camera, up to the reach."""
        place = camera.T_base_sensor
        start = 0.0 if place is None else float(place.translation_m[0])
        half = config.half_width_m
        return cls(x_m=(start + _BEFORE_CAMERA_M, config.reach_m + 1.0), y_m=(-half, half))

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        rows = round((self.x_m[1] - self.x_m[0]) / self.along_m)
        return max(rows, 1), max(round((self.y_m[1] - self.y_m[0]) / self.across_m), 1)

    def points(self, cells: NDArray[np.floating] | NDArray[np.integer]) -> _F64:
        """Return x, y (N, 2) of cells (N, 2) as row, column; whole numbers are middles."""
        sizes = np.array([self.along_m, self.across_m])
        points: _F64 = [self.x_m[0], self.y_m[0]] + (np.asarray(cells) + 0.5) * sizes
        return points

    def cells(self, points_m: NDArray[np.floating]) -> _F64:
        """Return row, column (N, 2) of points (N, 2); whole numbers are middles of cells."""
        sizes = np.array([self.along_m, self.across_m])
        cells: _F64 = (np.asarray(points_m)[:, :2] - [self.x_m[0], self.y_m[0]]) / sizes - 0.5
        return cells


class BirdsEye:
    """A camera over a ground: pixels to metres and back, and the view from above.

    Args:
        camera: The camera with its place on the vehicle.
        ground: The road's surface in the vehicle's frame.
        grid: Which part of the ground is drawn.

    Attributes:
        camera: As given.
        ground: As given.
        grid: As given.
        eye_m: (3,) float64 where the camera is in the vehicle's frame.

    Raises:
        ConfigError: If the camera's place on the vehicle is not known.
        GeometryError: If the intrinsics make no camera.
    """

    def __init__(
        self, camera: CameraSensor, ground: GroundSurface, grid: BirdsEyeGrid | None = None
    ) -> None:
        if camera.T_base_sensor is None:
            raise ConfigError(
                f"the place of camera '{camera.name}' on the vehicle is not known",
                remedy="Give T_base_sensor in the rig file",
            )
        self.camera = camera
        self.ground = ground
        self.grid = grid or BirdsEyeGrid()
        self.eye_m: _F64 = camera.T_base_sensor.translation_m
        self._T_base_cam: Transform = camera.T_base_sensor
        self._T_cam_base = camera.T_base_sensor.inverse()
        self._lens: Camera = camera.camera()

    def pixels(self, points_m: NDArray[np.floating]) -> tuple[_F64, NDArray[np.bool_]]:
        """Project points of the ground.

        Args:
            points_m: (N, 2) x, y in the vehicle's frame; they are put on the ground.

        Returns:
            Pixels (N, 2) in the recorded image, NaN behind the camera, and which (N,) lie in
            the image.
        """
        points = np.asarray(points_m, dtype=np.float64)[:, :2]
        on_ground = np.column_stack([points, self.ground.height(points)])
        return self._lens.project(self._T_cam_base.apply(on_ground))

    def points(self, pixels: NDArray[np.floating]) -> _F64:
        """Return where the rays of pixels (N, 2) meet the ground, x, y (N, 2), metres.

        NaN where a ray does not come down to the ground. Newton's method, which is exact on
        every straight piece of the profile.
        """
        rays = self._lens.unproject(np.asarray(pixels)) @ self._T_base_cam.rotation.T
        with np.errstate(all="ignore"):
            along = -self._above(self.eye_m[None]) / rays[:, 2]
            for _ in range(_NEWTON_STEPS):
                point = self.eye_m + along[:, None] * rays
                fall = self.ground.grade(point[:, 0]) * rays[:, 0]
                fall += self.ground.cross_slope * rays[:, 1] - rays[:, 2]
                along = along + self._above(point) / fall
            point = self.eye_m + along[:, None] * rays
            met = (np.abs(self._above(point)) < _ON_GROUND_M) & (along > 0)
        found: _F64 = np.where(met[:, None], point[:, :2], np.nan)
        return found

    def image(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the view from above of an image (H, W[, C]): (rows, columns[, C]) uint8.

        Cells that the image does not show are 0; see `seen`.
        """
        columns, rows = self._maps
        drawn: NDArray[np.uint8] = cv2.remap(
            image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
        ).view(np.uint8)
        return drawn

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(rows, columns) bool: which cells lie in the image."""
        seen: NDArray[np.bool_] = self._maps[0] >= 0
        return seen

    @cached_property
    def footprint_m(self) -> tuple[_F32, _F32]:
        """How much road a pixel covers at each cell, two (rows, columns) float32, metres.

        The first across a line that runs along x (measured at a right angle to the line in the
        image, where a line at the side is thin), the second along x across a bar. Infinite
        where a cell is not seen.
        """
        lattice = self._lattice
        across_u, across_v = np.moveaxis(_slope(lattice, 1, self.grid.across_m * _LATTICE), -1, 0)
        along_u, along_v = np.moveaxis(_slope(lattice, 0, self.grid.along_m), -1, 0)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            area = np.abs(across_u * along_v - across_v * along_u)
            across = np.hypot(along_u, along_v) / area
            along = np.hypot(across_u, across_v) / area
        return self._of_seen(across), self._of_seen(along)

    def _of_seen(self, on_lattice: _F32) -> _F32:
        """Return values of the lattice (rows, posts) at all cells; infinite where not seen."""
        values = np.repeat(on_lattice, _LATTICE, axis=1)[:, : self.grid.shape[1]]
        known = self.seen & np.isfinite(values)
        return np.asarray(np.where(known, values, np.float32(np.inf)), np.float32)

    def _in_image(self, u: NDArray[np.floating], v: NDArray[np.floating]) -> NDArray[np.bool_]:
        width, height = self.camera.image_size
        with np.errstate(invalid="ignore"):
            inside: NDArray[np.bool_] = (u >= 0) & (u <= width - 1) & (v >= 0) & (v <= height - 1)
        return inside

    def _above(self, points_m: _F64) -> _F64:
        above: _F64 = points_m[:, 2] - self.ground.height(points_m)
        return above

    @cached_property
    def _lattice(self) -> _F32:
        """Pixels (rows, posts, 2) of every few cells of each row; NaN where there are none."""
        rows, columns = self.grid.shape
        posts = np.arange(0, columns + _LATTICE, _LATTICE)
        cells = np.stack(np.meshgrid(np.arange(rows), posts, indexing="ij"), axis=-1)
        pixels, seen = self.pixels(self.grid.points(cells.reshape(-1, 2)))
        folded = ~seen & self._in_image(*pixels.T)  # the lens's model folds back there
        pixels[folded] = np.nan
        return pixels.reshape(rows, len(posts), 2).astype(np.float32)

    @cached_property
    def _maps(self) -> tuple[_F32, _F32]:
        """Return u and v (rows, columns) of every cell; -1 where the image does not show it."""
        rows, columns = self.grid.shape
        share = (np.arange(_LATTICE) / _LATTICE).astype(np.float32)
        u, v = (
            (axis[:, :-1, None] + np.diff(axis)[..., None] * share).reshape(rows, -1)[:, :columns]
            for axis in np.moveaxis(self._lattice, -1, 0)
        )
        inside = self._in_image(u, v)
        return np.where(inside, u, np.float32(-1)), np.where(inside, v, np.float32(-1))


def _slope(values: _F32, axis: int, step_m: float) -> _F32:
    slope: _F32 = np.gradient(values, step_m, axis=axis).astype(np.float32)
    return slope
