"""Following the boxes of lights in the images of one camera, without a map.

Lights stand still, so that all boxes of an image move by much the same amount when the camera
shakes. This common offset is found first; then each box has its own constant velocity.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["BoxTracks", "follow_boxes"]

_GATE_HEIGHTS = 1.5
_OFFSET_GATE_HEIGHTS = 4.0
_GATE_PX = 12.0
_SIZE_WEIGHT = 1.0
_LARGEST_COST = 1.0
_VELOCITY_GAIN = 0.3
_SIZE_GAIN = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class BoxTracks:
    """The boxes that are followed in one camera.

    Attributes:
        stamp_ns: When they were last brought up to date.
        ids: (T,) int64.
        centres_px: (T, 2) float64.
        sizes_px: (T, 2) float64 width and height.
        velocities_px_s: (T, 2) float64.
        seen_ns: (T,) int64 when each was last seen.
    """

    stamp_ns: int = 0
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    centres_px: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    sizes_px: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    velocities_px_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    seen_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def __len__(self) -> int:
        return len(self.ids)


def follow_boxes(
    tracks: BoxTracks, stamp_ns: int, boxes_px: NDArray[np.float64], next_id: int, death_ns: int
) -> tuple[BoxTracks, NDArray[np.int64]]:
    """Match boxes to tracks; what is left over begins new tracks.

    Args:
        tracks: Those of the camera so far.
        stamp_ns: Time of the image.
        boxes_px: (N, 4) x1, y1, x2, y2.
        next_id: The first id that is free.
        death_ns: Tracks that were not seen for so long end.

    Returns:
        The tracks after this image, and the (N,) id of each box.
    """
    young = stamp_ns - tracks.seen_ns <= death_ns
    alive = tracks if young.all() else _subset(tracks, young)
    if not len(alive) and not len(boxes_px):
        return BoxTracks(stamp_ns), np.zeros(0, np.int64)
    dt_s = (stamp_ns - alive.stamp_ns) / 1e9
    centres, sizes = (boxes_px[:, :2] + boxes_px[:, 2:]) / 2, boxes_px[:, 2:] - boxes_px[:, :2]
    predicted = alive.centres_px + alive.velocities_px_s * dt_s
    offset = _common_offset(predicted, alive.sizes_px, centres, sizes)
    pairs = _pairs(predicted + offset, alive.sizes_px, centres, sizes, _GATE_HEIGHTS)
    moved = _moved(alive, stamp_ns, predicted + offset, centres, sizes, pairs, dt_s)
    ids = np.full(len(boxes_px), -1, np.int64)
    ids[pairs[:, 1]] = alive.ids[pairs[:, 0]]
    new = ids < 0
    if not new.any():
        return moved, ids
    ids[new] = next_id + np.arange(new.sum())
    born = BoxTracks(
        stamp_ns, ids[new], centres[new], sizes[new], np.zeros((new.sum(), 2)),
        np.full(new.sum(), stamp_ns),
    )  # fmt: skip
    return _joined(moved, born), ids


def _common_offset(
    predicted: NDArray[np.float64],
    track_sizes: NDArray[np.float64],
    centres: NDArray[np.float64],
    sizes: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the (2,) median by which boxes lie off their predictions; 0 with fewer than two."""
    if min(len(predicted), len(centres)) < 2:
        return np.zeros(2)
    pairs = _pairs(predicted, track_sizes, centres, sizes, _OFFSET_GATE_HEIGHTS)
    if len(pairs) < 2:
        return np.zeros(2)
    offset: NDArray[np.float64] = np.median(centres[pairs[:, 1]] - predicted[pairs[:, 0]], axis=0)
    return offset


def _pairs(
    predicted: NDArray[np.float64],
    track_sizes: NDArray[np.float64],
    centres: NDArray[np.float64],
    sizes: NDArray[np.float64],
    gate_heights: float,
) -> NDArray[np.int64]:
    """Return (P, 2) tracks and boxes of the cheapest assignment within the gate (Kuhn 1955)."""
    if not len(predicted) or not len(centres):
        return np.zeros((0, 2), np.int64)
    from scipy.optimize import linear_sum_assignment

    apart = np.linalg.norm(predicted[:, None] - centres[None], axis=2)
    heights = (track_sizes[:, None, 1] + sizes[None, :, 1]) / 2
    gates = np.maximum(gate_heights * heights, _GATE_PX)
    ratio = np.abs(np.log(np.maximum(track_sizes[:, None], 1) / np.maximum(sizes[None], 1)))
    cost = apart / gates + _SIZE_WEIGHT * ratio.mean(axis=2) / 2
    rows, columns = linear_sum_assignment(np.minimum(cost, _LARGEST_COST))
    kept = cost[rows, columns] < _LARGEST_COST
    return np.column_stack([rows[kept], columns[kept]]).astype(np.int64)


def _moved(
    tracks: BoxTracks,
    stamp_ns: int,
    predicted: NDArray[np.float64],
    centres: NDArray[np.float64],
    sizes: NDArray[np.float64],
    pairs: NDArray[np.int64],
    dt_s: float,
) -> BoxTracks:
    """Return the tracks after the image: alpha-beta filter (Kalata 1984) with alpha 1."""
    rows, columns = pairs[:, 0], pairs[:, 1]
    new_centres, new_sizes = predicted.copy(), tracks.sizes_px.copy()
    velocities, seen = tracks.velocities_px_s.copy(), tracks.seen_ns.copy()
    if dt_s > 0:
        velocities[rows] += _VELOCITY_GAIN * (centres[columns] - predicted[rows]) / dt_s
    new_centres[rows] = centres[columns]
    new_sizes[rows] += _SIZE_GAIN * (sizes[columns] - new_sizes[rows])
    seen[rows] = stamp_ns
    return BoxTracks(stamp_ns, tracks.ids, new_centres, new_sizes, velocities, seen)


def _subset(tracks: BoxTracks, kept: NDArray[np.bool_]) -> BoxTracks:
    return BoxTracks(
        tracks.stamp_ns, tracks.ids[kept], tracks.centres_px[kept], tracks.sizes_px[kept],
        tracks.velocities_px_s[kept], tracks.seen_ns[kept],
    )  # fmt: skip


def _joined(first: BoxTracks, second: BoxTracks) -> BoxTracks:
    return BoxTracks(
        first.stamp_ns,
        np.concatenate([first.ids, second.ids]),
        np.concatenate([first.centres_px, second.centres_px]),
        np.concatenate([first.sizes_px, second.sizes_px]),
        np.concatenate([first.velocities_px_s, second.velocities_px_s]),
        np.concatenate([first.seen_ns, second.seen_ns]),
    )
