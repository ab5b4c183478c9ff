"""Lens models with their derivatives: what the solver of the intrinsics differentiates.

The projections are those of `percept.core.cameras`; here they are arrays over any leading
shape, with analytic derivatives.

Sources:
    Brown 1971 for the tangential terms; OpenCV's `calibrateCamera` documentation for the
    rational form; Kannala and Brandt 2006 for the fisheye.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["COEFFICIENTS", "free_parameters", "lens_pixels", "zero_distortion"]

_F64 = NDArray[np.float64]

COEFFICIENTS = {"pinhole": 5, "rational": 8, "fisheye": 4}
"""Distortion coefficients of each model, in OpenCV's order."""

_NEAR_AXIS = 1e-8


def zero_distortion(model: str) -> _F64:
    """Return the coefficients (D,) of a lens without distortion."""
    return np.zeros(COEFFICIENTS[model])


def free_parameters(model: str, radial_coefficients: int) -> NDArray[np.int64]:
    """Return which of fx, fy, cx, cy, d0, d1, ... are estimated, as indices.

    Args:
        model: Name of the model.
        radial_coefficients: How many of k1, k2, k3 a pinhole has, 0 to 3; the other models
            always have all of theirs.
    """
    count = 4 + COEFFICIENTS[model]
    fixed = {4, 5, 8} - set((4, 5, 8)[:radial_coefficients]) if model == "pinhole" else set()
    return np.array([index for index in range(count) if index not in fixed], dtype=np.int64)


def lens_pixels(model: str, intrinsics: _F64, points_cam: _F64) -> tuple[_F64, _F64, _F64]:
    """Project points and differentiate.

    Args:
        model: Name of the model.
        intrinsics: (4 + D,) fx, fy, cx, cy and the distortion.
        points_cam: (..., 3) in the optical frame, in front of the camera.

    Returns:
        Pixels (..., 2), their derivatives (..., 2, 4 + D) by the intrinsics, and (..., 2, 3) by
        the points.
    """
    x, y, z = np.moveaxis(points_cam, -1, 0)
    normal = np.stack([x / z, y / z], axis=-1)
    bent, by_normal, by_distortion = _distort(model, intrinsics[4:], normal)
    focal = intrinsics[:2]
    by_intrinsics = np.zeros((*normal.shape, len(intrinsics)))
    by_intrinsics[..., 0, 0] = bent[..., 0]
    by_intrinsics[..., 1, 1] = bent[..., 1]
    by_intrinsics[..., 0, 2] = by_intrinsics[..., 1, 3] = 1.0
    by_intrinsics[..., 4:] = focal[:, None] * by_distortion
    by_points = np.empty((*normal.shape, 3))
    by_points[..., :2] = focal[:, None] * by_normal / z[..., None, None]
    by_points[..., 2] = -(by_points[..., :2] * normal[..., None, :]).sum(axis=-1)
    return bent * focal + intrinsics[2:4], by_intrinsics, by_points


def _distort(model: str, distortion: _F64, normal: _F64) -> tuple[_F64, _F64, _F64]:
    """Return distorted coordinates (..., 2) and derivatives by the plain ones and coefficients."""
    squared = (normal * normal).sum(axis=-1)
    if model == "fisheye":
        factor, slope, by_radial = _fisheye_factor(distortion, squared)
        bent, by_normal = _radial(normal, factor, slope)
        return bent, by_normal, normal[..., :, None] * by_radial[..., None, :]
    factor, slope, by_radial = _rational_factor(distortion, squared)
    bent, by_normal = _radial(normal, factor, slope)
    _add_tangential(distortion[2:4], normal, squared, bent, by_normal)
    by_distortion = np.empty((*normal.shape, len(distortion)))
    radial = [0, 1, *range(4, len(distortion))]
    by_distortion[..., radial] = normal[..., :, None] * by_radial[..., None, :]
    x, y = normal[..., 0], normal[..., 1]
    by_distortion[..., 0, 2] = by_distortion[..., 1, 3] = 2 * x * y
    by_distortion[..., 1, 2] = squared + 2 * y * y
    by_distortion[..., 0, 3] = squared + 2 * x * x
    return bent, by_normal, by_distortion


def _radial(normal: _F64, factor: _F64, slope: _F64) -> tuple[_F64, _F64]:
    """Return n g(s) and its derivative g I + 2 g' n n^T, where s is the squared radius."""
    outer = normal[..., :, None] * normal[..., None, :]
    by_normal = factor[..., None, None] * np.eye(2) + 2 * slope[..., None, None] * outer
    return normal * factor[..., None], by_normal


def _add_tangential(p: _F64, normal: _F64, s: _F64, bent: _F64, by_normal: _F64) -> None:
    x, y = normal[..., 0], normal[..., 1]
    bent[..., 0] += 2 * p[0] * x * y + p[1] * (s + 2 * x * x)
    bent[..., 1] += p[0] * (s + 2 * y * y) + 2 * p[1] * x * y
    by_normal[..., 0, 0] += 2 * p[0] * y + 6 * p[1] * x
    by_normal[..., 0, 1] += 2 * p[0] * x + 2 * p[1] * y
    by_normal[..., 1, 0] += 2 * p[0] * x + 2 * p[1] * y
    by_normal[..., 1, 1] += 6 * p[0] * y + 2 * p[1] * x


def _rational_factor(distortion: _F64, s: _F64) -> tuple[_F64, _F64, _F64]:
    """Return g(s), g'(s) and the derivative of g by the radial coefficients."""
    k1, k2, _, _, k3, *below = distortion
    k4, k5, k6 = below or (0.0, 0.0, 0.0)
    denominator = 1 + s * (k4 + s * (k5 + s * k6))
    factor = (1 + s * (k1 + s * (k2 + s * k3))) / denominator
    slope = k1 + s * (2 * k2 + s * 3 * k3) - factor * (k4 + s * (2 * k5 + s * 3 * k6))
    powers = np.stack([s, s * s, s * s * s], axis=-1) / denominator[..., None]
    parts = [powers, -factor[..., None] * powers] if below else [powers]
    return factor, slope / denominator, np.concatenate(parts, axis=-1)


def _fisheye_factor(distortion: _F64, s: _F64) -> tuple[_F64, _F64, _F64]:
    """Return g(s), g'(s) and the derivative of g by k1..k4, g being the bent angle by radius."""
    k1, k2, k3, k4 = distortion
    near = s < _NEAR_AXIS
    radius = np.sqrt(np.where(near, 1.0, s))
    angle = np.arctan(radius)
    a = angle * angle
    bent = angle * (1 + a * (k1 + a * (k2 + a * (k3 + a * k4))))
    growth = 1 + a * (3 * k1 + a * (5 * k2 + a * (7 * k3 + a * 9 * k4)))
    factor = bent / radius
    slope = (growth / (1 + radius * radius) - factor) / (2 * radius * radius)
    by_radial = np.stack([angle / radius * a**power for power in range(1, 5)], axis=-1)
    # Near the axis g = 1 + (k1 - 1/3) s to the accuracy of a double.
    factor = np.where(near, 1 + (k1 - 1 / 3) * s, factor)
    slope = np.where(near, k1 - 1 / 3, slope)
    return factor, slope, np.where(near[..., None], s[..., None] * [1.0, 0, 0, 0], by_radial)
