"""A rectangle of known size, located among rays that met it and rays that passed it.

A beam has no width of its own in a point cloud, so the last return on a plate lies up to one
step inside its rim, and fits to the outermost returns shrink or shift it. Here every ray counts:
those that met the plate lie inside, those whose return lies behind it crossed the plane outside.
The posterior over middle and angle is then as narrow as the gaps between the two allow, and with
no ray outside it centres the rectangle between symmetric gaps by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["RectangleFit", "fit_rectangle", "measure_sides"]

_STEPS = 7  # of the grid along each of the three unknowns
_ROUNDS = 9
_RAYS_AT_FIRST = 300  # are enough while the grid is coarser than the rim
_SOFT_M = (0.001, 0.002, 0.004, 0.008, 0.016, 0.032)
_BLOOM_M = tuple(0.002 * k for k in range(11))
_BAND_PER_SPAN = 1.5  # rays farther from the rim say the same of every pose
_SETTLED = 0.2  # relative change of the grid's extent
_SPAN_SD = 3.0  # the grid ends so many standard deviations from the mean


@dataclass(frozen=True, slots=True, eq=False)
class RectangleFit:
    """Where the rectangle is, and how well that is known.

    Attributes:
        pose: (3,) float64 middle x, y in metres and angle in rad of its x axis, in the plane.
        covariance: (3, 3) float64 of the pose.
        soft_m: Width of the rim, as the rays show it: beam size, jitter, mixed returns.
        bloom_m: How far outside the rim beams still meet the plate, since they are no lines.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    soft_m: float
    bloom_m: float


def fit_rectangle(
    crossings: NDArray[np.float64],
    is_hit: NDArray[np.bool_],
    size_m: tuple[float, float],
    start: NDArray[np.float64],
    start_span_m: float,
) -> RectangleFit:
    """Locate a rectangle of known size by its posterior under a flat prior.

    The posterior is summed on a grid that zooms in on it; bloom and softness of the rim are the
    likeliest at a first fit.

    Args:
        crossings: (K, 2 or more) where the rays cross the plane, metres.
        is_hit: (K,) whether the ray met the plate; otherwise it passed.
        size_m: Width along the rectangle's x and height along its y, metres.
        start: (3,) pose to start from.
        start_span_m: How far from the truth the start may lie, metres at the corners.
    """
    half_diagonal = float(np.hypot(*size_m)) / 2
    near = _near_rim(crossings, size_m, start, _BAND_PER_SPAN * start_span_m)
    rays, hits = np.ascontiguousarray(crossings[near, :2]), is_hit[near]
    corner = np.array([1.0, 1.0, 1.0 / half_diagonal])
    halves = (size_m[0] / 2, size_m[1] / 2)
    mean, covariance = _zoom(rays, hits, halves, (start, corner * start_span_m), _SOFT_M[2])
    bloom, soft = _likeliest_rim(rays, hits, halves, mean)
    halves = (halves[0] + bloom, halves[1] + bloom)
    span = np.maximum(_SPAN_SD * np.sqrt(np.diag(covariance)), corner * soft)
    mean, covariance = _zoom(rays, hits, halves, (mean, span), soft)
    return RectangleFit(mean, covariance * _repetition(rays, mean, halves, soft), soft, bloom)


def _repetition(
    rays: NDArray[np.float64], pose: NDArray[np.float64], halves: tuple[float, float], soft_m: float
) -> float:
    """Return how often the rays that tell where the rim is say the same.

    A sensor that stands still sends its beams to the same places scan after scan, and rays that
    are closer to each other than the rim is soft share what makes it so. They count once.
    """
    from percept.calib.board_in_cloud.rectangle_kernels import FARTHEST_SOFT, edge_distances

    telling = rays[np.abs(edge_distances(rays, pose, *halves)) < FARTHEST_SOFT * soft_m]
    if not len(telling):
        return 1.0
    places = np.unique(np.floor(telling / soft_m).astype(np.int64), axis=0)
    return len(telling) / len(places)


def _likeliest_rim(
    rays: NDArray[np.float64],
    is_hit: NDArray[np.bool_],
    halves: tuple[float, float],
    pose: NDArray[np.float64],
) -> tuple[float, float]:
    """Return the bloom and the softness of largest likelihood at a pose."""
    from percept.calib.board_in_cloud.rectangle_kernels import grid_log_likelihood

    return max(
        ((bloom, soft) for bloom in _BLOOM_M for soft in _SOFT_M),
        key=lambda rim: grid_log_likelihood(
            rays, is_hit, pose[None], halves[0] + rim[0], halves[1] + rim[0], rim[1]
        )[0],
    )


