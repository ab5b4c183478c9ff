"""Where in space the boxes of many images meet: places of things that stand still.

Each box is a ray from the camera. Its height in pixels tells the range roughly, since lights are
about one metre high; from then on every further ray makes the place better known. Places are
kept in information form (a Kalman filter of a still point): a ray knows all but the direction
along itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.map_findings import Look
from percept.core.rig import CameraSensor
from percept.core.transform import Transform

__all__ = ["RayCluster", "RayClusters"]

_F64 = NDArray[np.float64]
_LIGHT_HEIGHT_M = 1.0  # of a housing with three lamps, about
_RANGE_SD_SHARE = 0.4
_ANGLE_SD_RAD = 0.006  # a pose that is a third of a degree off
_PIXEL_SD = 2.0
_GATE = 11.3  # chi-square with 3 degrees of freedom, 1 %
_FARTHEST_M = 80.0


@dataclass(slots=True, eq=False)
class RayCluster:
    """A place that rays meet in.

    Attributes:
        information: (3, 3) inverse covariance, 1/m^2.
        vector: (3,) information times place.
        looks: The looks that confirm it.
        road_m: Heights of the road below the vehicle at those looks, metres in the map.
        chances: Looks in which it should have been seen, from its first one on.
    """

    information: _F64
    vector: _F64
    looks: list[Look] = field(default_factory=list)
    road_m: list[float] = field(default_factory=list)
    chances: int = 0

    @property
    def place_map(self) -> _F64:
        """(3,) metres in the map frame."""
        return np.asarray(np.linalg.solve(self.information, self.vector), np.float64)

    @property
    def covariance(self) -> _F64:
        """(3, 3) square metres."""
        return np.asarray(np.linalg.inv(self.information), np.float64)

    @property
    def sd_m(self) -> float:
        """Spread in the direction in which the place is known worst."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance)[-1]))

    @property
    def height_m(self) -> float:
        """Height over the road."""
        return float(self.place_map[2] - np.median(self.road_m))

    @property
    def share(self) -> float:
        """Share of the looks in which it should have been seen, and was."""
        return len(self.looks) / max(self.chances, len(self.looks), 1)


class RayClusters:
    """Boxes of one drive, in the order of time, sorted by the place that they come from."""

    def __init__(self) -> None:
        self._clusters: list[RayCluster] = []

    def places(self) -> Sequence[RayCluster]:
        """Return all places so far."""
        return tuple(self._clusters)

    def push(
        self,
        boxes_px: _F64,
        camera: CameraSensor,
        T_map_base: Transform,
        stamp_ns: int,
        drive: int,
    ) -> None:
        """Take the boxes (N, 4) of an image.

        Args:
            boxes_px: x1, y1, x2, y2.
            camera: Its lens and place.
            T_map_base: Where the vehicle was.
            stamp_ns: Time of the image.
            drive: Number of the drive.
        """
        if camera.T_base_sensor is None:
            return
        lens, T_map_cam = camera.camera(), T_map_base @ camera.T_base_sensor
        eye, road_m = T_map_cam.translation_m, float(T_map_base.translation_m[2])
        rays = lens.unproject((boxes_px[:, :2] + boxes_px[:, 2:]) / 2 - 0.5)
        rays_map = rays @ T_map_cam.rotation.T
        focal_px = float(lens.K[1, 1])
        ranges_m = focal_px * _LIGHT_HEIGHT_M / np.maximum(boxes_px[:, 3] - boxes_px[:, 1], 1.0)
        taken: set[int] = set()
        for ray, range_m in zip(rays_map, ranges_m.tolist(), strict=True):
            if not np.isfinite(ray).all() or range_m > _FARTHEST_M:
                continue
            number = self._nearest(eye, ray, range_m, focal_px, taken)
            if number is None:
                self._clusters.append(_first(eye, ray, range_m))
                number = len(self._clusters) - 1
            taken.add(number)
            cluster = self._clusters[number]
            distance_m = float(np.linalg.norm(cluster.place_map - eye))
            _add(cluster, eye, ray, _across_sd(distance_m, focal_px))
            cluster.looks.append(Look(drive, camera.name, stamp_ns, distance_m))
            cluster.road_m.append(road_m)
        self._count_chances(lens, T_map_cam, taken)

    def _nearest(
        self, eye: _F64, ray: _F64, range_m: float, focal_px: float, taken: set[int]
    ) -> int | None:
        """Return the place that a ray comes from, or None."""
        best, least = None, _GATE
        for number, cluster in enumerate(self._clusters):
            if number in taken:
                continue
            towards = cluster.place_map - eye
            along = float(towards @ ray)
            if not 0.4 * range_m < along < 2.5 * range_m:
                continue
            off = towards - along * ray
            spread = cluster.covariance + np.eye(3) * _across_sd(along, focal_px) ** 2
            distance = float(off @ np.linalg.solve(spread, off))
            if distance < least:
                best, least = number, distance
        return best

    def _count_chances(self, lens: Camera, T_map_cam: Transform, taken: set[int]) -> None:
        """Count a chance for each place that the camera should see, as near as it was seen."""
        if not self._clusters:
            return
        places = np.array([cluster.place_map for cluster in self._clusters])
        points_cam = T_map_cam.inverse().apply(places)
        _, inside = lens.project(points_cam)
        for number, cluster in enumerate(self._clusters):
            near = np.linalg.norm(points_cam[number]) <= cluster.looks[0].range_m + 1.0
            cluster.chances += bool(number in taken or (inside[number] and near))


def _across_sd(range_m: float, focal_px: float) -> float:
    return max(range_m, 1.0) * float(np.hypot(_PIXEL_SD / focal_px, _ANGLE_SD_RAD))


def _first(eye: _F64, ray: _F64, range_m: float) -> RayCluster:
    """Return what one box tells before any ray: a place along it, roughly."""
    sd_m = max(_RANGE_SD_SHARE * range_m, 1.0)
    information = np.eye(3) / (3 * sd_m) ** 2 + np.outer(ray, ray) / sd_m**2
    return RayCluster(information, information @ (eye + range_m * ray))


def _add(cluster: RayCluster, eye: _F64, ray: _F64, sd_m: float) -> None:
    across = (np.eye(3) - np.outer(ray, ray)) / sd_m**2
    cluster.information = cluster.information + across
    cluster.vector = cluster.vector + across @ eye
