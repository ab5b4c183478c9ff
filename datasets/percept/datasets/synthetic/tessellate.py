"""Solids as triangles. Flat faces are exact; round ones deviate by less than a percent."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from percept.datasets.synthetic.mesh import Mesh, joined
from percept.datasets.synthetic.primitives import Kind, Primitive
from percept.datasets.synthetic.shapes import Shape

__all__ = ["mesh_of_quads", "mesh_of_shape"]

_AROUND = 12
_BANDS = 6
_LOWER, _UPPER = np.array([0, 1, 2]), np.array([0, 2, 3])
_Soup = tuple[NDArray[np.float64], NDArray[np.int32]]


@lru_cache(maxsize=1024)
def mesh_of_shape(shape: Shape) -> Mesh:
    """Return a shape's triangles in its own frame, on layer 0."""
    return joined([_mesh_of_primitive(primitive) for primitive in shape.primitives])


def mesh_of_quads(
    corners: NDArray[np.float64], colour: tuple[float, float, float], layer: int
) -> Mesh:
    """Return flat quadrilaterals (Q, 4, 3) in one colour as triangles."""
    first = 4 * np.arange(len(corners), dtype=np.int32)[:, None]
    faces = np.concatenate([first + _LOWER, first + _UPPER]).astype(np.int32)
    return Mesh(
        corners.reshape(-1, 3),
        faces,
        np.tile(np.array(colour, np.float32), (len(faces), 1)),
        np.zeros(len(faces), np.float32),
        np.full(len(faces), layer, np.int32),
    )


def _mesh_of_primitive(primitive: Primitive) -> Mesh:
    unit, faces = _SOUPS[primitive.kind]()
    if primitive.kind is Kind.FRUSTUM:
        bottom, top, half = primitive.size
        radius = np.where(unit[:, 2] < 0, bottom, top)
        local = np.column_stack([unit[:, :2] * radius[:, None], unit[:, 2] * half])
    else:
        local = unit * primitive.size
    material = primitive.material
    return Mesh(
        local @ primitive.rotation.T + primitive.centre,
        faces,
        np.tile(np.array(material.colour, np.float32), (len(faces), 1)),
        np.full(len(faces), material.emission, np.float32),
        np.zeros(len(faces), np.int32),
    )


@lru_cache(maxsize=1)
def _unit_box() -> _Soup:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return corners, np.array(faces, np.int32)


@lru_cache(maxsize=1)
def _unit_frustum() -> _Soup:
    """Return rings at z = -1 and 1 about the axis, and the middles of both caps."""
    angle = np.arange(_AROUND) * 2 * np.pi / _AROUND
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.concatenate(
        [
            np.column_stack([ring, np.full(_AROUND, -1.0)]),
            np.column_stack([ring, np.full(_AROUND, 1.0)]),
            [[0, 0, -1.0], [0, 0, 1.0]],
        ]
    )
    i = np.arange(_AROUND)
    j = (i + 1) % _AROUND
    n = np.full(_AROUND, _AROUND)
    faces = np.concatenate(
        [
            np.column_stack([i, j, j + n]),
            np.column_stack([i, j + n, i + n]),
            np.column_stack([j, i, 2 * n]),
            np.column_stack([i + n, j + n, 2 * n + 1]),
        ]
    )
    return vertices, faces.astype(np.int32)


@lru_cache(maxsize=1)
def _unit_sphere() -> _Soup:
    """Return a sphere of bands between the poles."""
    polar = np.arange(_BANDS + 1) * np.pi / _BANDS
    angle = np.arange(_AROUND) * 2 * np.pi / _AROUND
    z, around = np.meshgrid(np.cos(polar), angle, indexing="ij")
    flat = np.sin(polar)[:, None]
    vertices = np.stack([flat * np.cos(around), flat * np.sin(around), z], axis=2).reshape(-1, 3)
    band, i = (a.ravel() for a in np.meshgrid(np.arange(_BANDS), np.arange(_AROUND), indexing="ij"))
    j = (i + 1) % _AROUND
    a, b = band * _AROUND + i, band * _AROUND + j
    lower = np.column_stack([a, a + _AROUND, b + _AROUND])[band < _BANDS - 1]
    upper = np.column_stack([a, b + _AROUND, b])[band > 0]
    return vertices, np.concatenate([lower, upper]).astype(np.int32)


_SOUPS = {Kind.BOX: _unit_box, Kind.FRUSTUM: _unit_frustum, Kind.ELLIPSOID: _unit_sphere}
