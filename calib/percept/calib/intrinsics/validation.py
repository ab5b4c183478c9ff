"""Tests of a camera on views that it was not fitted to.

Three questions, each with its own split of the views. Leaving out a block of neighbouring views at
a time gives the held-out error and the jackknife's spread. Odd against even views, and the first
half against the second, give two cameras that share no view: how differently they project is what
a user of the calibration will meet.

Sources: Efron 1982 (grouped jackknife); Liang and Zeger 1986, Bell and McCaffrey 2002 (spread of
clustered data); mrcal's documentation, "Cross-validation".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.intrinsics.projection_uncertainty import (
    GRID,
    pixel_grid,
    projection_change,
    projection_sd,
    rays_difference,
)
from percept.calib.intrinsics.solver import (
    BOARD_SHAPE,
    PRIOR_NOISE_PX,
    Estimate,
    Observations,
    Solution,
    solve,
)
from percept.calib.intrinsics.start import camera_of
from percept.core.errors import GeometryError

__all__ = ["Fit", "HalvesDifference", "Validation", "clustering", "fit_of", "validate"]

_F64 = NDArray[np.float64]

_BLOCKS = 10
_FEWEST_VIEWS_A_HALF = 3
_STEPS = 25
_CHANCE = 1.5  # 97 % of chi over its 9 degrees of freedom
_SURPRISE = 2.0  # chance alone makes halves differ by less, see `HalvesDifference`
_LARGEST_SURPRISE = 100.0
_GAIN = 1e-5  # a tenth of a standard deviation, and steps shrink quadratically
_NONE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A solution with what its residuals say about the noise of a corner.

    Attributes:
        solution: Camera, poses and residuals.
        noise_px: Standard deviation of a corner along one axis.
        covariance: (P, P) of the free shared parameters under independent noise.
    """

    solution: Solution
    noise_px: float
    covariance: _F64


@dataclass(frozen=True, slots=True, eq=False)
class HalvesDifference:
    """How two cameras differ that were fitted to disjoint halves of the views.

    Attributes:
        split: What the halves are.
        difference_px: (rows, columns) from edge to edge of the image, after a rotation; infinite
            where one of the two has no ray, NaN where the camera of all views has none.
        expected_px: (rows, columns) what the noise of the corners alone would give (1 sigma).
    """

    split: str
    difference_px: _F64
    expected_px: _F64

    def percentile_px(self, percent: float) -> float:
        """Return a percentile of the difference over the part of the image that has rays."""
        difference = self.difference_px[~np.isnan(self.difference_px)]
        if not len(difference):
            return np.inf
        return float(np.percentile(difference, percent, method="inverted_cdf"))

    @property
    def times_expected(self) -> float:
        """The median over the image of difference by expectation: about 1 when all is well."""
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = self.difference_px / self.expected_px
        ratio = ratio[np.isfinite(ratio)]
        return float(np.median(ratio)) if len(ratio) else np.inf


@dataclass(frozen=True, slots=True, eq=False)
class Validation:
    """What the views say about a fit when some are left out of it.

    Attributes:
        holdout_px2: (V,) mean squared error of each view under a camera that was fitted without
            it, its pose being fitted.
        covariance: (P, P) of the free shared parameters: that of independent noise, inflated
            where blocks of views disagree by more.
        uncertainty_px: (rows, columns) standard deviation of the projection from edge to edge of
            the image, after a rotation; NaN where the camera has no ray.
        inflation: Factor of its variances over those of independent noise.
        weights: (N,) of the grid's pixels for the rotation between two cameras.
        halves: Odd against even views, and first against second half; empty for too few views.
    """

    holdout_px2: _F64
    covariance: _F64
    uncertainty_px: _F64
    inflation: float
    weights: _F64
    halves: tuple[HalvesDifference, ...]

    @property
    def holdout_rms_px(self) -> float:
        """Root mean square over the views' held-out errors."""
        return float(np.sqrt(self.holdout_px2.mean()))


def fit_of(views: Observations, solution: Solution) -> Fit:
    """Return a fit with its noise and covariance.

    The noise is that of the residuals, with the degrees of freedom that the fit has used up
    taken off.
    """
    counted = views.weights > 0
    squares = float((solution.residuals[counted] ** 2).sum())
    freedom = 2 * int(counted.sum()) - len(solution.free) - 6 * len(views)
    noise = np.sqrt(squares / max(freedom, 1))
    return Fit(solution, float(noise), covariance_of(solution, noise**2))


def validate(views: Observations, fit: Fit, image_size: tuple[int, int]) -> Validation:
    """Fit the camera again to parts of the views.

    The covariance of independent noise is inflated by what the blocks of views show, see
    `clustering`, and by the difference of the halves where chance does not explain it. The map of
    the projection takes the jackknife's value where that is larger by more than chance: far from
    the views the lens is not linear.

    Args:
        views: What was seen, all of it used; at least two views.
        fit: The fit to all views.
        image_size: (width, height) in pixels.
    """
    full, pixels = fit.solution, pixel_grid(image_size)
    camera = camera_of(full.estimate, image_size)
    change, weights = projection_change(
        camera, _of_camera(full), pixels, _of_camera_only(fit.covariance, full)
    )
    every, holdout = np.arange(len(views)), np.full(len(views), np.inf)
    moved, rays = [], camera.unproject(pixels)
    for block in _blocks(len(views)):
        without = _refit(views, full, np.setdiff1d(every, block)).estimate
        holdout[block] = _held_out(views, full, without, block)
        moved.append(_difference(rays, without, image_size, pixels, weights))
    halves = tuple(_halves(views, full, image_size, change, weights))
    surprise = max((h.times_expected for h in halves if h.times_expected > _SURPRISE), default=1.0)
    inflation = max(clustering(fit), min(surprise, _LARGEST_SURPRISE) ** 2)
    covariance = covariance_of(full, inflation * fit.noise_px**2)
    propagated = projection_sd(change, _of_camera_only(covariance, full))
    jackknife = np.sqrt((1 - 1 / len(moved)) * np.square(moved).sum(axis=0))
    with np.errstate(invalid="ignore"):
        seen_sd = np.where(jackknife > _CHANCE * propagated, jackknife, propagated)
    uncertainty = seen_sd.reshape(GRID[::-1])
    return Validation(holdout, covariance, uncertainty, inflation, weights, halves)


