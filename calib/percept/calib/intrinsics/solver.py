"""Bundle adjustment of a camera and the board's poses: Levenberg-Marquardt with a Schur complement.

Each view touches the shared parameters (intrinsics, shape of the board) and its own pose only, so
the poses are eliminated view by view and the system that is solved has as many unknowns as the
lens. The views are padded to one length and handled as one stack of small matrices.

Sources:
    Triggs et al. 2000, Bundle adjustment: a modern synthesis, section 6.1 (Schur complement);
    Nocedal and Wright 2006, section 10.3 (Levenberg-Marquardt).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from percept.calib.intrinsics.lens import lens_pixels

__all__ = ["BOARD_SHAPE", "PRIOR_NOISE_PX", "Estimate", "Observations", "Solution", "solve"]

_F64 = NDArray[np.float64]

BOARD_SHAPE = 3
"""Shared parameters of the board: bend along its columns, along its rows, and stretch."""

_STEPS = 60
_LARGEST_DAMPING = 1e10
_NEAREST_DEPTH = 1e-6
# The rational and fisheye lenses have directions that no corner sees (a factor above and below
# the fraction line); left alone these run off to thousands and put poles into the image. Each
# coefficient is taken to have been measured as 0 +- 10 beside corners of this noise. A pinhole
# has no such direction and is left alone.
PRIOR_NOISE_PX = 0.1
_PRIOR_SD = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Corners of all views, padded to one length.

    Attributes:
        board: (V, N, 3) corners in the board's frame, in units of the board (metres).
        bend: (V, N, 2) how far each corner moves out of the board's plane for a unit of bend
            along its columns and its rows: 1 in the middle, 0 at the edges.
        pixels: (V, N, 2) where they were seen.
        weights: (V, N) 1 for corners that count, 0 for padding and rejected ones.
    """

    board: _F64
    bend: _F64
    pixels: _F64
    weights: _F64

    def __len__(self) -> int:
        return len(self.pixels)

    def of_views(self, views: NDArray[np.int64]) -> Observations:
        """Return the observations of some views only."""
        return Observations(
            self.board[views], self.bend[views], self.pixels[views], self.weights[views]
        )

    def of_corners(self, corners: NDArray[np.int64]) -> Observations:
        """Return some corners of every view only."""
        return Observations(
            self.board[:, corners],
            self.bend[:, corners],
            self.pixels[:, corners],
            self.weights[:, corners],
        )

    def weighted(self, weights: _F64) -> Observations:
        """Return the same observations with other weights (V, N)."""
        return replace(self, weights=weights)


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A camera and where the board was.

    Attributes:
        model: Name of the lens model.
        shared: (4 + D + 3,) fx, fy, cx, cy, distortion, the bend of the board along its columns
            and rows in the board's unit, and by which share its columns are longer than its rows.
        R_camera_board: (V, 3, 3).
        t_camera_board: (V, 3).
    """

    model: str
    shared: _F64
    R_camera_board: _F64
    t_camera_board: _F64

    def of_views(self, views: NDArray[np.int64]) -> Estimate:
        """Return the estimate with the poses of some views only."""
        return replace(
            self,
            R_camera_board=self.R_camera_board[views],
            t_camera_board=self.t_camera_board[views],
        )

    def points_cam(self, views: Observations) -> _F64:
        """Return the board's corners (V, N, 3) in the camera's frame."""
        board = views.board.copy()
        board[..., 2] += views.bend @ self.shared[-3:-1]
        board[..., 0] *= 1 + self.shared[-1] / 2
        board[..., 1] *= 1 - self.shared[-1] / 2
        turned = board @ np.swapaxes(self.R_camera_board, 1, 2)
        placed: _F64 = turned + self.t_camera_board[:, None]
        return placed

    def moved(self, shared_step: _F64, pose_steps: _F64) -> Estimate:
        """Return the estimate after a step; rotations turn by (V, 3) rotation vectors in front."""
        turn = _rotations(pose_steps[:, :3])
        return Estimate(
            self.model,
            self.shared + shared_step,
            turn @ self.R_camera_board,
            self.t_camera_board + pose_steps[:, 3:],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """What the solver found.

    Attributes:
        estimate: Camera and poses.
        residuals: (V, N, 2) projected minus seen, pixels; zero for padding.
        free: (P,) indices into `estimate.shared` of what was estimated.
        informations: (V, P, P) what each view says about the free parameters, its pose being
            eliminated, for corners with a noise of one pixel.
        scores: (V, P) how each view pulls at the free parameters (half the slope of its cost).
        prior: (P,) diagonal of what is known beside the views: the pull of coefficients to zero.
        cost: Sum of the squared residuals that count, robust where a scale was given.
    """

    estimate: Estimate
    residuals: _F64
    free: NDArray[np.int64]
    informations: _F64
    scores: _F64
    prior: _F64
    cost: float

    @property
    def information(self) -> _F64:
        """(P, P) what all views together say, without the prior."""
        total: _F64 = self.informations.sum(axis=0)
        return (total + total.T) / 2


class _Evaluation(NamedTuple):
    """Everything projected: points (V, N, 3), weights of the loss, derivatives, and the cost."""

    points: _F64
    residuals: _F64
    weights: _F64
    by_intrinsics: _F64
    by_points: _F64
    cost: float


class _Linear(NamedTuple):
    """The normal equations of each view: A (V, 6, 6), B (V, 6, P), a (V, 6), C (V, P, P), c (V, P).

    And the prior's (P,) weight and pull.
    """

    A: _F64
    B: _F64
    C: _F64
    a: _F64
    c: _F64
    prior: _F64
    pull: _F64


def solve(
    views: Observations,
    start: Estimate,
    free: NDArray[np.int64],
    *,
    robust_px: float | None = None,
    steps: int = _STEPS,
    smallest_gain: float = 1e-14,
) -> Solution:
    """Minimise the reprojection errors over the free shared parameters and all poses.

    Args:
        views: What was seen.
        start: Where to start.
        free: (P,) indices of `start.shared` to estimate; empty to fit the poses alone.
        robust_px: Scale of a Cauchy loss on the length of each corner's error; None for least
            squares.
        steps: The most steps.
        smallest_gain: Share of the cost by which the last step may still have improved.
    """
    estimate, damping = start, 1e-3
    seen = _evaluate(views, estimate, robust_px)
    linear = _linearise(views, estimate, seen, free)
    for _ in range(steps if np.isfinite(seen.cost) else 0):
        trial = _stepped(estimate, linear, free, damping)
        trial_seen = _evaluate(views, trial, robust_px)
        while trial_seen.cost > seen.cost and damping < _LARGEST_DAMPING:
            damping *= 8
            trial = _stepped(estimate, linear, free, damping)
            trial_seen = _evaluate(views, trial, robust_px)
        if trial_seen.cost > seen.cost:
            break
        gain, estimate, seen = seen.cost - trial_seen.cost, trial, trial_seen
        linear = _linearise(views, estimate, seen, free)
        damping = max(damping / 8, 1e-12)
        if gain <= smallest_gain * seen.cost:
            break
    _, _, by_shared, alone = _schur(linear)
    informations = linear.C - np.swapaxes(linear.B, 1, 2) @ by_shared
    scores = linear.c - np.einsum("vip,vi->vp", linear.B, alone)
    prior = _ridge(estimate)[free]
    return Solution(estimate, seen.residuals, free, informations, scores, prior, seen.cost)


def _evaluate(views: Observations, estimate: Estimate, robust_px: float | None) -> _Evaluation:
    """Project everything; the cost is infinite behind the camera and for mirrored focal lengths."""
    points = estimate.points_cam(views)
    counted = views.weights > 0
    behind = (points[..., 2] <= _NEAREST_DEPTH) & counted
    points[~counted | behind] = [0.0, 0.0, 1.0]
    with np.errstate(all="ignore"):
        pixels, by_intrinsics, by_points = lens_pixels(
            estimate.model, estimate.shared[:-BOARD_SHAPE], points
        )
        residuals = np.where(counted[..., None], pixels - views.pixels, 0.0)
        squared = (residuals**2).sum(axis=-1)
        weights = views.weights
        if robust_px is not None:
            weights = weights / (1 + squared / robust_px**2)
            squared = robust_px**2 * np.log1p(squared / robust_px**2)
        cost = float((views.weights * squared).sum() + _ridge(estimate) @ estimate.shared**2)
        possible = not behind.any() and (estimate.shared[:2] > 0).all()
        if not (possible and np.isfinite(cost)):  # nothing can be learnt from here
            weights, residuals = np.zeros_like(weights), np.zeros_like(residuals)
            by_intrinsics, by_points = np.zeros_like(by_intrinsics), np.zeros_like(by_points)
            cost = np.inf
    return _Evaluation(points, residuals, weights, by_intrinsics, by_points, cost)


def _linearise(
    views: Observations, estimate: Estimate, seen: _Evaluation, free: NDArray[np.int64]
) -> _Linear:
    R, t = estimate.R_camera_board, estimate.t_camera_board
    by_shared = seen.by_intrinsics
    if (free >= by_shared.shape[-1]).any():
        by_shared = np.concatenate([by_shared, _by_shape(views, seen.by_points @ R[:, None])], -1)
    by_shared = by_shared[..., free]
    # A turn in front of the rotation moves a point by its lever, crosswise.
    by_turn = np.cross((seen.points - t[:, None])[..., None, :], seen.by_points)
    by_pose = np.concatenate([by_turn, seen.by_points], axis=-1)
    scale = np.sqrt(seen.weights)[..., None, None]
    count = len(views)
    pose = (by_pose * scale).reshape(count, -1, 6)
    shared = (by_shared * scale).reshape(count, 2 * scale.shape[1], len(free))
    error = (seen.residuals[..., None] * scale).reshape(count, -1, 1)
    pose_t = np.swapaxes(pose, 1, 2)
    shared_t = np.swapaxes(shared, 1, 2)
    prior = _ridge(estimate)[free]
    return _Linear(
        pose_t @ pose,
        pose_t @ shared,
        shared_t @ shared,
        (pose_t @ error)[..., 0],
        (shared_t @ error)[..., 0],
        prior,
        prior * estimate.shared[free],
    )


def _by_shape(views: Observations, by_board: _F64) -> _F64:
    """Return derivatives (V, N, 2, 3) by the board's shape, of those by a point in its frame."""
    by_bend = by_board[..., 2:] * views.bend[..., None, :]
    along = views.board[..., None, :2] * by_board[..., :2]
    return np.concatenate([by_bend, (along[..., :1] - along[..., 1:]) / 2], axis=-1)


