"""Intrinsics of a camera from views of a board, and how far they can be trusted.

The residuals decide nothing: a camera that is wrong by twenty pixels where no board was fits its
views perfectly. Models are compared, and the result judged, by views that were left out and by
how differently cameras from disjoint halves of the views project.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.calib.intrinsics.coverage import measure_coverage
from percept.calib.intrinsics.lens import COEFFICIENTS, free_parameters
from percept.calib.intrinsics.outliers import Sorted, robust_estimate, sort_views, typical_px
from percept.calib.intrinsics.projection_uncertainty import GRID, pixel_grid, projection_difference
from percept.calib.intrinsics.records import Posed, view_records
from percept.calib.intrinsics.result import (
    BoardShape,
    CameraCalibration,
    CameraFit,
    ModelTrial,
    parameter_names,
)
from percept.calib.intrinsics.solver import BOARD_SHAPE, Estimate, Observations, solve
from percept.calib.intrinsics.start import camera_of, starts_of_models
from percept.calib.intrinsics.validation import Fit, Validation, fit_of, validate
from percept.calib.intrinsics.verdict import judge, judge_nothing
from percept.calib.intrinsics.views import UsableViews, usable_views
from percept.calib.limits import CameraLimits
from percept.core.cameras import Camera
from percept.core.errors import GeometryError
from percept.core.settings import Settings

if TYPE_CHECKING:
    from percept.calib.boards.definitions import Board
    from percept.calib.boards.detection import BoardView, NoBoard

__all__ = ["CameraCalibrationConfig", "calibrate_camera"]

_F64 = NDArray[np.float64]

_NONE = np.zeros(0, dtype=np.int64)
_BEND, _STRETCH = np.array([0, 1]), np.array([2])  # of the board's shape
_SHAPE_STEPS = 5  # from the minimum of the flat and square board
_AS_GOOD = 0.02  # models whose held-out squared errors differ by less are alike,
_WORSE = 0.2  # and by more are not, whatever the scatter between views
_CLEARLY_BETTER = 3.0  # standard errors
_CLEARLY_STABLER = 2.0
_WILD = 0.5  # of the radius; a strong barrel changes it by a third
_SIMPLEST = ("pinhole", "fisheye", "rational")
_FEWEST_RAYS = 10  # of the grid of pixels; with fewer the lens folds back almost at once


class CameraCalibrationConfig(Settings):
    """Settings of `calibrate_camera`.

    Attributes:
        model: Lens model; `auto` takes the one that explains left-out views best, and of those
            that do so alike the one whose halves agree best.
        radial_coefficients: How many of k1, k2, k3 the pinhole has; the rest is zero.
        board_warp: Whether to estimate how the board is bent, by one term along its columns and
            one along its rows.
    """

    model: Literal["auto", "pinhole", "rational", "fisheye"] = "auto"
    radial_coefficients: int = Field(default=3, ge=0, le=3)
    board_warp: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """A lens model fitted to the views that are used.

    Attributes:
        fit: Camera and poses.
        validation: What left-out views say.
        largest_radius: Tangent of the widest angle from the axis at which a corner was seen.
    """

    fit: Fit
    validation: Validation
    largest_radius: float

    @property
    def model(self) -> str:
        return self.fit.solution.estimate.model


def calibrate_camera(
    views: Sequence[BoardView],
    board: Board,
    config: CameraCalibrationConfig | None = None,
    camera: str = "camera",
    rejected: Sequence[NoBoard] = (),
) -> CameraCalibration:
    """Estimate a camera from views of a board, and say how good it is.

    Args:
        views: Views in the order of their capture: corners and the indices of theirs on the board.
        board: What is printed on it.
        config: Settings; the defaults where None.
        camera: Name of the camera.
        rejected: Images without a usable board, for the record.

    Returns:
        The calibration; without a camera where fewer than three views can be used. It does not
        raise for data that is merely bad: the verdict says so.
    """
    config = config or CameraCalibrationConfig()
    usable = usable_views(views, board)
    if len(usable.indices) >= CameraLimits().fewest_views:
        found = _calibrate(usable, config)
        if found is not None:
            fit, posed = found
            records = view_records(views, rejected, usable, posed)
            verdict, why, advice = judge(fit, records)
            return CameraCalibration(camera, usable.image_size, fit, verdict, why, advice, records)
    records = view_records(views, rejected, usable, None)
    verdict, why, advice = judge_nothing(records, board.describe())
    return CameraCalibration(camera, usable.image_size, None, verdict, why, advice, records)


def _calibrate(
    usable: UsableViews, config: CameraCalibrationConfig
) -> tuple[CameraFit, Posed] | None:
    """Fit all models to the views that fit; None where no model comes to a camera."""
    size, everything = usable.image_size, usable.observations
    robust = {
        model: robust_estimate(start, everything, size, _free(model, config))
        for model, start in starts_of_models(COEFFICIENTS, everything, size).items()
    }
    leading = min(robust, key=lambda model: typical_px(everything, robust[model]))
    sorted_views = sort_views(everything, robust[leading], _free(leading, config))
    chosen = np.flatnonzero(sorted_views.used)
    observations = everything.weighted(sorted_views.weights).of_views(chosen)
    candidates = []
    for model, estimate in robust.items():
        start = (sorted_views.estimate if model == leading else estimate).of_views(chosen)
        candidate = _candidate(observations, start, _free(model, config), size)
        if candidate is not None:
            candidates.append(candidate)
    if not candidates:
        return None
    best = _choose(candidates, config.model)
    posed = _posed(best, everything, sorted_views)
    return _describe(best, candidates, observations, usable, posed), posed


def _posed(best: _Candidate, everything: Observations, sorted_views: Sorted) -> Posed:
    """Fit the poses of all usable views to the final camera."""
    poses = sorted_views.estimate
    found = best.fit.solution.estimate
    start = Estimate(found.model, found.shared, poses.R_camera_board, poses.t_camera_board)
    solution = solve(everything.weighted(sorted_views.weights), start, _NONE, smallest_gain=1e-9)
    weights = everything.weights
    placed = solution.estimate.points_cam(everything) * weights[..., None]
    middles = placed.sum(axis=1) / np.maximum(weights.sum(axis=1), 1)[:, None]
    return Posed(solution, sorted_views, middles)


def _free(model: str, config: CameraCalibrationConfig) -> NDArray[np.int64]:
    free = free_parameters(model, config.radial_coefficients)
    bend = 4 + COEFFICIENTS[model] + _BEND if config.board_warp else _NONE
    return np.concatenate([free, bend])


def _candidate(
    views: Observations, start: Estimate, free: NDArray[np.int64], size: tuple[int, int]
) -> _Candidate | None:
    solution = solve(views, start, free)
    try:
        rays = camera_of(solution.estimate, size).unproject(pixel_grid(size))
    except GeometryError:
        return None
    if np.isfinite(rays).all(axis=1).sum() < _FEWEST_RAYS:
        return None
    fit = fit_of(views, solution)
    points = solution.estimate.points_cam(views)[views.weights > 0]
    radius = np.linalg.norm(points[:, :2], axis=1) / points[:, 2]
    return _Candidate(fit, validate(views, fit, size), float(radius.max()))


def _choose(candidates: Sequence[_Candidate], wanted: str) -> _Candidate:
    """Return the model that was asked for, or the stablest of those that predict best.

    Of models that explain left-out views alike, the simplest is taken unless the halves of
    another differ far less.
    """
    named = [candidate for candidate in candidates if candidate.model == wanted]
    if named:
        return named[0]
    alike = [candidate for candidate in candidates if _is_as_good(candidate, candidates)]
    alike = [candidate for candidate in alike if not _is_wild(candidate)] or alike
    unrest = [
        max((half.percentile_px(75) for half in candidate.validation.halves), default=0.0)
        for candidate in alike
    ]
    limit = _CLEARLY_STABLER * min(unrest)
    stable = [c for c, value in zip(alike, unrest, strict=True) if value <= limit]
    return min(stable, key=lambda candidate: _SIMPLEST.index(candidate.model))


def _is_wild(candidate: _Candidate) -> bool:
    """Return whether single terms of a lens polynomial are huge at the outermost corner seen.

    No lens needs them: they cancel each other where boards were and nowhere else. The rational
    lens is left alone, since its terms balance above and below the fraction line.
    """
    estimate = candidate.fit.solution.estimate
    if estimate.model == "rational":
        return False
    squared = candidate.largest_radius**2
    if estimate.model == "fisheye":
        squared = np.arctan(np.sqrt(squared)) ** 2
    radial = estimate.shared[[4, 5, 8] if estimate.model == "pinhole" else [4, 5, 6, 7]]
    terms = np.abs(radial) * squared ** np.arange(1, len(radial) + 1)
    return bool(terms.max() > _WILD)


def _is_as_good(candidate: _Candidate, candidates: Sequence[_Candidate]) -> bool:
    """Return whether a model explains left-out views as well as the best one does.

    Paired over views: its squared errors exceed the best model's by less than three standard
    errors of the difference, or by next to nothing, and by no gross share.
    """
    best = min(candidates, key=lambda c: c.validation.holdout_rms_px).validation.holdout_px2
    mine = candidate.validation.holdout_px2
    if not np.isfinite(mine).all():
        return False
    excess = mine - best
    error = excess.std(ddof=1) / np.sqrt(len(excess))
    allowed = np.clip(_CLEARLY_BETTER * error, _AS_GOOD * best.mean(), _WORSE * best.mean())
    return bool(excess.mean() <= allowed)


def _describe(
    best: _Candidate,
    candidates: Sequence[_Candidate],
    views: Observations,
    usable: UsableViews,
    posed: Posed,
) -> CameraFit:
    solution, size = best.fit.solution, usable.image_size
    camera = camera_of(solution.estimate, size)
    pixels = pixel_grid(size)
    known = best.validation.weights
    trials = []
    for candidate in candidates:
        estimate = candidate.fit.solution.estimate
        other = camera if candidate is best else camera_of(estimate, size)
        apart = projection_difference(camera, other, pixels, known)
        apart[np.isnan(apart) & (known > 0)] = np.inf
        trials.append(
            ModelTrial(
                other,
                _rms(views, candidate.fit),
                candidate.validation,
                _is_as_good(candidate, candidates),
                apart.reshape(GRID[::-1]),
            )
        )
    corners = [row[seen > 0] for row, seen in zip(views.pixels, views.weights, strict=True)]
    used = posed.sorted_views.used
    left_out = usable.observations.weights - posed.sorted_views.weights
    return CameraFit(
        camera,
        _sd(best),
        best.fit.noise_px,
        _rms(views, best.fit),
        best.validation,
        measure_coverage(size, corners, solution.estimate.R_camera_board, posed.middles_cam[used]),
        tuple(trials),
        int(left_out[used].sum()),
        _board_shape(best, views, camera, _BEND),
        _board_shape(best, views, camera, _STRETCH),
    )


def _rms(views: Observations, fit: Fit) -> float:
    squares = (fit.solution.residuals**2).sum(axis=-1)
    return float(np.sqrt((views.weights * squares).sum() / views.weights.sum()))


def _sd(candidate: _Candidate) -> dict[str, float]:
    """Return the standard deviation of every parameter that was estimated, by name."""
    names = parameter_names(candidate.model)
    free = candidate.fit.solution.free
    sd = np.sqrt(np.diag(candidate.validation.covariance))
    return {names[i]: float(value) for i, value in zip(free, sd, strict=True) if i < len(names)}


def _board_shape(
    candidate: _Candidate, views: Observations, camera: Camera, which: NDArray[np.int64]
) -> BoardShape:
    """Return what the board is like in a respect, and how that changes the camera."""
    solution, size = candidate.fit.solution, camera.image_size
    shape = len(solution.estimate.shared) - BOARD_SHAPE + which
    free = np.union1d(solution.free, shape)
    found = fit_of(
        views, solve(views, solution.estimate, free, steps=_SHAPE_STEPS, smallest_gain=1e-7)
    )
    variance = found.covariance.diagonal()[np.isin(free, shape)] * candidate.validation.inflation
    try:
        other = camera_of(found.solution.estimate, size)
        moved = projection_difference(camera, other, pixel_grid(size), candidate.validation.weights)
    except GeometryError:
        moved = np.full(GRID[0] * GRID[1], np.nan)
    values = found.solution.estimate.shared[shape]
    return BoardShape(values, np.sqrt(variance), moved.reshape(GRID[::-1]))
