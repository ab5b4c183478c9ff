"""Coloured triangles: what the camera renderer draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError

__all__ = ["Mesh", "joined"]


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A triangle soup in one frame.

    Attributes:
        vertices: (V, 3) float64, metres.
        faces: (F, 3) int32 vertex indices; drawn from both sides.
        colours: (F, 3) float32 linear RGB reflectance in 0..1.
        emission: (F,) float32; 0 for surfaces that the sun lights, 1 for lamps that shine.
        layer: (F,) int32; of coplanar faces the higher layer wins (road 0, paint 1, ...).

    Raises:
        GeometryError: If the columns do not have one length.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    colours: NDArray[np.float32]
    emission: NDArray[np.float32]
    layer: NDArray[np.int32]

    def __post_init__(self) -> None:
        count = len(self.faces)
        if (
            self.vertices.shape[1:] != (3,)
            or self.faces.shape != (count, 3)
            or self.colours.shape != (count, 3)
            or self.emission.shape != (count,)
            or self.layer.shape != (count,)
        ):
            raise GeometryError("a mesh needs (V, 3) vertices and columns of one length F")


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Return several meshes as one; an empty sequence gives an empty mesh."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([np.zeros((0, 3)), *(m.vertices for m in meshes)]),
        np.concatenate(
            [
                np.zeros((0, 3), np.int32),
                *(m.faces + np.int32(s) for m, s in zip(meshes, starts, strict=False)),
            ]
        ),
        np.concatenate([np.zeros((0, 3), np.float32), *(m.colours for m in meshes)]),
        np.concatenate([np.zeros(0, np.float32), *(m.emission for m in meshes)]),
        np.concatenate([np.zeros(0, np.int32), *(m.layer for m in meshes)]),
    )
