"""Where in space the objects in 2D boxes are: from the points of a scan, or a depth image.

Where nothing tells, a position is unknown (NaN) and not guessed. Nothing corrects for the motion
between a scan and an image; `ScanMatcher` keeps them less than 100 ms apart. Boxes count from the
outer edge of the top left pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.errors import GeometryError
from percept.core.results import Detections2D
from percept.core.transform import Transform
from percept.detection.result import Positions
from percept.detection.space.box_points import points_of_boxes
from percept.lidar.result import ScanResult

__all__ = ["best_positions", "locate_boxes", "locate_in_depth"]

_F64 = NDArray[np.float64]

_TRIMMED_PERCENT = (5.0, 95.0)
_MOST_DEPTH_PIXELS_A_SIDE = 48
_FEWEST_DEPTH_PIXELS = 5
_LEAST_KNOWN_DEPTH = 0.1
_LEAST_NEAR_SHARE = 0.2
_DEPTH_GAP_M, _DEPTH_GAP_SHARE = 0.3, 0.03
_LARGEST_STRETCH = 0.01


def locate_boxes(
    detections: Detections2D, camera: Camera, T_camera_cloud: Transform, scan: ScanResult
) -> Positions:
    """Return where the objects in the boxes of an image are, as far as a scan tells.

    `box_points` says which points of the scan are the object in a box.

    Args:
        detections: Boxes in pixels of the recorded image.
        camera: The camera.
        T_camera_cloud: Maps points of the scan's cloud into the camera's optical frame.
        scan: The scan nearest in time, with its ground and clusters.

    Returns:
        Positions in the cloud's frame: the middle of the extent of the object's points (5th to
        95th percentile of each axis). An object is measured from one side, so that this lies
        between its surface and its centre.

    Raises:
        GeometryError: If the transform does not start at the cloud's frame.
    """
    cloud = scan.cloud
    if T_camera_cloud.source != cloud.frame:
        raise GeometryError(
            f"T_{T_camera_cloud.target}_{T_camera_cloud.source} does not fit a cloud in frame "
            f"'{cloud.frame}'",
            where=cloud.topic,
        )
    found = points_of_boxes(detections.boxes_px, camera, T_camera_cloud, scan)
    points_m = np.full((len(found), 3), np.nan)
    for box, rows in enumerate(found):
        if len(rows):
            points = cloud.points_xyz[rows].astype(np.float64)
            points_m[box] = np.percentile(points, _TRIMMED_PERCENT, axis=0).mean(axis=0)
    return Positions(
        cloud.frame,
        points_m,
        np.linalg.norm(points_m - T_camera_cloud.inverse().translation_m, axis=1),
        tuple("cluster" if len(rows) else "" for rows in found),
        np.array([len(rows) for rows in found], dtype=np.int64),
    )


def locate_in_depth(
    detections: Detections2D, camera: Camera, depth: NDArray[Any], T_target_camera: Transform
) -> Positions:
    """Return where the objects in the boxes of an image are, as far as its depth image tells.

    The depth of an object is the median of the nearest mode in the central half of its box; it is
    unknown where fewer than a tenth of the pixels there have one.

    Args:
        detections: Boxes in pixels of the recorded image.
        camera: The camera of the image, with which the depth image is registered.
        depth: (H, W) along the optical axis, float metres or uint16 millimetres; 0 and what is
            not finite is unknown. It shows the same view, whatever its resolution.
        T_target_camera: Maps the camera's optical frame into the frame to give points in.

    Raises:
        GeometryError: If the array is no depth image, or has not the shape of the camera's.
    """
    depth_m = _metres(depth)
    scale = np.array(depth_m.shape[::-1]) / camera.image_size
    if abs(scale[0] / scale[1] - 1) > _LARGEST_STRETCH:
        raise GeometryError(
            f"a depth image of {depth.shape[1]} x {depth.shape[0]} pixels does not show what an "
            f"image of {camera.image_size[0]} x {camera.image_size[1]} shows"
        )
    modes = [_near_mode(_central_half(depth_m, b)) for b in detections.boxes_px * [*scale, *scale]]
    middles_px = (detections.boxes_px[:, :2] + detections.boxes_px[:, 2:]) / 2 - 0.5
    rays = camera.unproject(middles_px)
    points_cam = rays / rays[:, 2:] * np.array([[mode[0]] for mode in modes]).reshape(-1, 1)
    known = np.isfinite(points_cam).all(axis=1)
    return Positions(
        T_target_camera.target,
        T_target_camera.apply(points_cam),
        np.linalg.norm(points_cam, axis=1),
        tuple("depth" if row else "" for row in known),
        np.where(known, np.array([mode[1] for mode in modes], dtype=np.int64), 0),
    )


def best_positions(candidates: Sequence[Positions]) -> Positions:
    """Join the positions that several sensors give for the same boxes.

    For each box that one counts which rests on the most points; of equals, the first.

    Args:
        candidates: At least one; each for the same boxes, in one frame.

    Raises:
        GeometryError: If there is none, or frames or numbers of boxes differ.
    """
    if len({(c.frame_id, len(c.points)) for c in candidates}) != 1:
        raise GeometryError("positions to join are of the same boxes, in one frame")
    points = np.stack([c.points for c in candidates])
    best = points.argmax(axis=0)
    rows = np.arange(points.shape[1])
    return Positions(
        candidates[0].frame_id,
        np.stack([c.points_m for c in candidates])[best, rows],
        np.stack([c.range_m for c in candidates])[best, rows],
        tuple(candidates[k].sources[row] for row, k in enumerate(best)),
        points[best, rows],
    )


def _metres(depth: NDArray[Any]) -> NDArray[Any]:
    """Return a depth image in metres, unknown as it was."""
    if depth.ndim == 2 and depth.size and depth.dtype == np.uint16:
        return depth * np.float32(1e-3)
    if depth.ndim == 2 and depth.size and np.issubdtype(depth.dtype, np.floating):
        return depth
    raise GeometryError(
        f"depth images are (H, W) of float metres or uint16 millimetres, not {depth.shape} of "
        f"{depth.dtype}"
    )


def _central_half(depth_m: NDArray[Any], box_px: _F64) -> _F64:
    """Return the depths in the middle half of the width and the height of a box, thinned out."""
    middle, quarter = (box_px[:2] + box_px[2:]) / 2, (box_px[2:] - box_px[:2]) / 4
    x1, y1 = np.floor(np.clip(middle - quarter, 0, None)).astype(int)
    x2, y2 = np.ceil(np.clip(middle + quarter, 0, None)).astype(int)
    steps = [max(1, side // _MOST_DEPTH_PIXELS_A_SIDE) for side in (y2 - y1, x2 - x1)]
    return depth_m[y1 : y2 : steps[0], x1 : x2 : steps[1]].ravel().astype(np.float64)


def _near_mode(depths_m: _F64) -> tuple[float, int]:
    """Return the median of the nearest group of enough depths, and its number; NaN without."""
    with np.errstate(invalid="ignore"):
        known = np.sort(depths_m[np.isfinite(depths_m) & (depths_m > 0)])
    if len(known) < max(_FEWEST_DEPTH_PIXELS, _LEAST_KNOWN_DEPTH * len(depths_m)):
        return np.nan, 0
    gaps = np.diff(known) > _DEPTH_GAP_M + _DEPTH_GAP_SHARE * known[:-1]
    groups = np.split(known, np.flatnonzero(gaps) + 1)
    near = next(g for g in groups if len(g) >= min(_LEAST_NEAR_SHARE, 1 / len(groups)) * len(known))
    return float(np.median(near)), len(near)
