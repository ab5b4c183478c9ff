"""Which tracked object a box in an image shows: the image-plane form of the association cost.

The 3D boxes of the tracks are projected into the image, and the boxes there are assigned to
them by overlap, distance, shape and class (Burnett et al., aUToTrack, 2019, equation 1, with
pixels in place of metres). An image tells no distance, so of two objects that project onto each
other only the nearer one can be what is seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.optimize import linear_sum_assignment

from percept.core.box_edges import NEAR_PLANE_M, box_corners, project_edges
from percept.core.cameras import Camera
from percept.core.settings import Settings
from percept.core.transform import Transform

__all__ = ["ImageMatchConfig", "ProjectedBoxes", "match_in_image", "project_boxes"]

_F64 = NDArray[np.float64]

_THINNEST_PX = 1e-3  # a box without area is compared as if it had one
_SAMPLES_PER_EDGE = 5  # distortion bends the edges of a box, so its corners are not enough


class ImageMatchConfig(Settings):
    """How boxes in an image are matched with projected tracks.

    Attributes:
        overlap_weight: Weight of one minus the intersection over union.
        distance_weight: Weight of the distance of the centres, in shares of the mean of both
            boxes' widths and heights.
        shape_weight: Weight of the mean difference of width and height, in natural logarithms.
        class_weight: Weight of the class cost.
        largest_cost: A pair that costs more is no match.
        farthest_centre: Centres may be that many mean box sizes apart, in each axis.
        hidden_share: A projection that one nearer object covers to this share or more is not
            visible, and no box is matched with it.
        smallest_px: A projection narrower or lower than this is not matched.
    """

    overlap_weight: float = Field(1.0, ge=0)
    distance_weight: float = Field(1.0, ge=0)
    shape_weight: float = Field(0.5, ge=0)
    class_weight: float = Field(0.5, ge=0)
    largest_cost: float = Field(1.8, gt=0)
    farthest_centre: float = Field(0.75, gt=0)
    hidden_share: float = Field(0.7, gt=0, le=1)
    smallest_px: float = Field(4.0, gt=0)


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedBoxes:
    """3D boxes as rectangles in an image.

    Attributes:
        boxes_px: (N, 4) float64 x1, y1, x2, y2, cut off at the border of the image; without
            area where nothing of the box is in it.
        depths_m: (N,) float64 depth of the centres along the optical axis.
        in_front: (N,) bool whether the whole box is in front of the camera.
    """

    boxes_px: _F64
    depths_m: _F64
    in_front: NDArray[np.bool_]


def project_boxes(boxes_m: _F64, T_camera_inertial: Transform, camera: Camera) -> ProjectedBoxes:
    """Return the rectangles that boxes cover in an image.

    The edges are cut off in front of the camera, and what is left of them is bent by the lens.
    Points beyond the angle up to which the model is one-to-one count as seen at that angle, in
    their direction, so that a box that reaches out of the image still reaches its border.

    Args:
        boxes_m: (N, 7) boxes in the inertial frame, as in `Detections3D`.
        T_camera_inertial: Pose of the camera's optical frame.
        camera: Its intrinsics.
    """
    centres = T_camera_inertial.apply(boxes_m[:, :3])
    corners = T_camera_inertial.apply(box_corners(boxes_m).reshape(-1, 3)).reshape(-1, 8, 3)
    pixels, kept = project_edges(boxes_m, T_camera_inertial, camera, _SAMPLES_PER_EDGE)
    width, height = camera.image_size
    border = np.array([width, height], dtype=np.float64) - 0.5
    low = np.where(kept[:, :, None], pixels, np.inf).min(axis=1, initial=np.inf)
    high = np.where(kept[:, :, None], pixels, -np.inf).max(axis=1, initial=-np.inf)
    boxes = np.hstack([np.clip(low, -0.5, border), np.clip(high, -0.5, border)])
    boxes[~kept.any(axis=1)] = 0.0
    return ProjectedBoxes(boxes, centres[:, 2], corners[..., 2].min(axis=1) > NEAR_PLANE_M)


def match_in_image(
    boxes_m: _F64,
    T_camera_inertial: Transform,
    camera: Camera,
    boxes_px: _F64,
    class_costs: _F64,
    config: ImageMatchConfig,
) -> NDArray[np.int64]:
    """Return which tracked box each box of an image shows.

    Args:
        boxes_m: (N, 7) tracked boxes in the inertial frame, at the time of the image.
        T_camera_inertial: Pose of the camera's optical frame at that time.
        camera: Its intrinsics.
        boxes_px: (M, 4) boxes in the image, x1, y1, x2, y2.
        class_costs: (N, M) what speaks against it that the object has the class of the box:
            0 for nothing, 1 for everything.
        config: Weights and gates.

    Returns:
        (M,) int64 index of the tracked box, or -1 where none fits. No tracked box is used twice.
    """
    found = np.full(len(boxes_px), -1, dtype=np.int64)
    projected = project_boxes(boxes_m, T_camera_inertial, camera)
    visible = np.flatnonzero(_visible(projected, config))
    if not len(visible) or not len(boxes_px):
        return found
    costs = _costs(projected.boxes_px[visible], boxes_px, class_costs[visible], config)
    rows, columns = linear_sum_assignment(costs)
    matched = costs[rows, columns] < config.largest_cost
    found[columns[matched]] = visible[rows[matched]]
    return found


def _costs(tracked_px: _F64, seen_px: _F64, class_costs: _F64, config: ImageMatchConfig) -> _F64:
    """Return (V, M) costs; pairs that are no match have the largest cost, as a miss has."""
    size_a, size_b = _sizes(tracked_px)[:, None], _sizes(seen_px)[None]
    between = np.abs(_centres(tracked_px)[:, None] - _centres(seen_px)[None])
    apart = between / (0.5 * (size_a + size_b))
    shape = np.abs(np.log(size_a / size_b)).mean(axis=2)
    shared = _intersections(tracked_px, seen_px)
    areas = size_a.prod(axis=2) + size_b.prod(axis=2)
    costs: _F64 = (
        config.overlap_weight * (1 - shared / (areas - shared))
        + config.distance_weight * np.hypot(apart[..., 0], apart[..., 1])
        + config.shape_weight * shape
        + config.class_weight * class_costs
    )
    costs[(apart > config.farthest_centre).any(axis=2)] = np.inf
    return np.minimum(costs, config.largest_cost)


def _visible(projected: ProjectedBoxes, config: ImageMatchConfig) -> NDArray[np.bool_]:
    """Return (N,) which projections are large enough and not behind a nearer one.

    A box that reaches behind the camera hides nothing: its rectangle says too little about
    where it is in the image.
    """
    boxes, depths = projected.boxes_px, projected.depths_m
    sizes = boxes[:, 2:] - boxes[:, :2]
    large = (sizes >= config.smallest_px).all(axis=1)
    hides = (depths[None] < depths[:, None]) & projected.in_front[None]
    covered = np.where(hides, _intersections(boxes, boxes), 0.0).max(axis=1, initial=0.0)
    visible: NDArray[np.bool_] = large & (covered < config.hidden_share * sizes.prod(axis=1))
    return visible


def _sizes(boxes_px: _F64) -> _F64:
    return np.maximum(boxes_px[:, 2:] - boxes_px[:, :2], _THINNEST_PX)


def _centres(boxes_px: _F64) -> _F64:
    return 0.5 * (boxes_px[:, 2:] + boxes_px[:, :2])


def _intersections(boxes_a: _F64, boxes_b: _F64) -> _F64:
    """Return (A, B) areas that two sets of rectangles share."""
    low = np.maximum(boxes_a[:, None, :2], boxes_b[None, :, :2])
    high = np.minimum(boxes_a[:, None, 2:], boxes_b[None, :, 2:])
    shared: _F64 = np.clip(high - low, 0.0, None).prod(axis=2)
    return shared
