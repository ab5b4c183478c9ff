"""A first camera that outliers do not turn, and which views and corners do not fit the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.intrinsics.lens import free_parameters
from percept.calib.intrinsics.solver import Estimate, Observations, solve
from percept.calib.intrinsics.start import with_best_poses

__all__ = ["Sorted", "robust_estimate", "sort_views", "typical_px"]

_F64 = NDArray[np.float64]

_NONE = np.zeros(0, dtype=np.int64)
_RAYLEIGH = 1.1774  # median length of a 2D error over its standard deviation along one axis
_MAD = 1.4826  # standard deviation over median absolute deviation, of a normal distribution
_VIEW_DEVIATIONS = 4.0
_VIEW_FACTOR = 2.0
_SMALLEST_OUTLIER_PX = 0.1
_CORNER_DEVIATIONS = 5.0
_LARGEST_CORNER_SHARE = 0.1
_ROUNDS = 4
_GAIN = 1e-6  # these are starts; the last fit goes to the end
_FEWEST_VIEWS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Sorted:
    """Which views and corners fit.

    Attributes:
        used: (V,) whether a view is used.
        weights: (V, N) 1 for corners that are used, whatever their view.
        estimate: The robust camera, with the poses of all views.
        view_px: (V,) rms of every view under it, over all of its corners.
        usual_px: Median of those of the views that are used.
    """

    used: NDArray[np.bool_]
    weights: _F64
    estimate: Estimate
    view_px: _F64
    usual_px: float


def robust_estimate(
    start: Estimate, views: Observations, image_size: tuple[int, int], free: NDArray[np.int64]
) -> Estimate:
    """Return a camera of the start's model, fitted with a loss that gross errors hardly move.

    First the focal length and two radial terms with a wide loss, then each view's better pose,
    then everything with a loss at three times the noise.
    """
    first = free_parameters("pinhole", 1) if start.model == "pinhole" else free[free < 6]
    fitted = solve(
        views, start, first, robust_px=typical_px(views, start), steps=30, smallest_gain=_GAIN
    )
    posed = with_best_poses(fitted.estimate, views, image_size)
    for scale in (3.0, 3.0):
        robust_px = max(scale * typical_px(views, posed), 1e-3)
        posed = solve(views, posed, free, robust_px=robust_px, smallest_gain=_GAIN).estimate
    return posed


def sort_views(views: Observations, estimate: Estimate, free: NDArray[np.int64]) -> Sorted:
    """Find the views and corners that do not fit the camera of the others.

    A view is out when its rms stands out of the others' in the logarithm (four deviations by
    the median absolute deviation, and twice the median); a corner when it misses by five
    standard deviations of its own view. In rounds, since what is out no longer turns the camera.
    """
    every = np.arange(len(views))
    used = np.ones(len(views), dtype=bool)
    weights = views.weights.copy()
    view_px, usual = np.zeros(len(views)), 0.0
    for _ in range(_ROUNDS):
        chosen = every[used]
        robust_px = max(3 * typical_px(views.of_views(chosen), estimate.of_views(chosen)), 1e-3)
        camera = solve(
            views.weighted(weights).of_views(chosen),
            estimate.of_views(chosen),
            free,
            robust_px=robust_px,
            smallest_gain=_GAIN,
        ).estimate
        posed = Estimate(
            camera.model, camera.shared, estimate.R_camera_board, estimate.t_camera_board
        )
        all_posed = solve(views, posed, _NONE, robust_px=robust_px, smallest_gain=_GAIN)
        estimate = all_posed.estimate
        lengths = np.linalg.norm(all_posed.residuals, axis=-1)
        weights = _corner_weights(views, lengths)
        view_px = _view_rms_px(views, lengths)
        before, used = used, _fitting(view_px, used)
        usual = float(np.median(view_px[used]))
        if (used == before).all():
            break
    return Sorted(used, weights, estimate, view_px, usual)


def _view_rms_px(views: Observations, lengths: _F64) -> _F64:
    """Return the rms (V,) of each view's errors, of lengths (V, N), over the corners that count."""
    squares = (views.weights * lengths**2).sum(axis=1)
    rms: _F64 = np.sqrt(squares / np.maximum(views.weights.sum(axis=1), 1))
    return rms


def _fitting(view_px: _F64, used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    logs = np.log(np.maximum(view_px, 1e-12))
    usual = np.median(logs[used])
    spread = _MAD * np.median(np.abs(logs[used] - usual))
    limit = usual + max(_VIEW_DEVIATIONS * spread, np.log(_VIEW_FACTOR))
    fits: NDArray[np.bool_] = (logs <= limit) | (view_px < _SMALLEST_OUTLIER_PX)
    return fits if fits.sum() >= _FEWEST_VIEWS else used


def _corner_weights(views: Observations, lengths: _F64) -> _F64:
    """Return weights without the corners that stand out of their own view, a tenth at most."""
    counted = views.weights > 0
    noise = np.array(
        [np.median(row[seen]) / _RAYLEIGH for row, seen in zip(lengths, counted, strict=True)]
    )
    usual = np.median(noise)
    out = counted & (lengths > _CORNER_DEVIATIONS * np.maximum(noise, usual)[:, None])
    too_many = out.sum(axis=1) > _LARGEST_CORNER_SHARE * counted.sum(axis=1)
    out[too_many] = False
    return np.where(out, 0.0, views.weights)


def typical_px(views: Observations, estimate: Estimate) -> float:
    """Return the median error of a corner under an estimate, in pixels."""
    found = solve(views, estimate, _NONE, steps=0)
    lengths = np.linalg.norm(found.residuals, axis=-1)[views.weights > 0]
    return float(np.median(lengths))
