"""A start for the intrinsics that needs no guess.

A list of focal lengths is tried, each without distortion; the poses of a plane follow from its
homography (IPPE, Collins and Bartoli 2014), and the focal length under which most views look
like a flat board wins. Unlike Zhang's closed form it has an answer for frontal views, for
outliers, and for fisheye lenses.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.calib.intrinsics.lens import lens_pixels, zero_distortion
from percept.calib.intrinsics.solver import BOARD_SHAPE, Estimate, Observations
from percept.core.cameras import Camera, make_camera

__all__ = ["camera_of", "start_estimate", "starts_of_models", "with_best_poses"]

_F64 = NDArray[np.float64]
_Pose = tuple[_F64, _F64]

_FOCAL_SHARES = np.geomspace(0.2, 6.0, 16)  # of the longer side: 136 to 10 deg across
_LOOKED_AT = 10
_CORNERS = 60
_FAR = 10.0  # times the board's size, for views of which no pose is found


def camera_of(estimate: Estimate, image_size: tuple[int, int]) -> Camera:
    """Return the camera model of an estimate.

    Raises:
        GeometryError: If the numbers make no camera.
    """
    fx, fy, cx, cy = estimate.shared[:4]
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    return make_camera(estimate.model, image_size, K, estimate.shared[4:-BOARD_SHAPE])


def start_estimate(model: str, views: Observations, image_size: tuple[int, int]) -> Estimate:
    """Return a camera without distortion under which most views show a flat board.

    Args:
        model: Name of the lens model.
        views: What was seen; at least one view with four corners that are not on a line.
        image_size: (width, height) in pixels.
    """
    every = np.arange(len(views))
    looked_at = every[:: -(-len(views) // _LOOKED_AT)]
    corners = np.random.default_rng(0).permutation(views.pixels.shape[1])[:_CORNERS]
    few = views.of_views(looked_at).of_corners(corners)
    trials = []
    for share in _FOCAL_SHARES:
        focal = share * max(image_size)
        trial = _with_poses(_bare(model, focal, few, image_size), few, image_size)
        error = np.median(_view_rms(few, trial))
        trials.append((float(error), focal))
    _, focal = min(trials)
    return _with_poses(_bare(model, focal, views, image_size), views, image_size)


def starts_of_models(
    models: Iterable[str], views: Observations, image_size: tuple[int, int]
) -> dict[str, Estimate]:
    """Return the start of each model; without distortion all but the fisheye are one lens."""
    found: dict[str, Estimate] = {}
    for model in models:
        alike = None if model == "fisheye" else next((e for e in found.values() if _flat(e)), None)
        if alike is None:
            found[model] = start_estimate(model, views, image_size)
        else:
            bare = [alike.shared[:4], zero_distortion(model), np.zeros(BOARD_SHAPE)]
            found[model] = replace(alike, model=model, shared=np.concatenate(bare))
    return found


def _flat(estimate: Estimate) -> bool:
    return estimate.model != "fisheye"


def with_best_poses(
    estimate: Estimate, views: Observations, image_size: tuple[int, int]
) -> Estimate:
    """Return the estimate with each view's pose replaced where IPPE has one that fits better.

    A plane seen from afar has two poses that fit nearly alike; which of them is right shows
    only when the camera is known.
    """
    return _with_poses(estimate, views, image_size)


def _bare(model: str, focal: float, views: Observations, image_size: tuple[int, int]) -> Estimate:
    """Return a camera without distortion that sees all boards far in front of it."""
    width, height = image_size
    middle = [focal, focal, (width - 1) / 2, (height - 1) / 2]
    shared = np.concatenate([middle, zero_distortion(model), np.zeros(BOARD_SHAPE)])
    far = _FAR * max(float(np.abs(views.board).max()), 1e-3)
    upright = np.tile(np.eye(3), (len(views), 1, 1))
    return Estimate(model, shared, upright, np.tile([0.0, 0.0, far], (len(views), 1)))


def _with_poses(estimate: Estimate, views: Observations, image_size: tuple[int, int]) -> Estimate:
    """Return the estimate with, for each view, the best of its pose and IPPE's two."""
    counted = views.weights > 0
    rays = camera_of(estimate, image_size).unproject(views.pixels[counted])
    normal = np.zeros_like(views.pixels)
    with np.errstate(invalid="ignore"):
        normal[counted] = rays[:, :2] / rays[:, 2:]
    candidates = [
        _poses_of_plane(views.board[v, counted[v]], normal[v, counted[v]])
        for v in range(len(views))
    ]
    best, best_rms = estimate, _view_rms(views, estimate)
    for rank in (0, 1):
        R, t = best.R_camera_board.copy(), best.t_camera_board.copy()
        for view, poses in enumerate(candidates):
            if rank < len(poses):
                R[view], t[view] = poses[rank]
        trial = Estimate(estimate.model, estimate.shared, R, t)
        rms = _view_rms(views, trial)
        better = rms < best_rms
        best = Estimate(
            estimate.model,
            estimate.shared,
            np.where(better[:, None, None], R, best.R_camera_board),
            np.where(better[:, None], t, best.t_camera_board),
        )
        best_rms = np.where(better, rms, best_rms)
    return best


def _poses_of_plane(board: _F64, normal: _F64) -> list[_Pose]:
    """Return IPPE's poses of a plane; none where a ray is missing or they fail."""
    usable = np.isfinite(normal).all(axis=1)
    if usable.sum() < 4:
        return []
    try:
        _, turns, places, _ = cv2.solvePnPGeneric(
            board[usable], normal[usable], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:
        return []
    poses = [
        (
            np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64),
            np.asarray(place, dtype=np.float64).reshape(-1),
        )
        for turn, place in zip(turns, places, strict=True)
    ]
    return [(R, t) for R, t in poses if np.isfinite(R).all() and np.isfinite(t).all()]


def _view_rms(views: Observations, estimate: Estimate) -> _F64:
    """Return the rms (V,) of each view in pixels; infinite where a corner is behind the camera."""
    points = estimate.points_cam(views)
    counted = views.weights > 0
    behind = ((points[..., 2] <= 0) & counted).any(axis=1)
    points[~counted | (points[..., 2] <= 0)] = [0.0, 0.0, 1.0]
    with np.errstate(all="ignore"):
        pixels = lens_pixels(estimate.model, estimate.shared[:-BOARD_SHAPE], points)[0]
        squared = np.where(counted, ((pixels - views.pixels) ** 2).sum(axis=-1), 0.0)
        rms = np.sqrt(squared.sum(axis=1) / np.maximum(counted.sum(axis=1), 1))
    return np.where(behind | ~np.isfinite(rms), np.inf, rms)