def clustering(fit: Fit) -> float:
    """Return by how much the variances exceed those of independent corners; 1 or more.

    What a view says is pulled one way by what its corners share: a bent board, blur, a lens that
    the model does not quite fit. The scores of blocks of neighbouring views show it (Liang and
    Zeger 1986), compared with what they would be under independent noise, the share that the
    fit takes away with each block's leverage included (as in Bell and McCaffrey 2002).
    """
    full = fit.solution
    inverse = covariance_of(full, 1.0)
    blocks = _blocks(len(full.scores))
    scores = np.array([full.scores[block].sum(axis=0) for block in blocks])
    leverage = inverse @ np.array([full.informations[block].sum(axis=0) for block in blocks])
    found = np.einsum("bp,pq,bq->", scores, inverse, scores)
    expected = np.einsum("bpp->", leverage) - np.einsum("bpq,bqp->", leverage, leverage)
    if not expected > 0:
        return 1.0
    return max(float(found / expected) / fit.noise_px**2, 1.0)


def _blocks(count: int) -> list[NDArray[np.int64]]:
    return np.array_split(np.arange(count), min(_BLOCKS, count))


def _halves(
    views: Observations,
    full: Solution,
    image_size: tuple[int, int],
    change: _F64,
    weights: _F64,
) -> Iterator[HalvesDifference]:
    every, pixels = np.arange(len(views)), pixel_grid(image_size)
    splits = {
        "odd and even views": (every[::2], every[1::2]),
        "first and second half": (every[: len(every) // 2], every[len(every) // 2 :]),
    }
    for name, halves in splits.items():
        if min(len(half) for half in halves) < _FEWEST_VIEWS_A_HALF:
            continue
        fits = [fit_of(views.of_views(half), _refit(views, full, half)) for half in halves]
        both = sum((_of_camera_only(f.covariance, full) for f in fits), np.zeros(()))
        expected = np.sqrt(np.einsum("nip,pq,niq->n", change, both, change))
        try:
            rays = camera_of(fits[0].solution.estimate, image_size).unproject(pixels)
        except GeometryError:
            difference = np.full(len(pixels), np.nan)
        else:
            difference = _difference(rays, fits[1].solution.estimate, image_size, pixels, weights)
        difference[np.isnan(difference) & (weights > 0)] = np.inf
        yield HalvesDifference(name, difference.reshape(GRID[::-1]), expected.reshape(GRID[::-1]))


def _refit(views: Observations, full: Solution, chosen: NDArray[np.int64]) -> Solution:
    start = full.estimate.of_views(chosen)
    return solve(views.of_views(chosen), start, full.free, steps=_STEPS, smallest_gain=_GAIN)


def _held_out(
    views: Observations, full: Solution, camera: Estimate, block: NDArray[np.int64]
) -> _F64:
    """Return the mean squared error (B,) of views of which only the poses are fitted."""
    poses = full.estimate.of_views(block)
    start = Estimate(camera.model, camera.shared, poses.R_camera_board, poses.t_camera_board)
    held = views.of_views(block)
    found = solve(held, start, _NONE, steps=_STEPS, smallest_gain=_GAIN)
    squared = (found.residuals**2).sum(axis=(1, 2))
    mean: _F64 = squared / held.weights.sum(axis=1)
    return mean


def _difference(
    rays: _F64,
    other: Estimate,
    image_size: tuple[int, int],
    pixels: _F64,
    weights: _F64,
) -> _F64:
    """Return the projection difference (N,); NaN all over for numbers that make no camera."""
    try:
        return rays_difference(rays, camera_of(other, image_size), pixels, weights)
    except GeometryError:
        return np.full(len(pixels), np.nan)


def _of_camera(full: Solution) -> NDArray[np.int64]:
    """Return the free parameters that belong to the camera: the board's shape does not."""
    return full.free[full.free < len(full.estimate.shared) - BOARD_SHAPE]


def _of_camera_only(covariance: _F64, full: Solution) -> _F64:
    count = len(_of_camera(full))
    return covariance[:count, :count]


def covariance_of(solution: Solution, noise_px2: float) -> _F64:
    """Return the covariance (P, P) of the free parameters for a variance of the corners.

    The pull to zero of `intrinsics_solver` is knowledge of its own, not more uncertain when the
    corners are.
    """
    prior = solution.prior / PRIOR_NOISE_PX**2
    measured = solution.information / max(noise_px2, 1e-300)
    information = measured + np.diag(prior)
    # At unit scale; directions that nothing determines become very uncertain.
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-12))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    inverse = (vectors / np.maximum(values, 1e-13)) @ vectors.T
    covariance: _F64 = inverse * np.outer(scale, scale)
    return covariance
