"""What an uncertainty of the intrinsics does to pixels, and how two cameras differ.

A turn of the whole camera is no error of the intrinsics: whoever uses them estimates where the
camera looks. Both figures are therefore taken after the rotation that hides most of the change.

Source: mrcal's documentation, "Projection uncertainty" and "Cross-validation" (Kogan): the change
of the projection after the implied rotation; here for points at infinity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.calib.intrinsics.lens import lens_pixels
from percept.core.cameras import Camera

__all__ = [
    "GRID",
    "pixel_grid",
    "projection_change",
    "projection_difference",
    "projection_sd",
    "rays_difference",
]

_F64 = NDArray[np.float64]

GRID = (12, 8)
"""Columns and rows of the pixels at which projections are compared."""

_ROUNDS = 8


def pixel_grid(image_size: tuple[int, int], grid: tuple[int, int] = GRID) -> _F64:
    """Return pixels (rows * columns, 2) from edge to edge of an image, row by row."""
    us, vs = (np.linspace(0, size - 1, count) for size, count in zip(image_size, grid, strict=True))
    return np.stack(np.meshgrid(us, vs), axis=-1).reshape(-1, 2)


def projection_difference(a: Camera, b: Camera, pixels: _F64, weights: _F64) -> _F64:
    """Return how far (N,) b sees from `pixels` (N, 2) what a sees there, after a rotation.

    The rotation is the one that brings the rays of the two together (Kabsch), weighted by
    `weights` (N,): pixels at which nothing is known must not turn the whole picture. NaN where
    one of the cameras has no ray for the pixel: its distortion folds back there.
    """
    return rays_difference(a.unproject(pixels), b, pixels, weights)


def rays_difference(rays_a: _F64, b: Camera, pixels: _F64, weights: _F64) -> _F64:
    """Return the same as `projection_difference` for the rays (N, 3) of a that belong to pixels."""
    rays_b = b.unproject(pixels)
    both = np.isfinite(rays_a).all(axis=1) & np.isfinite(rays_b).all(axis=1) & (weights > 0)
    difference = np.full(len(pixels), np.nan)
    if both.sum() < 3:
        return difference
    u, _, vt = np.linalg.svd((rays_b[both] * weights[both, None]).T @ rays_a[both])
    R_b_a = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    seen, _ = b.project(rays_a[both] @ R_b_a.T)
    difference[both] = np.linalg.norm(seen - pixels[both], axis=1)
    return difference


def projection_change(
    camera: Camera, free: NDArray[np.int64], pixels: _F64, covariance: _F64
) -> tuple[_F64, _F64]:
    """Return the derivative (N, 2, P) of the projection by the intrinsics, after a rotation.

    The rotation is the one that hides most of the change where the projection is well known;
    since that depends on the rotation, it is found in a few rounds.

    Args:
        camera: The camera.
        free: (P,) indices into fx, fy, cx, cy, d0, d1, ... of what was estimated.
        pixels: (N, 2); rows of those without a ray are NaN.
        covariance: (P, P) of the estimated intrinsics.

    Returns:
        The derivative, and the weight (N,) of each pixel for the rotation, 1 at most; 0 without
        a ray.
    """
    rays = camera.unproject(pixels)
    has_ray = np.isfinite(rays).all(axis=1)
    K = camera.K
    intrinsics = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *camera.distortion])
    _, by_intrinsics, by_ray = lens_pixels(camera.model, intrinsics, rays[has_ray])
    by_intrinsics = by_intrinsics[..., free]
    x, y, z = rays[has_ray].T
    zero = np.zeros_like(x)
    by_turn = by_ray @ np.array([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
    weights = np.ones(len(x))
    moved = by_intrinsics
    for _ in range(_ROUNDS):
        weighted = by_turn.transpose(0, 2, 1) * weights[:, None, None]
        normal = np.linalg.pinv((weighted @ by_turn).sum(axis=0), hermitian=True)
        turn = normal @ (weighted @ by_intrinsics).sum(axis=0)
        moved = by_intrinsics - by_turn @ turn
        variance = np.maximum(projection_sd(moved, covariance), 1e-12) ** 2
        weights = variance.min() / variance
    change, known = np.full((len(pixels), 2, len(free)), np.nan), np.zeros(len(pixels))
    change[has_ray], known[has_ray] = moved, weights
    return change, known


def projection_sd(change: _F64, covariance: _F64) -> _F64:
    """Return the standard deviation (N,) of the projection in its worst direction, pixels.

    Args:
        change: (N, 2, P) from `projection_change`.
        covariance: (P, P) of the estimated intrinsics.
    """
    sd = np.full(len(change), np.nan)
    has_ray = np.isfinite(change).all(axis=(1, 2))
    spread = change[has_ray] @ covariance @ np.swapaxes(change[has_ray], 1, 2)
    sd[has_ray] = np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, -1], 0.0))
    return sd