def _ridge(estimate: Estimate) -> _F64:
    """Return the weight (4 + D + 3,) that pulls each shared parameter to zero."""
    weight = np.zeros(len(estimate.shared))
    if estimate.model != "pinhole":
        weight[4:-BOARD_SHAPE] = (PRIOR_NOISE_PX / _PRIOR_SD) ** 2
    return weight


def _schur(linear: _Linear, damping: float = 0.0) -> tuple[_F64, _F64, _F64, _F64]:
    """Return S and s of the shared parameters, and A^-1 B and A^-1 a of each view."""
    A = linear.A + damping * _diagonals(linear.A) + 1e-300 * np.eye(6)
    C = linear.C.sum(axis=0) + np.diag(linear.prior)
    C += damping * np.diag(np.diag(C))
    right = np.concatenate([linear.B, linear.a[..., None]], axis=-1)
    try:
        eliminated = np.linalg.solve(A, right)
    except np.linalg.LinAlgError:
        eliminated = np.linalg.pinv(A, hermitian=True) @ right
    by_shared, alone = eliminated[..., :-1], eliminated[..., -1]
    S = C - np.einsum("vip,viq->pq", linear.B, by_shared)
    s = linear.c.sum(axis=0) + linear.pull - np.einsum("vip,vi->p", linear.B, alone)
    return (S + S.T) / 2, s, by_shared, alone


def _stepped(
    estimate: Estimate, linear: _Linear, free: NDArray[np.int64], damping: float
) -> Estimate:
    S, s, by_shared, alone = _schur(linear, damping)
    # Scaled to a unit diagonal: focal lengths and sixth-order coefficients differ by 1e6.
    scale = 1 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    step = -scale * (np.linalg.pinv(S * np.outer(scale, scale), hermitian=True) @ (scale * s))
    shared_step = np.zeros(len(estimate.shared))
    shared_step[free] = step
    return estimate.moved(shared_step, -(alone + by_shared @ step))


def _diagonals(matrices: _F64) -> _F64:
    return np.eye(6) * np.diagonal(matrices, axis1=1, axis2=2)[:, None]


def _cross(vectors: _F64) -> _F64:
    """Return the matrices (..., 3, 3) of the cross product from the left."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _rotations(vectors: _F64) -> _F64:
    """Return the rotations (V, 3, 3) of rotation vectors (V, 3), by Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=-1)[:, None, None]
    K = _cross(vectors)
    turned: _F64 = (
        np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (K @ K)
    )
    return turned
