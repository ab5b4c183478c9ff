"""What a front camera sees of places on the street while the vehicle drives by."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.datasets.synthetic.ego import EgoMotion
from percept.datasets.synthetic.layout import Placed
from percept.datasets.synthetic.shapes import DETECTABLE
from percept.datasets.synthetic.world import World

__all__ = ["DriveSight"]

_F64 = NDArray[np.float64]
_PERIOD_S = 0.2
_REACH_M = 60.0
_MARGIN_M = 10.0
# A ray ends a little before its point, so that the ground below a wheel is not behind the car.
_WHOLE_WAY = 0.98


@dataclass(frozen=True, eq=False)
class DriveSight:
    """The looks of one camera during a drive.

    Attributes:
        world: The street.
        ego: The motion of the vehicle.
        camera: A camera with its place on the vehicle.
        seconds: Length of the drive.
    """

    world: World
    ego: EgoMotion
    camera: CameraSensor
    seconds: float

    @cached_property
    def span_m(self) -> tuple[float, float]:
        """From where to where along the street places are driven by, ends left out."""
        start, end = self.ego.poses(np.array([0.0, self.seconds]))[:, 0, 3].tolist()
        return start + _MARGIN_M, end - _MARGIN_M

    def looks(self, points_map: _F64, nearest_m: float, farthest_m: float) -> NDArray[np.int64]:
        """Count at how many moments, five a second, each of some points is seen.

        Seen means inside the image, within a range of the camera, and nothing that stands or
        moves on the street in between. Its boxes are taken for objects.

        Args:
            points_map: (N, 3) float64 places, at most some 30 m apart.
            nearest_m: Least distance from the camera.
            farthest_m: Largest distance from the camera, at most 60.

        Returns:
            (N,) int64.
        """
        counts = np.zeros(len(points_map), dtype=np.int64)
        low, high = float(points_map[:, 0].min()), float(points_map[:, 0].max())
        for moment in np.flatnonzero(self._near(low - farthest_m, high + farthest_m)):
            counts += self._seen(int(moment), points_map, nearest_m, farthest_m)
        return counts

    def _near(self, low_m: float, high_m: float) -> NDArray[np.bool_]:
        x = self._poses[:, 0, 3]
        near: NDArray[np.bool_] = (x >= low_m) & (x <= high_m)
        return near

    @cached_property
    def _times_s(self) -> _F64:
        return np.arange(0.0, self.seconds, _PERIOD_S)

    @cached_property
    def _poses(self) -> _F64:
        return self.ego.poses(self._times_s)

    @cached_property
    def _boxes(self) -> dict[int, tuple[_F64, _F64]]:
        return {}

    def _seen(
        self, moment: int, points_map: _F64, nearest_m: float, farthest_m: float
    ) -> NDArray[np.bool_]:
        mount = self.camera.T_base_sensor
        T_base_cam = np.eye(4) if mount is None else mount.matrix
        T_map_cam = Transform("map", "camera", self._poses[moment] @ T_base_cam)
        points_cam = T_map_cam.inverse().apply(points_map)
        _, inside = self.camera.pinhole().project(points_cam)
        range_m = np.linalg.norm(points_cam, axis=1)
        seen = inside & (range_m >= nearest_m) & (range_m <= farthest_m)
        if seen.any():
            eye = np.asarray(T_map_cam.translation_m)
            seen[seen] = ~_hidden(eye, points_map[seen], *self._boxes_at(moment))
        return np.asarray(seen, dtype=np.bool_)

    def _boxes_at(self, moment: int) -> tuple[_F64, _F64]:
        """Return `T_box_map` (B, 4, 4) and half sizes (B, 3) of objects near the vehicle."""
        if moment not in self._boxes:
            time_s, x_m = float(self._times_s[moment]), float(self._poses[moment, 0, 3])
            objects = [
                placed
                for placed in self.world.objects(time_s, x_m, _REACH_M)
                if placed.shape.label in DETECTABLE
            ]
            frames = [self._box_frame(placed, time_s) for placed in objects]
            sizes = [(o.shape.length_m, o.shape.width_m, o.shape.height_m) for o in objects]
            self._boxes[moment] = (
                np.array(frames).reshape(-1, 4, 4),
                np.array(sizes).reshape(-1, 3) / 2,
            )
        return self._boxes[moment]

    def _box_frame(self, placed: Placed, time_s: float) -> _F64:
        """Return `T_box_map` (4, 4) of the box about an object, its origin in the middle."""
        T_map_box = self.world.place(placed, time_s)
        T_map_box[:3, 3] += T_map_box[:3, :3] @ placed.shape.middle
        return np.asarray(np.linalg.inv(T_map_box), dtype=np.float64)


def _hidden(eye_map: _F64, points_map: _F64, T_box_map: _F64, half: _F64) -> NDArray[np.bool_]:
    """Return (N,) whether a box lies between the eye (3,) and points (N, 3): slabs in its frame."""
    # Boxes lean with the grade of the road here; those of percept.core.sight_lines stand upright.
    if not len(T_box_map):
        return np.zeros(len(points_map), dtype=np.bool_)
    turn, shift = T_box_map[:, :3, :3], T_box_map[:, :3, 3]
    start = np.einsum("bij,j->bi", turn, eye_map) + shift
    way = np.einsum("bij,nj->bni", turn, points_map - eye_map)
    way = np.where(np.abs(way) < 1e-9, 1e-9, way)
    ends = np.stack([(side * half - start)[:, None, :] / way for side in (-1.0, 1.0)])
    enter = ends.min(axis=0).max(axis=-1)
    leave = ends.max(axis=0).min(axis=-1)
    hits = (enter < leave) & (leave > 0) & (enter < _WHOLE_WAY)
    hidden: NDArray[np.bool_] = hits.any(axis=0)
    return hidden
