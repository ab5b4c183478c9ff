"""Camera models: points in an optical frame to pixels and back.

Optical frames are z forward, x right, y down. Pixel (0, 0) is the centre of the top-left
pixel. The models are those that the rig file names; their coefficients are OpenCV's. All see
less than 180 degrees.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from percept.core.errors import ConfigError, GeometryError

__all__ = ["Camera", "FisheyeCamera", "PinholeCamera", "RationalCamera", "make_camera"]

_F64 = NDArray[np.float64]

_NEWTON_STEPS = 8
_NEAREST_DEPTH_M = 1e-6
_WIDEST_RAD = float(np.radians(89.5))
_PROFILE_STEPS = 4096
_DIFFERENCE_RAD = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Camera(ABC):
    """A camera: where the points of its optical frame appear in its image.

    Attributes:
        image_size: (width, height) in pixels.
        K: (3, 3) float64 camera matrix, pixels, without skew.
        distortion: (coefficients,) float64 in OpenCV's order.
        widest_rad: Angle from the optical axis up to which the model is one-to-one; beyond it
            the distortion polynomial folds back and is not used.

    Raises:
        GeometryError: If a shape is wrong, a value is not finite, or a focal length is not
            positive.
    """

    model: ClassVar[str]
    coefficients: ClassVar[int]

    image_size: tuple[int, int]
    K: _F64
    distortion: _F64
    widest_rad: float = field(init=False)

    def __post_init__(self) -> None:
        if np.shape(self.K) != (3, 3) or np.shape(self.distortion) != (self.coefficients,):
            raise GeometryError(
                f"K is (3, 3) and distortion ({self.coefficients},), "
                f"not {np.shape(self.K)} and {np.shape(self.distortion)}"
            )
        if not (np.isfinite(self.K).all() and np.isfinite(self.distortion).all()):
            raise GeometryError("intrinsics must be finite")
        if self.K[0, 0] <= 0 or self.K[1, 1] <= 0:
            raise GeometryError("focal lengths must be positive")
        angles, radii = self._profile()
        folds = np.flatnonzero(np.diff(radii) <= 0)
        widest = angles[folds[0]] if len(folds) else angles[-1]
        object.__setattr__(self, "widest_rad", float(widest))

    def project(self, points_cam: NDArray[np.floating]) -> tuple[_F64, NDArray[np.bool_]]:
        """Project points.

        Args:
            points_cam: (N, 3) in the optical frame, metres.

        Returns:
            Pixels (N, 2) u, v, and a mask (N,) of points in front of the camera, where the model
            is one-to-one, whose pixel lies in the image. Pixels are NaN behind the camera.
        """
        points = np.asarray(points_cam, dtype=np.float64)
        in_front = points[:, 2] > _NEAREST_DEPTH_M
        depth = np.where(in_front, points[:, 2], np.nan)
        normal = points[:, :2] / depth[:, None]
        pixels = self._distort(normal) * [self.K[0, 0], self.K[1, 1]] + self.K[:2, 2]
        width, height = self.image_size
        with np.errstate(invalid="ignore"):
            seen = (np.hypot(normal[:, 0], normal[:, 1]) <= np.tan(self.widest_rad)) & in_front
            seen &= (pixels >= -0.5).all(axis=1)
            seen &= (pixels < [width - 0.5, height - 0.5]).all(axis=1)
        return pixels, seen

    def unproject(self, pixels: NDArray[np.floating]) -> _F64:
        """Return unit rays (N, 3) in the optical frame of pixels (N, 2).

        The radial profile gives the start, Newton's method on the angle from the axis the rest.
        Rays of pixels that no point within `widest_rad` projects to are NaN.
        """
        image = (np.asarray(pixels, dtype=np.float64) - self.K[:2, 2]) / np.diag(self.K)[:2]
        bearing = self._first_bearing(image)
        for _ in range(_NEWTON_STEPS):
            bearing = bearing - self._newton_step(bearing, image)
        angle = np.hypot(bearing[:, 0], bearing[:, 1])
        with np.errstate(invalid="ignore"):
            off = np.abs(self._distort(_on_plane(bearing)) - image).max(axis=1, initial=0.0)
            found = (angle <= self.widest_rad) & (off < 1e-6)
        rays = np.column_stack([np.sinc(angle / np.pi)[:, None] * bearing, np.cos(angle)])
        rays[~found] = np.nan
        return rays

    def _first_bearing(self, image: _F64) -> _F64:
        angles, radii = self._profile()
        one_to_one = angles <= self.widest_rad
        radius = np.hypot(image[:, 0], image[:, 1])
        angle = np.interp(radius, radii[one_to_one], angles[one_to_one])
        return image * (angle / np.maximum(radius, 1e-300))[:, None]

    def _newton_step(self, bearing: _F64, image: _F64) -> _F64:
        """Return the step (N, 2) that solves the linearised projection for the bearing."""
        error = self._distort(_on_plane(bearing)) - image
        columns = [
            (self._distort(_on_plane(bearing + shift)) - self._distort(_on_plane(bearing - shift)))
            / (2 * _DIFFERENCE_RAD)
            for shift in _DIFFERENCE_RAD * np.eye(2)
        ]
        (a, c), (b, d) = columns[0].T, columns[1].T
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            step = (
                np.column_stack(
                    [d * error[:, 0] - b * error[:, 1], a * error[:, 1] - c * error[:, 0]]
                )
                / (a * d - b * c)[:, None]
            )
        bounded: _F64 = np.clip(np.nan_to_num(step, nan=0.0), -0.1, 0.1)
        return bounded

    def _profile(self) -> tuple[_F64, _F64]:
        """Return angles from the axis (S,) and the radii (S,) that they are distorted to."""
        angles = np.linspace(0, _WIDEST_RAD, _PROFILE_STEPS)
        radii = np.tan(angles)
        with np.errstate(over="ignore", invalid="ignore"):
            return angles, radii * self._radial(radii)

    @abstractmethod
    def _radial(self, radii: _F64) -> _F64:
        """Return the factor by which the undistorted radius (...) grows."""

    def _distort(self, normal: _F64) -> _F64:
        """Return distorted coordinates (N, 2) of undistorted ones (N, 2) on the plane z = 1."""
        return normal * self._radial(np.hypot(normal[:, 0], normal[:, 1]))[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class PinholeCamera(Camera):
    """A pinhole with radial and tangential distortion (Brown 1971): k1, k2, p1, p2, k3."""

    model: ClassVar[str] = "pinhole"
    coefficients: ClassVar[int] = 5

    def _radial(self, radii: _F64) -> _F64:
        k1, k2, _, _, k3 = self.distortion
        return _polynomial(radii * radii, k1, k2, k3)

    def _distort(self, normal: _F64) -> _F64:
        return _with_tangential(normal, self._radial, self.distortion)


@dataclass(frozen=True, slots=True, eq=False)
class RationalCamera(Camera):
    """OpenCV's rational model: k1, k2, p1, p2, k3, and k4, k5, k6 below the fraction line."""

    model: ClassVar[str] = "rational"
    coefficients: ClassVar[int] = 8

    def _radial(self, radii: _F64) -> _F64:
        k1, k2, _, _, k3, k4, k5, k6 = self.distortion
        r2 = radii * radii
        return _polynomial(r2, k1, k2, k3) / _polynomial(r2, k4, k5, k6)

    def _distort(self, normal: _F64) -> _F64:
        return _with_tangential(normal, self._radial, self.distortion)


