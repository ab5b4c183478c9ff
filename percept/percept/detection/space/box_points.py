"""Which points of a scan are the object in each 2D box of an image.

Points are projected into the image. A cluster *agrees* with a box by the share of its points that
lie in the box, times how well its extent across the image is that of the box (intersection over
union of the two intervals); extents along v are left out, since beams are far apart and the
ground takes an object's lowest points. Of the clusters that agree about as well as the best one,
the nearest counts: a sliver of an occluder or of the background agrees badly, and what stands
behind the object is farther away.

Far signs and lights have too few points for a cluster, and an object may be one cluster with its
neighbour. There the points in the box alone are looked at: the nearest group in depth counts,
provided that it fills the box and does not go on around it, as a wall behind a sign does.

Boxes count from the outer edge of the top left pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.transform import Transform
from percept.lidar.result import ScanResult

__all__ = ["points_of_boxes"]

_F64 = NDArray[np.float64]
_I64 = NDArray[np.int64]
_Mask = NDArray[np.bool_]

_FEWEST_POINTS = 3
# Half of an object's points in half of the box's width: below that a cluster is a sliver.
_LEAST_AGREEMENT = 0.3
# A cluster that agrees so well with a box is that object, and is kept from other boxes.
_CLAIM = 0.5
# A nearer cluster wins over a farther one that agrees better, down to this part of its agreement.
_NEARLY_AS_GOOD = 0.75
_DEPTH_GAP_M = 1.0
# Around a box, in an area three times as large, an object that ends there has next to no points.
_MOST_AROUND = 0.5
_LEAST_FILL = 0.3
_STEEPEST = 1e6


def points_of_boxes(
    boxes_px: _F64, camera: Camera, T_camera_cloud: Transform, scan: ScanResult
) -> list[_I64]:
    """Return for each box the points of its object, as rows of the cloud; none where unknown.

    Two boxes may have the same points: of two classes for one object, or a rider and the bicycle.

    Args:
        boxes_px: (B, 4) x1, y1, x2, y2 in the recorded image.
        camera: The camera.
        T_camera_cloud: Maps points of the scan's cloud into the camera's optical frame.
        scan: The scan with its ground and clusters.
    """
    seen = _SeenPoints.of(scan, camera, T_camera_cloud)
    if not (len(boxes_px) and len(seen.rows)):
        return [_NONE] * len(boxes_px)
    membership = _Membership.of(boxes_px, seen)
    return [seen.rows[membership.choose(box)] for box in range(len(boxes_px))]


_NONE: _I64 = np.zeros(0, np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class _SeenPoints:
    """The points of a scan that stand on the ground and appear in the image, by cluster.

    Attributes:
        rows: (M,) int64 of the cloud; those of one cluster stand together, the first of all those
            without a cluster.
        u: (M,) pixels from the outer edge of the top left pixel.
        v: (M,) likewise.
        depth_m: (M,) along the optical axis.
        clusters: (M,) int64 0..K-1, or -1; numbered anew without gaps.
        starts: (K,) int64 first point of each cluster.
    """

    rows: _I64
    u: _F64
    v: _F64
    depth_m: _F64
    clusters: _I64
    starts: _I64

    @classmethod
    def of(cls, scan: ScanResult, camera: Camera, T_camera_cloud: Transform) -> _SeenPoints:
        matrix = T_camera_cloud.matrix.astype(np.float32)
        rows = np.flatnonzero(~scan.ground)
        x, y, depth = (
            matrix[:3, :3] @ np.take(scan.cloud.points_xyz, rows, axis=0).T + matrix[:3, 3:]
        )
        slope = _steepest(camera)
        rows = rows[(np.abs(x) <= slope[0] * depth) & (np.abs(y) <= slope[1] * depth)]
        points_cam = T_camera_cloud.apply(scan.cloud.points_xyz[rows])
        pixels, seen = camera.project(points_cam)
        order = np.flatnonzero(seen)[np.argsort(scan.cluster_ids[rows[seen]], kind="stable")]
        ids = scan.cluster_ids[rows[order]]
        starts = np.flatnonzero(np.diff(ids, prepend=-1))
        clusters = np.cumsum(np.diff(ids, prepend=-1) > 0) - 1
        u, v = np.ascontiguousarray(pixels[order].T) + 0.5
        return cls(rows[order], u, v, points_cam[order, 2], clusters, starts)

    def within(self, boxes: _F64) -> _Mask:
        """Return (B, M): which points lie in which of the boxes (B, 4)."""
        x1, y1, x2, y2 = boxes.T[:, :, None]
        within: _Mask = (self.u >= x1) & (self.u <= x2) & (self.v >= y1) & (self.v <= y2)
        return within


@dataclass(frozen=True, slots=True, eq=False)
class _Membership:
    """Which points and clusters lie in which boxes.

    Attributes:
        boxes: (B, 4) pixels.
        seen: The points.
        inside: (B, M) bool.
        agreement: (B, K) 0..1, how well each cluster explains each box.
        free: (B, M) bool: points in the box of which no other box is the better owner.
    """

    boxes: _F64
    seen: _SeenPoints
    inside: _Mask
    agreement: _F64
    free: _Mask

    @classmethod
    def of(cls, boxes: _F64, seen: _SeenPoints) -> _Membership:
        inside = seen.within(boxes)
        agreement = _agreement(boxes, seen, inside)
        # A cluster that agrees with a box belongs to it: what of it lies in that box too counts
        # for no other box that it does not agree with. Boxes of one object all keep it.
        agrees = agreement >= _CLAIM
        claimed = np.append(agrees.any(axis=0), False)[seen.clusters]
        owner = np.append(agreement.argmax(axis=0), 0)[seen.clusters]
        owned = claimed & inside[owner, np.arange(len(owner))]
        mine = np.column_stack([agrees, np.zeros(len(boxes), np.bool_)])[:, seen.clusters]
        return cls(boxes, seen, inside, agreement, inside & (mine | ~owned))

    def choose(self, box: int) -> _I64:
        """Return the rows of `seen` that the position of a box rests on, or none."""
        free = np.flatnonzero(self.free[box])
        cluster = self._nearest_cluster(box, free)
        if not len(cluster):
            return self._nearest_group(box, free)
        # What stands before the cluster is the object if it takes up as much of the box: as many
        # beams meet an area of the image whatever its depth.
        nearest_m = self.seen.depth_m[cluster].min() - _DEPTH_GAP_M
        group = self._nearest_group(box, free[self.seen.depth_m[free] < nearest_m])
        return group if 2 * len(group) >= len(cluster) else cluster

    def _nearest_cluster(self, box: int, free: _I64) -> _I64:
        """Return the free points of the nearest of the clusters that agree with a box."""
        candidates = []
        for cluster in np.flatnonzero(self.agreement[box] >= _LEAST_AGREEMENT):
            rows = free[self.seen.clusters[free] == cluster]
            if len(rows) >= _FEWEST_POINTS:
                candidates.append((float(self.agreement[box, cluster]), rows))
        enough = _NEARLY_AS_GOOD * max((agreement for agreement, _ in candidates), default=0)
        good = [rows for agreement, rows in candidates if agreement >= enough]
        nearest = min(
            good, key=lambda rows: float(np.median(self.seen.depth_m[rows])), default=_NONE
        )
        return max(_depth_groups(nearest, self.seen.depth_m), key=len, default=_NONE)

    def _nearest_group(self, box: int, free: _I64) -> _I64:
        """Return the nearest group in depth that fills a box and ends around it, or no points."""
        depth_m = self.seen.depth_m
        for rows in _depth_groups(free, depth_m):
            if self._fills(rows, box) and not self._goes_on(rows, box):
                return rows
        return _NONE

    def _fills(self, rows: _I64, box: int) -> bool:
        """Tell whether points span enough of a box's width, around its middle."""
        x1, _, x2, _ = self.boxes[box]
        u = np.sort(self.seen.u[rows])
        off_centre = abs(u[len(u) // 2] - (x1 + x2) / 2)
        return bool(u[-1] - u[0] >= _LEAST_FILL * (x2 - x1) and off_centre <= (x2 - x1) / 4)

    def _goes_on(self, rows: _I64, box: int) -> bool:
        """Tell whether there is more of the same depth around a box: it is no object by itself."""
        depth_m = self.seen.depth_m
        half = (self.boxes[box, 2:] - self.boxes[box, :2]) / 2
        wide = self.boxes[box] + np.concatenate([-half, half])
        around = depth_m[self.seen.within(wide[None])[0] & ~self.inside[box]]
        near, far = depth_m[rows[0]] - _DEPTH_GAP_M, depth_m[rows[-1]] + _DEPTH_GAP_M
        more = np.count_nonzero((around >= near) & (around <= far))
        return bool(more > _MOST_AROUND * len(rows))


def _agreement(boxes: _F64, seen: _SeenPoints, inside: _Mask) -> _F64:
    """Return (B, K): the share of each cluster in each box times the overlap of their widths."""
    starts = seen.starts
    if not len(starts):
        return np.zeros((len(boxes), 0))
    total = np.diff(starts, append=len(seen.u))
    share = np.add.reduceat(inside, starts, axis=1, dtype=np.int64) / total
    left, right = np.minimum.reduceat(seen.u, starts), np.maximum.reduceat(seen.u, starts)
    x1, x2 = boxes[:, [0]], boxes[:, [2]]
    overlap = np.clip(np.minimum(right, x2) - np.maximum(left, x1), 0, None)
    union = np.maximum(right, x2) - np.minimum(left, x1)
    agreement: _F64 = share * overlap / np.maximum(union, 1e-9)
    return agreement


def _depth_groups(rows: _I64, depth_m: _F64) -> list[_I64]:
    """Return groups of enough points with gaps in depth between them, nearest first and sorted."""
    ordered = rows[np.argsort(depth_m[rows], kind="stable")]
    gaps = np.flatnonzero(np.diff(depth_m[ordered]) > _DEPTH_GAP_M) + 1
    edges = [0, *gaps.tolist(), len(ordered)]
    return [ordered[a:b] for a, b in pairwise(edges) if b - a >= _FEWEST_POINTS]


@lru_cache(maxsize=64)
def _steepest(camera: Camera) -> tuple[float, float]:
    """Return the largest |x| / z and |y| / z of what appears in the image, with some margin."""
    width, height = camera.image_size
    u, v = np.linspace(-0.5, width - 0.5, 33), np.linspace(-0.5, height - 0.5, 33)
    sides = [np.column_stack([u, np.full(33, side)]) for side in (v[0], v[-1])]
    sides += [np.column_stack([np.full(33, side), v]) for side in (u[0], u[-1])]
    rays = camera.unproject(np.concatenate(sides))
    if not np.isfinite(rays).all():  # beyond what the model can undo: let all through
        return _STEEPEST, _STEEPEST
    slopes = 1.05 * np.abs(rays[:, :2] / rays[:, 2:]).max(axis=0)
    return float(slopes[0]), float(slopes[1])
