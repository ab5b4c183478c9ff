"""Solids with exact surfaces: boxes, frusta (cylinders and cones) and ellipsoids.

Everything that stands on the street is made of these three, so that a ray meets it in closed
form and its extents are exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from percept.core.errors import GeometryError
from percept.core.transform import rotation_from_rpy

__all__ = ["Kind", "Material", "Primitive", "box", "ellipsoid", "extents", "frustum", "tint"]


class Kind(IntEnum):
    """Which solid a primitive is; the numbers are used by the ray caster."""

    BOX = 0
    FRUSTUM = 1
    ELLIPSOID = 2


@dataclass(frozen=True, slots=True)
class Material:
    """How a surface answers light.

    Attributes:
        colour: Linear RGB reflectance in 0..1, for cameras.
        reflectance: Diffuse reflectance in 0..1 at the LiDAR's wavelength.
        retro_gain: How many times brighter than a diffuser it returns light to its source;
            0 for surfaces that are not retro-reflective.
        emission: 0 for a surface that the sun lights, 1 for a lamp that shines.
    """

    colour: tuple[float, float, float]
    reflectance: float
    retro_gain: float = 0.0
    emission: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Primitive:
    """One solid in the frame of its object.

    Attributes:
        kind: Which solid.
        centre: (3,) float64 centre in the object's frame, metres.
        rotation: (3, 3) float64 `R_object_primitive`.
        size: (3,) float64 metres: half extents of a box; bottom radius, top radius and half
            height of a frustum about z; semi-axes of an ellipsoid.
        material: Of the whole surface.
    """

    kind: Kind
    centre: NDArray[np.float64]
    rotation: NDArray[np.float64]
    size: NDArray[np.float64]
    material: Material

    def shifted(self, offset: ArrayLike) -> Primitive:
        """Return the primitive moved by (3,) metres."""
        return replace(self, centre=self.centre + np.asarray(offset, dtype=np.float64))

    def bounds(self) -> NDArray[np.float64]:
        """Return the exact extents (2, 3): smallest and largest coordinate, metres."""
        if self.kind is Kind.BOX:
            reach = np.abs(self.rotation) @ self.size
            return np.stack([self.centre - reach, self.centre + reach])
        if self.kind is Kind.ELLIPSOID:
            reach = np.sqrt(((self.rotation * self.size) ** 2).sum(axis=1))
            return np.stack([self.centre - reach, self.centre + reach])
        axis = self.rotation[:, 2]
        across = np.sqrt(np.clip(1 - axis**2, 0, None))
        ends = [
            self.centre + sign * self.size[2] * axis + side * radius * across
            for sign, radius in ((-1, self.size[0]), (1, self.size[1]))
            for side in (-1, 1)
        ]
        return np.stack([np.min(ends, axis=0), np.max(ends, axis=0)])


def extents(primitives: Sequence[Primitive]) -> NDArray[np.float64]:
    """Return the exact extents (2, 3) of several primitives, metres."""
    bounds = np.stack([primitive.bounds() for primitive in primitives])
    return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])


def box(
    centre: ArrayLike,
    size: ArrayLike,
    material: Material,
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Primitive:
    """Return a box of a full size (3,) in metres, turned by roll, pitch, yaw in rad."""
    half = np.asarray(size, dtype=np.float64) / 2
    place = np.asarray(centre, dtype=np.float64)
    return Primitive(Kind.BOX, place, rotation_from_rpy(*rpy), half, material)


def ellipsoid(
    centre: ArrayLike,
    semi_axes: ArrayLike,
    material: Material,
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Primitive:
    """Return an ellipsoid of semi-axes (3,) in metres, turned by roll, pitch, yaw in rad."""
    semi = np.asarray(semi_axes, dtype=np.float64)
    place = np.asarray(centre, dtype=np.float64)
    return Primitive(Kind.ELLIPSOID, place, rotation_from_rpy(*rpy), semi, material)


def frustum(
    bottom: ArrayLike,
    top: ArrayLike,
    radius_m: float | tuple[float, float],
    material: Material,
) -> Primitive:
    """Return a cylinder, or a truncated cone for two radii, between two points (3,).

    Raises:
        GeometryError: If both points coincide.
    """
    start, end = np.asarray(bottom, dtype=np.float64), np.asarray(top, dtype=np.float64)
    along = end - start
    length = float(np.linalg.norm(along))
    if length == 0:
        raise GeometryError("a frustum needs two different ends")
    radii = radius_m if isinstance(radius_m, tuple) else (radius_m, radius_m)
    size = np.array([radii[0], radii[1], length / 2])
    return Primitive(
        Kind.FRUSTUM, (start + end) / 2, _rotation_with_z(along / length), size, material
    )


def tint(rng: np.random.Generator, low: float, high: float) -> tuple[float, float, float]:
    """Draw a linear RGB colour whose channels lie in low..high."""
    red, green, blue = rng.uniform(low, high, 3).tolist()
    return red, green, blue


def _rotation_with_z(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a rotation (3, 3) whose third column is a unit axis (3,)."""
    away = np.zeros(3)
    away[int(np.argmin(np.abs(axis)))] = 1.0
    side = np.cross(away, axis)
    side /= np.linalg.norm(side)
    return np.column_stack([side, np.cross(axis, side), axis])
