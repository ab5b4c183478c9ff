"""Calibration boards: what is printed on them and how large it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import UsageError

__all__ = ["Checkerboard", "parse_board"]


@dataclass(frozen=True, slots=True)
class Checkerboard:
    """A checkerboard, counted in inner corners as OpenCV counts them.

    Attributes:
        columns: Inner corners along the board's x.
        rows: Inner corners along the board's y.
        square_m: Side of a square in metres.
    """

    columns: int
    rows: int
    square_m: float

    def corners_board(self) -> NDArray[np.float64]:
        """Return the inner corners (columns * rows, 3) in the board's frame, row by row.

        The origin is the first corner, x runs along a row, y from row to row, z is zero.
        """
        row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
        flat = np.zeros(len(row))
        return np.column_stack([column, row, flat]) * self.square_m


def parse_board(text: str) -> Checkerboard:
    """Read a board from `checkerboard:COLUMNSxROWS:SQUARE`, such as `checkerboard:9x6:0.025`.

    Raises:
        UsageError: If the text is not of that form or a number makes no sense.
    """
    remedy = "Write checkerboard:COLUMNSxROWS:SQUARE with inner corners and metres"
    try:
        kind, grid, square = text.split(":")
        columns, rows = (int(part) for part in grid.split("x"))
        square_m = float(square)
    except ValueError as error:
        raise UsageError("is no board", where=text, remedy=remedy) from error
    if kind != "checkerboard" or min(columns, rows) < 2 or not 0 < square_m < 10:
        raise UsageError("is no board", where=text, remedy=remedy)
    return Checkerboard(columns, rows, square_m)
