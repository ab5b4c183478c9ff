"""A shape: a labelled group of primitives with exact extents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from percept.datasets.synthetic.primitives import Kind, Material, Primitive, extents

__all__ = ["DETECTABLE", "PACKED_WIDTH", "Shape", "make_scenery", "make_shape"]

DETECTABLE = (
    "barrel",
    "barricade",
    "sign",
    "pedestrian",
    "deer",
    "car",
    "truck",
    "cyclist",
    "cone",
)
"""The classes that truth tables list; other shapes are scenery."""

PACKED_WIDTH = 18
"""Columns of a packed primitive: kind, rotation to it (9), centre (3), size (3), two gains."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A rigid body. Its frame has x along its length and z up.

    The origin of a detectable class lies on the ground below the middle of its extents.

    Attributes:
        label: Class, or a name of scenery such as `building`.
        primitives: What it consists of, in its own frame.
        length_m: Exact extent along x.
        width_m: Exact extent along y.
        height_m: Exact extent along z.
        middle: (3,) float64 middle of the extents in its frame, metres.
    """

    label: str
    primitives: tuple[Primitive, ...]
    length_m: float
    width_m: float
    height_m: float
    middle: NDArray[np.float64]

    @cached_property
    def packed(self) -> NDArray[np.float64]:
        """(P, 18) float64 primitives as the ray caster reads them."""
        return np.stack([_pack(primitive) for primitive in self.primitives])

    @cached_property
    def radius_m(self) -> float:
        """Radius of the sphere about the middle of the extents that holds the shape."""
        return float(np.linalg.norm([self.length_m, self.width_m, self.height_m])) / 2


def make_shape(label: str, primitives: Sequence[Primitive]) -> Shape:
    """Centre primitives over the origin, set them on z = 0, and measure them."""
    low, high = extents(primitives)
    below = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    return make_scenery(label, [primitive.shifted(-below) for primitive in primitives])


def make_scenery(label: str, primitives: Sequence[Primitive]) -> Shape:
    """Measure primitives and leave them where they are, so that they can reach underground."""
    low, high = extents(primitives)
    length, width, height = (high - low).tolist()
    return Shape(label, tuple(primitives), length, width, height, (low + high) / 2)


def _pack(primitive: Primitive) -> NDArray[np.float64]:
    material: Material = primitive.material
    row = np.empty(PACKED_WIDTH)
    row[0] = float(Kind(primitive.kind))
    row[1:10] = primitive.rotation.T.ravel()
    row[10:13] = primitive.centre
    row[13:16] = primitive.size
    row[16:18] = material.reflectance, material.retro_gain
    return row