def _near_rim(
    crossings: NDArray[np.float64],
    size_m: tuple[float, float],
    pose: NDArray[np.float64],
    band_m: float,
) -> NDArray[np.bool_]:
    """Return which rays can tell one pose from another."""
    from percept.calib.board_in_cloud.rectangle_kernels import edge_distances

    distance = edge_distances(crossings, pose, size_m[0] / 2, size_m[1] / 2)
    near: NDArray[np.bool_] = np.abs(distance) < band_m
    return near


def _zoom(
    rays: NDArray[np.float64],
    is_hit: NDArray[np.bool_],
    halves: tuple[float, float],
    around: tuple[NDArray[np.float64], NDArray[np.float64]],
    soft_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean and covariance, on a grid that fits the posterior."""
    from percept.calib.board_in_cloud.rectangle_kernels import (
        FARTHEST_SOFT,
        edge_distances,
        grid_log_likelihood,
    )

    mean, span = around
    unit = np.stack(np.meshgrid(*[np.linspace(-1, 1, _STEPS)] * 3, indexing="ij"), -1)
    unit = unit.reshape(-1, 3)
    covariance = np.diag(span**2)
    few = max(-(-len(rays) // _RAYS_AT_FIRST), 1)
    for _ in range(_ROUNDS):
        poses = mean + unit * span
        grid_m = float(span[:2].max()) / (_STEPS - 1)
        blur = max(soft_m, grid_m)  # no finer than the grid sees
        step = few if blur > soft_m else 1
        reach = span[0] + span[1] + span[2] * float(np.hypot(*halves)) + FARTHEST_SOFT * blur
        tells = np.abs(edge_distances(rays[::step], mean, *halves)) < reach
        fit = grid_log_likelihood(rays[::step][tells], is_hit[::step][tells], poses, *halves, blur)
        weight = np.exp(fit - fit.max())
        weight /= weight.sum()
        mean = weight @ poses
        away = poses - mean
        covariance = (away * weight[:, None]).T @ away
        covariance += np.diag((2 * span / (_STEPS - 1)) ** 2 / 12)  # the posterior between nodes
        wanted = _SPAN_SD * np.sqrt(np.diag(covariance))
        if np.all(np.abs(wanted / span - 1) < _SETTLED) and blur <= soft_m:
            break
        span = np.clip(wanted, span / 2, span * 2)
    return mean, covariance


def measure_sides(
    crossings: NDArray[np.float64],
    is_hit: NDArray[np.bool_],
    size_m: tuple[float, float],
    pose: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Measure the sides freely, at the angle of a fit.

    Args:
        crossings: (K, 2 or more) where the rays cross the plane, metres.
        is_hit: (K,) whether the ray met the plate; otherwise it passed.
        size_m: Sides that were looked for, metres.
        pose: (3,) the fit.

    Returns:
        (2,) width and height found, metres, and (2,) how far each may be off for the gaps
        between rays at its two ends.
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    xy = (crossings[:, :2] - pose[:2]) @ np.array([[c, -s], [s, c]])
    found, slack = np.zeros(2), np.zeros(2)
    for axis in range(2):
        half, across = size_m[axis] / 2, size_m[1 - axis] / 2
        beside = np.abs(xy[:, 1 - axis]) < 0.9 * across
        for sign in (-1.0, 1.0):
            ahead = sign * xy[beside, axis]
            low, high = _edge_interval(ahead, is_hit[beside], half)
            found[axis] += (low + high) / 2
            slack[axis] += (high - low) / 2
    return found, slack


def _edge_interval(
    ahead: NDArray[np.float64], is_hit: NDArray[np.bool_], half: float
) -> tuple[float, float]:
    """Return between which distances from the middle an edge leaves fewest rays unexplained."""
    on = ahead > 0
    order = np.argsort(ahead[on], kind="stable")
    distance, hit = ahead[on][order], is_hit[on][order]
    if not hit.any():
        return 0.0, 0.0
    wrong = np.concatenate([[0], np.cumsum(~hit)]) + np.concatenate(
        [np.cumsum(hit[::-1])[::-1], [0]]
    )
    best = np.flatnonzero(wrong == wrong.min())
    low = float(distance[best[0] - 1]) if best[0] else 0.0
    steps = np.diff(np.concatenate([[0.0], distance[hit & (distance <= low)]]))
    widest = float(steps.max(initial=0.0))
    high = float(distance[best[-1]]) if best[-1] < len(distance) else low + widest
    return low, min(high, low + max(widest, 0.02 * half))