@dataclass(frozen=True, slots=True, eq=False)
class FisheyeCamera(Camera):
    """OpenCV's fisheye (Kannala and Brandt 2006): the angle grows by k1..k4 of its even powers."""

    model: ClassVar[str] = "fisheye"
    coefficients: ClassVar[int] = 4

    def _radial(self, radii: _F64) -> _F64:
        angle = np.arctan(radii)
        ratio = np.where(radii > 1e-8, angle / np.maximum(radii, 1e-8), 1.0)
        return ratio * _polynomial(angle * angle, *self.distortion)


def make_camera(
    model: str, image_size: tuple[int, int], K: ArrayLike, distortion: ArrayLike
) -> Camera:
    """Return the camera of a model's name.

    Args:
        model: `pinhole`, `rational` or `fisheye`.
        image_size: (width, height) in pixels.
        K: (3, 3) camera matrix, pixels.
        distortion: OpenCV's coefficients; missing ones at the end are zero.

    Raises:
        ConfigError: If there is no such model or it has fewer coefficients.
        GeometryError: If a value makes no camera.
    """
    models = {kind.model: kind for kind in (PinholeCamera, RationalCamera, FisheyeCamera)}
    if model not in models:
        raise ConfigError(f"no camera model '{model}'", remedy=f"Choose from {', '.join(models)}")
    kind = models[model]
    given = np.asarray(distortion, dtype=np.float64).ravel()
    if len(given) > kind.coefficients:
        raise ConfigError(
            f"a {model} camera has at most {kind.coefficients} coefficients, not {len(given)}"
        )
    padded = np.zeros(kind.coefficients)
    padded[: len(given)] = given
    return kind(image_size, np.asarray(K, dtype=np.float64), padded)


def _on_plane(bearing: _F64) -> _F64:
    """Return where rays meet the plane z = 1; a bearing's length is its angle in rad."""
    angle = np.hypot(bearing[:, 0], bearing[:, 1])
    bounded = np.clip(angle, 1e-12, _WIDEST_RAD)
    on_plane: _F64 = bearing * (np.tan(bounded) / np.maximum(angle, 1e-12))[:, None]
    return on_plane


def _polynomial(x: _F64, *coefficients: float) -> _F64:
    total = np.zeros_like(x)
    for coefficient in reversed(coefficients):
        total = (total + coefficient) * x
    return total + 1


def _with_tangential(normal: _F64, radial: Callable[[_F64], _F64], distortion: _F64) -> _F64:
    p1, p2 = distortion[2:4]
    x, y = normal[:, 0], normal[:, 1]
    r2 = x * x + y * y
    factor = radial(np.sqrt(r2))
    return np.column_stack(
        [
            x * factor + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * factor + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ]
    )
