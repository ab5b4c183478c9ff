"""The board of the synthetic calibration: a checkerboard on a plate, on a thin stand."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from percept.calib.boards.definitions import Checkerboard
from percept.core.transform import Transform
from percept.datasets.synthetic.board_mesh import board_mesh
from percept.datasets.synthetic.layout import Placed
from percept.datasets.synthetic.mesh import Mesh, joined
from percept.datasets.synthetic.primitives import Kind, Material, Primitive, frustum
from percept.datasets.synthetic.shapes import Shape, make_scenery
from percept.datasets.synthetic.terrain import Profile
from percept.datasets.synthetic.tessellate import mesh_of_shape

__all__ = ["BOARD", "BOARD_ID", "PLATE_SIZE_M", "board_object", "plate_corners_board", "stand_mesh"]

BOARD = Checkerboard(9, 6, 0.1)
"""One side odd and one even: turned by 180 degrees it is another pattern."""

PLATE_SIZE_M = (1.2, 0.9)
"""Width along the board's x and height along its y; the pattern has a margin of one square."""

BOARD_ID = 2_000_000_000
"""The object id of the board in the truth of scans."""

_THICKNESS_M = 0.01
# Black squares lie this much before the plate, so that rays meet them first: far below noise.
_PROUD_M = 1e-6
_WHITE = Material((0.85, 0.85, 0.85), 0.75)
_BLACK = Material((0.04, 0.04, 0.04), 0.08)
_STEEL = Material((0.3, 0.3, 0.3), 0.3)
_POLE_RADIUS_M, _POLE_BEHIND_M = 0.01, 0.08


def plate_corners_board() -> NDArray[np.float64]:
    """Return the corners (4, 3) of the plate in the board's frame, metres."""
    half = np.array(PLATE_SIZE_M) / 2
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return np.column_stack([_centre_board()[:2] + signs * half, np.zeros(4)])


def board_object(T_map_board: Transform, profile: Profile) -> Placed:
    """Return the board and its stand as an object of the street, for rays.

    The printed face lies in the plane z = 0 of the board's frame and looks along its -z.
    """
    x, y, z = T_map_board.translation_m.tolist()
    ground = float(profile.ground(x, y))
    shape = make_scenery("board", [*_tiles(T_map_board.rotation), *_stand(T_map_board, profile)])
    return Placed(BOARD_ID, shape, x, y, z - ground, 0.0)


def stand_mesh(T_map_board: Transform, profile: Profile) -> Mesh:
    """Return the board and its stand as triangles in the map frame, for cameras."""
    stand: Shape = make_scenery("stand", list(_stand(T_map_board, profile)))
    mesh = mesh_of_shape(stand)
    vertices = mesh.vertices + T_map_board.translation_m
    pole = Mesh(vertices, mesh.faces, mesh.colours, mesh.emission, mesh.layer)
    return joined([board_mesh(BOARD, PLATE_SIZE_M, T_map_board), pole])


def _centre_board() -> NDArray[np.float64]:
    centre: NDArray[np.float64] = BOARD.corners_board().mean(axis=0)
    return centre


def _tiles(R_map_board: NDArray[np.float64]) -> Iterator[Primitive]:
    """Yield the black squares and the plate, from the board's origin in the axes of the map."""
    side = BOARD.square_m
    columns, rows = BOARD.columns + 1, BOARD.rows + 1
    for row, column in np.ndindex(rows, columns):
        if (row + column) % 2 == 0:
            middle = np.array([column - 0.5, row - 0.5]) * side
            yield _tile(R_map_board, middle, (side, side), -_PROUD_M, _BLACK)
    yield _tile(R_map_board, _centre_board()[:2], PLATE_SIZE_M, 0.0, _WHITE)


def _tile(
    R_map_board: NDArray[np.float64],
    middle: NDArray[np.float64],
    size_m: tuple[float, float],
    front_m: float,
    material: Material,
) -> Primitive:
    half = np.array([size_m[0] / 2, size_m[1] / 2, _THICKNESS_M / 2])
    centre = R_map_board @ np.append(middle, front_m + _THICKNESS_M / 2)
    return Primitive(Kind.BOX, centre, R_map_board, half, material)


def _stand(T_map_board: Transform, profile: Profile) -> Iterator[Primitive]:
    """Yield a pole that ends behind the lowest edge, from the origin in the axes of the map."""
    corners = plate_corners_board()
    middles = (corners + np.roll(corners, -1, axis=0)) / 2 + [0, 0, _POLE_BEHIND_M]
    ends = T_map_board.apply(middles)
    top = ends[ends[:, 2].argmin()]
    foot = np.array([top[0], top[1], float(profile.ground(top[0], top[1])) - 0.05])
    origin = T_map_board.translation_m
    if top[2] - foot[2] > 0.1:
        yield frustum(foot - origin, top - origin, _POLE_RADIUS_M, _STEEL)
