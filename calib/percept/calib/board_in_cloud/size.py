"""What else is there: free rectangles in a cloud where the plate's size was not found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.board_in_cloud.judge import Plate, cast_on_plane, weigh
from percept.calib.board_in_cloud.planes import PlaneCandidate
from percept.calib.board_in_cloud.rectangle import RectangleFit
from percept.lidar.cluster import ClusterConfig, cluster_points

__all__ = ["Rectangle", "best_rectangle", "common_size"]

_SPREADS = (0.3, 1.5)  # planes from a third to one and a half times the plate
_LOOKED_AT = 60  # planes, those of most points first
_GAP_PER_SIDE = 0.3  # hits this far apart belong to one rectangle
_MIN_EXPLAINED = 0.75
_SAME_SIZE = 0.10
_SAME_IN_CLOUDS = 3


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A flat rectangle with nothing of its plane around it.

    Attributes:
        size_m: Longer and shorter side.
        points: Returns on it.
    """

    size_m: tuple[float, float]
    points: int

    def __str__(self) -> str:
        return f"{self.size_m[0]:.2f} x {self.size_m[1]:.2f} m"


def best_rectangle(
    points: NDArray[np.float64],
    planes: Sequence[PlaneCandidate],
    plate_size_m: tuple[float, float],
    tolerance_m: float,
    min_points: int,
) -> Rectangle | None:
    """Return the isolated rectangle of any size that explains its surroundings best.

    Args:
        points: (N, 3) finite, in the LiDAR's frame.
        planes: Candidates, for a plate of `plate_size_m`.
        plate_size_m: The size that was looked for.
        tolerance_m: Largest distance of a point from its plane.
        min_points: A rectangle of fewer is none.
    """
    best: Plate | None = None
    like = [p for p in planes if _SPREADS[0] < p.spread < _SPREADS[1]]
    for plane in like[:_LOOKED_AT]:
        found = _free_rectangle(points, plane, plate_size_m, tolerance_m)
        if found is None or found.points < min_points or found.explained < _MIN_EXPLAINED:
            continue
        if best is None or found.score > best.score:
            best = found
    if best is None:
        return None
    longer, shorter = sorted((float(side) for side in best.size_m), reverse=True)
    return Rectangle((longer, shorter), best.points)


def _free_rectangle(
    points: NDArray[np.float64],
    plane: PlaneCandidate,
    plate_size_m: tuple[float, float],
    tolerance_m: float,
) -> Plate | None:
    """Return the rectangle around the connected hits at a plane's middle."""
    import cv2

    shorter = min(plate_size_m)
    rays = cast_on_plane(points, (plane.middle, plane.normal, None), plate_size_m, tolerance_m)
    hits = rays.crossings[rays.is_hit, :2]
    flat = np.column_stack([hits, np.zeros(len(hits))])
    labels = cluster_points(flat, ClusterConfig(tolerance_m=_GAP_PER_SIDE * shorter))
    if not len(labels):
        return None
    middle_label = labels[int(np.argmin((hits**2).sum(axis=1)))]
    own = hits[labels == middle_label].astype(np.float32)
    (x, y), (width, height), turn = cv2.minAreaRect(own)
    if min(width, height) < 0.25 * shorter:
        return None
    fit = RectangleFit(np.array([x, y, np.deg2rad(turn)]), np.zeros((3, 3)), 0.0, 0.0)
    found = weigh(rays, fit, (float(width), float(height)))
    return found if found.size_m.min() > 0.0 else None


def common_size(rectangles: Sequence[Rectangle]) -> tuple[Rectangle, int] | None:
    """Return the size that most of some rectangles share within 10 %, and how many do.

    None if fewer than three or fewer than half of them agree.
    """
    best: tuple[Rectangle, int] | None = None
    sizes = np.array([r.size_m for r in rectangles]).reshape(-1, 2)
    for size in sizes:
        same = np.all(np.abs(sizes / size - 1) < _SAME_SIZE, axis=1)
        if best is None or same.sum() > best[1]:
            longer, shorter = np.median(sizes[same], axis=0)
            points = int(np.median([r.points for r, s in zip(rectangles, same, strict=True) if s]))
            best = Rectangle((float(longer), float(shorter)), points), int(same.sum())
    if best is None or best[1] < max(_SAME_IN_CLOUDS, len(rectangles) / 2):
        return None
    return best
