"""Birth, confirmation and end of tracks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.core.box_overlap import iou_bev
from percept.tracking.track_table import TrackTable, boxes_of

__all__ = ["alive", "confirmed", "without_duplicates"]

_F64 = NDArray[np.float64]


def confirmed(tracks: TrackTable, t_birth_ns: _F64) -> NDArray[np.bool_]:
    """Return (N,) which tracks are full: once they are, or seen over t_birth (N,)."""
    seen_twice = tracks["hits"] > 1
    full: NDArray[np.bool_] = tracks["full"] | (
        seen_twice & (tracks["seen_ns"] - tracks["born_ns"] >= t_birth_ns)
    )
    return full


def alive(
    tracks: TrackTable, stamp_ns: int, t_expire_ns: _F64, t_prune_ns: _F64
) -> NDArray[np.bool_]:
    """Return (N,) which tracks were seen recently enough.

    Full ones within t_expire (N,), trial ones within t_prune (N,).
    """
    kept: NDArray[np.bool_] = stamp_ns - tracks["seen_ns"] <= np.where(
        tracks["full"], t_expire_ns, t_prune_ns
    )
    return kept


def without_duplicates(tracks: TrackTable, largest_overlap: float) -> NDArray[np.bool_]:
    """Return (N,) which tracks stay when of two on one place the less certain one goes.

    Full goes before trial, then seen now before not seen, then more detections, then the
    older id. Two full tracks that both have their own detection are two objects.
    """
    stays = np.ones(len(tracks), bool)
    doubtful = np.flatnonzero(~(tracks["full"] & tracks["observed"]))
    if len(tracks) < 2 or not len(doubtful):
        return stays
    boxes = boxes_of(tracks)
    overlaps = iou_bev(boxes[doubtful], boxes) > largest_overlap
    overlaps[np.arange(len(doubtful)), doubtful] = False
    if not overlaps.any():
        return stays
    ranks = _ranks(tracks)
    for row, other in np.argwhere(overlaps):
        first = doubtful[row]
        if stays[first] and stays[other]:
            stays[other if ranks[first] < ranks[other] else first] = False
    return stays


def _ranks(tracks: TrackTable) -> NDArray[np.intp]:
    """Return (N,) the place of each track when the most certain one comes first."""
    order = np.lexsort((tracks["id"], -tracks["hits"], ~tracks["observed"], ~tracks["full"]))
    ranks = np.empty(len(tracks), np.intp)
    ranks[order] = np.arange(len(tracks))
    return ranks
