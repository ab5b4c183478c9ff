"""Segments of the probabilistic Hough transform, joined to strokes and lines of paint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.lanes.config import LaneConfig
from percept.lanes.lines import fit_line
from percept.lanes.road_grid import RoadGrid

__all__ = ["edge_segments", "enhanced", "follow_segments", "join_strokes"]

_F64 = NDArray[np.float64]
_F32 = NDArray[np.float32]
_U8 = NDArray[np.uint8]

_STEEPEST = 0.25  # of a segment against the road's direction
_SHARE = 0.5  # of the shorter of two edges that lies beside the other
_GAP_M = 14.0
_STRONG = 6.0  # gradient of an edge against the median one
_SHORTEST_M = 1.0
_STRAIGHT_M = 4.0
_SHOWN = 0.4  # evidence of paint along a stroke


@dataclass(frozen=True, slots=True)
class _Cluster:
    strokes: list[_F64]

    def expected(self, x_m: float) -> float:
        points = np.concatenate([s.reshape(2, 2) for s in self.strokes[-4:]])
        x, y = points.T
        # As if it had been seen straight ahead before: one short stroke fixes no direction.
        spread = ((x - x.mean()) ** 2).sum() + _STRAIGHT_M**2
        slope = ((x - x.mean()) * (y - y.mean())).sum() / spread
        return float(y.mean() + slope * (x_m - x.mean()))

    @property
    def end_m(self) -> float:
        return float(max(stroke[2] for stroke in self.strokes))


def enhanced(values: _F32) -> _U8:
    """Return values (rows, columns) as grey levels with their local contrast evened out.

    Contrast-limited adaptive histogram equalisation (Zuiderveld 1994).
    """
    low, high = np.percentile(values, [1, 99.5])
    gray = np.clip((values - low) * (255 / max(high - low, 0.3)), 0, 255).astype(np.uint8)
    return np.asarray(cv2.createCLAHE(2.0, (4, 4)).apply(gray), dtype=np.uint8)


def edge_segments(gray: _U8, grid: RoadGrid) -> _F64:
    """Return edges along the road (N, 5): x1, y1, x2, y2 in metres, and the side of the light.

    The side is +1 where the brighter side is on the left. Edges are Canny's with thresholds
    that follow the usual gradient, segments those of the probabilistic Hough transform
    (Matas et al. 2000).

    Args:
        gray: (rows, columns) uint8 on the grid.
        grid: The grid.
    """
    smooth = cv2.GaussianBlur(gray, (0, 0), sigmaX=1.0, sigmaY=1.5)
    gx = cv2.Sobel(smooth, cv2.CV_16S, 1, 0)
    strong = max(30.0, _STRONG * float(np.median(np.abs(gx[grid.inside]))))
    # Edges across the road have no gradient here: lines along it are what is looked for.
    edges = cv2.Canny(gx, np.zeros_like(gx), 0.5 * strong, strong)
    edges[~cv2.erode(grid.inside.astype(np.uint8), np.ones((3, 7))).astype(bool)] = 0
    shortest = grid.rows(_SHORTEST_M)
    found = cv2.HoughLinesP(edges, 1, np.pi / 720, shortest, None, shortest, grid.rows(0.5))
    if found is None:
        return np.zeros((0, 5))
    c1, r1, c2, r2 = found.reshape(-1, 4).astype(np.int64).T
    flip = r1 > r2
    c1, c2 = np.where(flip, c2, c1), np.where(flip, c1, c2)
    r1, r2 = np.where(flip, r2, r1), np.where(flip, r1, r2)
    light = -np.sign(_mean_along(gx, c1, r1, c2, r2))
    ends = [grid.x_m[r1], grid.y_m[c1], grid.x_m[r2], grid.y_m[c2]]
    segments = np.column_stack([*ends, light])
    length = segments[:, 2] - segments[:, 0]
    along = np.abs(segments[:, 3] - segments[:, 1]) < _STEEPEST * length
    kept: _F64 = segments[along & (length > 0)]
    return kept


def _mean_along(
    values: NDArray[Any],
    c1: NDArray[np.int64],
    r1: NDArray[np.int64],
    c2: NDArray[np.int64],
    r2: NDArray[np.int64],
) -> _F64:
    steps = np.linspace(0.1, 0.9, 9)[:, None]
    rows = np.round(r1 + steps * (r2 - r1)).astype(np.int64)
    columns = np.round(c1 + steps * (c2 - c1)).astype(np.int64)
    mean: _F64 = values[rows, columns].mean(axis=0)
    return mean


def _strokes(segments: _F64, grid: RoadGrid, config: LaneConfig) -> _F64:
    """Return middles (N, 5) of pairs of edges with light between them: x1, y1, x2, y2, width."""
    right = segments[segments[:, 4] > 0]
    left = segments[segments[:, 4] < 0]
    if not (len(right) and len(left)):
        return np.zeros((0, 5))
    x1 = np.maximum(left[:, None, 0], right[None, :, 0])
    x2 = np.minimum(left[:, None, 2], right[None, :, 2])
    shorter = np.minimum((left[:, 2] - left[:, 0])[:, None], right[:, 2] - right[:, 0])
    l1, l2 = (_lateral(left[:, None], x) for x in (x1, x2))
    r1, r2 = (_lateral(right[None], x) for x in (x1, x2))
    footprint = (x1 + x2) / 2 / grid.focal_px[0]
    width = (l1 + l2 - r1 - r2) / 2
    paired = (x2 - x1 > np.maximum(0.3, _SHARE * shorter)) & (np.minimum(l1 - r1, l2 - r2) > 0)
    paired &= (width > 0.4 * config.line_width_m) & (
        width < 2.6 * config.line_width_m + 2 * footprint
    )
    made = np.stack([x1, (l1 + r1) / 2, x2, (l2 + r2) / 2, width], axis=-1)
    strokes: _F64 = made[paired]
    return strokes


def _lateral(segments: _F64, x_m: _F64) -> _F64:
    x1, y1, x2, y2 = (segments[..., k] for k in range(4))
    y: _F64 = y1 + (y2 - y1) * (x_m - x1) / (x2 - x1)
    return y


def follow_segments(
    channels: Sequence[_F32], evidence: _F32, grid: RoadGrid, config: LaneConfig
) -> list[_F64]:
    """Return courses (rows,) y of each row of lines of paint.

    Args:
        channels: Images (rows, columns) on the grid in which paint is brighter than the road.
        evidence: (rows, columns) float32 0..1 of paint: a stroke needs it along itself, since
            an even contrast makes edges of the grain of a road too.
        grid: The grid.
        config: Settings.
    """
    found = [_strokes(edge_segments(enhanced(c), grid), grid, config) for c in channels]
    strokes = np.concatenate(found)
    if not len(strokes):
        return []
    c1, c2 = (np.round(grid.column(strokes[:, k])).astype(np.int64) for k in (1, 3))
    r1, r2 = (
        np.round((strokes[:, k] - grid.x_m[0]) / grid.step_m).astype(np.int64) for k in (0, 2)
    )
    shown = _mean_along(cv2.dilate(evidence, np.ones((1, 3))), c1, r1, c2, r2)
    x = grid.x_m
    return [p[0] + p[1] * x + p[2] * x**2 for p in join_strokes(strokes[shown > _SHOWN])]


def join_strokes(strokes: _F64) -> list[_F64]:
    """Cluster strokes that continue each other, and return a polynomial (3,) of y(x) for each.

    Args:
        strokes: (N, 5) x1, y1, x2, y2, width in metres.
    """
    clusters: list[_Cluster] = []
    for stroke in strokes[np.argsort(strokes[:, 0])]:
        x, y = stroke[0], stroke[1]
        fits = [
            (abs(c.expected(x) - y), c)
            for c in clusters
            if x - c.end_m < _GAP_M and abs(c.expected(x) - y) < 0.25 + 0.02 * max(0, x - c.end_m)
        ]
        if fits:
            min(fits, key=lambda fit: fit[0])[1].strokes.append(stroke[:4])
        else:
            clusters.append(_Cluster([stroke[:4]]))
    return [_fitted(cluster) for cluster in clusters]


def _fitted(cluster: _Cluster) -> _F64:
    x, y = np.concatenate([s.reshape(2, 2) for s in cluster.strokes]).T
    lengths = np.repeat([s[2] - s[0] for s in cluster.strokes], 2)
    return fit_line(x, y, lengths, scale_m=0.15)
