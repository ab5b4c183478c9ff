"""Calibration boards as triangles, for the camera renderer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.calib.boards.definitions import Checkerboard
from percept.core.errors import GeometryError
from percept.core.transform import Transform
from percept.datasets.synthetic.mesh import Mesh

__all__ = ["board_mesh"]

_WHITE = 0.85
_BLACK = 0.04


def board_mesh(
    board: Checkerboard, size_m: tuple[float, float], T_map_board: Transform, *, layer: int = 0
) -> Mesh:
    """Return a checkerboard on a white plate, which share one centre.

    Args:
        board: The pattern; its outer squares stand around the inner corners.
        size_m: Width along the board's x and height along its y of the plate.
        T_map_board: Places the board; its origin is the first inner corner.
        layer: Of the plate; the black squares lie on the layer above.

    Raises:
        GeometryError: If the pattern does not fit on the plate.
    """
    squares = np.array([board.columns + 1, board.rows + 1])
    if (squares * board.square_m > np.asarray(size_m) * (1 + 1e-9)).any():
        raise GeometryError(f"the pattern does not fit on a plate of {size_m[0]} x {size_m[1]} m")
    centre = (squares / 2 - 1) * board.square_m
    row, column = np.divmod(np.arange(squares.prod()), squares[0])
    black = (row + column) % 2 == 0
    low = np.column_stack([column[black] - 1, row[black] - 1]) * board.square_m
    lows = np.vstack([centre - np.asarray(size_m) / 2, low])
    highs = np.vstack([centre + np.asarray(size_m) / 2, low + board.square_m])
    shades = np.where(np.arange(len(lows)) == 0, _WHITE, _BLACK)
    faces = np.arange(4 * len(lows)).reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    return Mesh(
        T_map_board.apply(_rectangles(lows, highs)),
        faces.astype(np.int32),
        np.repeat(shades, 6).reshape(-1, 3).astype(np.float32),
        np.zeros(len(faces), np.float32),
        np.repeat(layer + (shades == _BLACK), 2).astype(np.int32),
    )


def _rectangles(lows: NDArray[np.float64], highs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners (4 N, 3) of rectangles in the board's plane."""
    x0, y0, x1, y1 = *lows.T, *highs.T
    flat = np.zeros(len(lows))
    corners = [np.column_stack([x, y, flat]) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
    return np.stack(corners, axis=1).reshape(-1, 3)
