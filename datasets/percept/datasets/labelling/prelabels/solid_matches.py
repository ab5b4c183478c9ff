"""Which 3D box each box of an image shows, and which 3D boxes the networks missed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.settings import Settings
from percept.datasets.labelling.prelabels.categories import UNKNOWN, kind_of
from percept.datasets.labelling.prelabels.network_boxes import SeenBoxes, overlaps, shares_inside
from percept.datasets.labelling.prelabels.project_solids import ProjectedSolids

__all__ = ["LinkConfig", "is_known", "is_small", "lone_solids", "match_solids"]

_I64 = NDArray[np.int64]
_F64 = NDArray[np.float64]
_Mask = NDArray[np.bool_]

_THINNEST_PX = 2.0

# What speaks against a pair beside how little it overlaps, in shares of an overlap.
_HIDDEN_COST = 0.5
_OTHER_KIND_COST = 0.25
_UNKNOWN_KIND_COST = 0.1


class LinkConfig(Settings):
    """When boxes are one object.

    Attributes:
        same_iou: Boxes of two networks of one kind that overlap so much are one object.
        any_iou: So are boxes of different kinds that overlap so much.
        solid_iou: A 3D box may be the object of a 2D box from this overlap on.
        sure_iou: The same where their kinds differ, or where the 3D box should not be seen.
        part_iou: The same of a 3D box that lies within the 2D box of its kind: LiDARs see a part
            of what is far away.
        inside_share: From this share on a box is within another.
        hidden_share: A 3D box that others hide to a larger share is not seen in the image.
        cut_share: Nor is one of which more than this share is outside the image.
        least_px: Boxes whose longer side is shorter than this are left out, and all slivers.
        still_ms: An image that is farther than this in time from the 3D boxes is not linked
            with them where the vehicle's motion between both is not known.
    """

    same_iou: float = Field(default=0.45, gt=0, le=1)
    any_iou: float = Field(default=0.8, gt=0, le=1)
    solid_iou: float = Field(default=0.3, gt=0, le=1)
    sure_iou: float = Field(default=0.6, gt=0, le=1)
    part_iou: float = Field(default=0.1, gt=0, le=1)
    inside_share: float = Field(default=0.7, gt=0, le=1)
    hidden_share: float = Field(default=0.8, gt=0, le=1)
    cut_share: float = Field(default=0.9, gt=0, le=1)
    least_px: float = Field(default=8.0, gt=0)
    still_ms: float = Field(default=20.0, ge=0)


def is_known(labels: tuple[str, ...]) -> _Mask:
    """Return (N,) which classes say more than that something is there."""
    return np.array([label != UNKNOWN for label in labels], dtype=bool)


def is_small(sizes_px: _F64, config: LinkConfig) -> _Mask:
    """Return (N,) which boxes of some widths and heights (N, 2) are too small to be labelled."""
    slivers = sizes_px.min(axis=1, initial=np.inf) < _THINNEST_PX
    small: _Mask = slivers | (sizes_px.max(axis=1, initial=0.0) < config.least_px)
    return small


def match_solids(
    seen: SeenBoxes, labels: tuple[str, ...], projected: ProjectedSolids, config: LinkConfig
) -> _I64:
    """Return (M,) which 3D box each box of an image shows, or -1; none twice (Hungarian).

    Of several that overlap alike, one that others hide is the less likely.

    Args:
        seen: M boxes of the image.
        labels: Categories of N 3D boxes.
        projected: These in the image.
        config: Settings.
    """
    matches = np.full(len(seen), -1, dtype=np.int64)
    rows = np.flatnonzero(projected.truncated <= config.cut_share)
    if not len(rows) or not len(seen):
        return matches
    same, known = _same_kind(seen.labels, labels)[:, rows], is_known(labels)[rows]
    iou = overlaps(seen.boxes_px, projected.boxes_px[rows])
    within = config.inside_share < shares_inside(projected.boxes_px[rows], seen.boxes_px).T
    hidden = projected.occluded[rows]
    needed = np.where(same & within, config.part_iou, config.solid_iou)
    needed = np.where((same | ~known) & (hidden <= config.hidden_share), needed, config.sure_iou)
    cost = _HIDDEN_COST * hidden + np.where(
        known, np.where(same, 0.0, _OTHER_KIND_COST), _UNKNOWN_KIND_COST
    )
    allowed = iou >= needed
    gain = np.where(allowed, 1.0 + iou - cost, 0.0)
    from scipy.optimize import linear_sum_assignment  # half a second, for runs with boxes only

    boxes, columns = linear_sum_assignment(gain, maximize=True)
    found = allowed[boxes, columns]
    matches[boxes[found]] = rows[columns[found]]
    return matches


def lone_solids(
    seen: SeenBoxes,
    labels: tuple[str, ...],
    projected: ProjectedSolids,
    matches: _I64,
    config: LinkConfig,
) -> tuple[_I64, int]:
    """Return the 3D boxes that should be seen and that no box of an image shows.

    Args:
        seen: M boxes of the image.
        labels: Categories of N 3D boxes; those of unknown class are not among the result.
        projected: These in the image.
        matches: As `match_solids` returns them.
        config: Settings.

    Returns:
        Rows, rising, and how many others are parts of an object that has a box already.
    """
    with np.errstate(invalid="ignore"):
        shown = is_known(labels) & (projected.occluded <= config.hidden_share)
    shown &= ~is_small(projected.sizes_px(), config)
    shown &= projected.truncated <= config.cut_share
    shown[matches[matches >= 0]] = False
    rows = np.flatnonzero(shown)
    within = shares_inside(projected.boxes_px[rows], seen.boxes_px) > config.inside_share
    parts = (within & _same_kind(seen.labels, labels)[:, rows].T).any(axis=1)
    return rows[~parts], int(np.count_nonzero(parts))


def _same_kind(labels: tuple[str, ...], others: tuple[str, ...]) -> _Mask:
    """Return (N, M) which classes are of one kind."""
    kinds = np.array([kind_of(label) for label in labels], dtype=object)
    same: _Mask = kinds[:, None] == np.array([kind_of(o) for o in others], dtype=object)[None]
    return same
