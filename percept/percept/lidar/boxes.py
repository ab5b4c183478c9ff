"""Oriented boxes around clusters: L-shape fit or rectangle of least area.

A laser sees at most two sides of a car, so its points form an L. The L-shape fit of Zhang, Xu,
Dong and Dolan, "Efficient L-shape fitting for vehicle detection using laser scanners" (IEEE
IV 2017) turns a rectangle through 90 degrees and keeps the direction in which most points lie
close to two of its sides.

A box holds what was seen, and nothing is added to it: a car that is seen from behind has a box
as long as the car is wide. Its yaw is then across the car; a direction is known up to multiples
of 90 degrees (180 degrees where both sides were seen).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.errors import GeometryError
from percept.core.settings import Settings
from percept.lidar.points import as_points

__all__ = ["BoxConfig", "FittedBoxes", "fit_boxes"]

_SURFACE_DEPTH_M = 0.2


class BoxConfig(Settings):
    """How boxes are fitted.

    Attributes:
        method: `l_shape` (closeness criterion of Zhang et al. 2017) or `min_area` (the
            rectangle of least area around the convex hull).
        angle_step_deg: Step of the L-shape search; the best step is refined to a quarter.
        closest_m: Distance to a side below which a point gains nothing more (`d0` there).
        min_extent_m: Smallest length, width and height, so that a single point, a line and a
            flat patch have a volume too.
    """

    method: Literal["l_shape", "min_area"] = "l_shape"
    angle_step_deg: float = Field(default=1.5, gt=0, le=15)
    closest_m: float = Field(default=0.05, gt=0, le=1)
    min_extent_m: float = Field(default=0.05, gt=0, le=1)


@dataclass(frozen=True, slots=True, eq=False)
class FittedBoxes:
    """Boxes of K clusters.

    Attributes:
        boxes_m: (K, 7) float64 centre x, y, z, length, width, height in metres and yaw in rad
            in (-pi/2, pi/2], in the frame of the points; length >= width, length along yaw.
        points: (K,) int64 number of points in each cluster.
        surface: (K,) float64 share of the points that lie within 0.2 m of a side that faces
            the origin of the frame. A solid thing stops the beams at its sides; leaves do not.
    """

    boxes_m: NDArray[np.float64]
    points: NDArray[np.int64]
    surface: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.boxes_m)

    def select(self, keep: NDArray[np.bool_]) -> FittedBoxes:
        """Return the boxes of a mask (K,), with all that belongs to them."""
        return FittedBoxes(self.boxes_m[keep], self.points[keep], self.surface[keep])


def fit_boxes(
    points_xyz: NDArray[np.float32],
    cluster_ids: NDArray[np.int32],
    config: BoxConfig | None = None,
) -> FittedBoxes:
    """Fit one upright oriented box to each cluster.

    Args:
        points_xyz: (N, 3) float32, finite, metres, z up.
        cluster_ids: (N,) int32 in -1..K-1, where -1 is none and each of 0..K-1 has a point.
        config: How; defaults where it is None.

    Returns:
        K boxes in the order of the cluster numbers; the same input gives the same bits.

    Raises:
        GeometryError: If the arrays do not match, a coordinate is not finite, or a cluster
            number has no point.
    """
    config = config or BoxConfig()
    points = as_points(points_xyz)
    ids = np.ascontiguousarray(cluster_ids, dtype=np.int32)
    if ids.shape != (len(points),):
        raise GeometryError(
            f"boxes need points (N, 3) and cluster ids (N,), got {points.shape} and {ids.shape}"
        )
    count = int(ids.max()) + 1 if len(ids) else 0
    if count == 0:
        return FittedBoxes(np.empty((0, 7)), np.empty(0, np.int64), np.empty(0))
    # Compiled on first use: numba takes a second to import, which `--help` must not pay.
    from percept.lidar.box_kernels import fit_all, group_by_cluster, share_near_surface

    order, starts = group_by_cluster(ids, count)
    sizes = np.diff(starts)
    if not sizes.all():
        raise GeometryError(
            f"cluster {int(np.argmin(sizes))} has no points",
            remedy="Number the clusters 0 to K-1 without gaps",
        )
    boxes = fit_all(
        points,
        order,
        starts,
        config.method == "l_shape",
        math.radians(config.angle_step_deg),
        config.closest_m,
        config.min_extent_m,
    )
    surface = share_near_surface(points, order, starts, boxes, _SURFACE_DEPTH_M)
    return FittedBoxes(boxes, sizes, surface)
