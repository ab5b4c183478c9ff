"""Calibration boards: what is printed on them and how large it is.

All boards have their x along the columns, to the right, and y along the rows, downwards, when
they are looked at; z = x cross y points into the board, away from who looks at it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from percept.calib.boards.files import read_board_file
from percept.core.errors import UsageError

__all__ = ["AprilGrid", "Board", "BoardDefinition", "CharucoBoard", "Checkerboard", "load_board"]

_F64 = NDArray[np.float64]

_FORMS = (
    "Write checkerboard:COLUMNSxROWS:SQUARE (inner corners), "
    "charuco:COLUMNSxROWS:SQUARE:MARKER[:DICTIONARY] (squares), "
    "aprilgrid:COLUMNSxROWS:TAG:SPACING (tags; spacing as a share of the tag), "
    "or the path of a board file; lengths in metres"
)
_LARGEST_M = 10.0
_MOST_CORNERS = 10_000


class Board(Protocol):
    """A flat pattern with corners whose places are known."""

    @property
    def pattern_size_m(self) -> tuple[float, float]:
        """(width along x, height along y) of what is printed, without a margin, in metres."""

    def corners_board(self) -> _F64:
        """Return the corners (N, 3) in the board's frame, metres, z zero."""

    def describe(self) -> str:
        """Return what the board is in a few words."""


@dataclass(frozen=True, slots=True)
class Checkerboard:
    """A checkerboard, counted in inner corners as OpenCV counts them.

    Where columns and rows are an odd and an even number, the first corner is the one whose
    outermost square is black, and every view has the same order. Otherwise the pattern looks
    the same upside down (`symmetric`).

    Attributes:
        columns: Inner corners along the board's x.
        rows: Inner corners along the board's y.
        square_m: Side of a square in metres.
    """

    columns: int
    rows: int
    square_m: float

    @property
    def symmetric(self) -> bool:
        """Whether half a turn changes nothing, so that a pose is known up to 180 degrees."""
        return (self.columns - self.rows) % 2 == 0

    @property
    def pattern_size_m(self) -> tuple[float, float]:
        """(width, height) over all squares, metres."""
        return (self.columns + 1) * self.square_m, (self.rows + 1) * self.square_m

    def corners_board(self) -> _F64:
        """Return the inner corners (columns * rows, 3) in the board's frame, row by row.

        The origin is the first corner, x runs along a row, y from row to row, z is zero.
        """
        return _lattice(self.columns, self.rows) * self.square_m

    def describe(self) -> str:
        """Return what the board is in a few words."""
        return (
            f"checkerboard of {self.columns}x{self.rows} inner corners, "
            f"{1000 * self.square_m:g} mm squares"
        )


@dataclass(frozen=True, slots=True)
class CharucoBoard:
    """A checkerboard with markers in its white squares, as OpenCV (4.6 or later) draws it.

    Attributes:
        columns: Squares along the board's x, as OpenCV counts them for this kind of board.
        rows: Squares along the board's y.
        square_m: Side of a square in metres.
        marker_m: Side of a marker in metres.
        dictionary: Name of OpenCV's marker dictionary, without `DICT_`.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str = "5X5_250"

    @property
    def pattern_size_m(self) -> tuple[float, float]:
        """(width, height) over all squares, metres."""
        return self.columns * self.square_m, self.rows * self.square_m

    def corners_board(self) -> _F64:
        """Return the inner corners ((columns - 1) * (rows - 1), 3), row by row, OpenCV's order.

        The origin is the first corner, one square right of and below the pattern's edge.
        """
        return _lattice(self.columns - 1, self.rows - 1) * self.square_m

    def describe(self) -> str:
        """Return what the board is in a few words."""
        return (
            f"ChArUco board of {self.columns}x{self.rows} squares of {1000 * self.square_m:g} mm, "
            f"{self.dictionary} markers of {1000 * self.marker_m:g} mm"
        )


@dataclass(frozen=True, slots=True)
class AprilGrid:
    """Kalibr's grid of AprilTags (family 36h11, black border of two bits).

    Tag 0 is at the bottom left, the ids run to the right and then up. Corner 4 k + c belongs to
    tag k: bottom left, bottom right, top right, top left.

    Attributes:
        columns: Tags along the board's x.
        rows: Tags along the board's y.
        tag_m: Side of a tag's black border in metres.
        spacing: Gap between tags as a share of their side, Kalibr's `tagSpacing`.
    """

    columns: int
    rows: int
    tag_m: float
    spacing: float

    @property
    def pattern_size_m(self) -> tuple[float, float]:
        """(width, height) from the first tag's edge to the last one's, metres."""
        return (
            self.tag_m * (self.columns + (self.columns - 1) * self.spacing),
            self.tag_m * (self.rows + (self.rows - 1) * self.spacing),
        )

    def corners_board(self) -> _F64:
        """Return the tags' corners (4 * columns * rows, 3).

        The origin is the bottom left corner of tag 0, x to the right; y points down here, unlike
        in Kalibr's own frame, so that all boards have the same side in front.
        """
        tags = _lattice(self.columns, self.rows) * (1 + self.spacing)
        square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
        corners: _F64 = (tags[:, None] + square).reshape(-1, 3) * self.tag_m
        return corners * [1.0, -1.0, 1.0]

    def describe(self) -> str:
        """Return what the board is in a few words."""
        return (
            f"AprilGrid of {self.columns}x{self.rows} tags of {1000 * self.tag_m:g} mm, "
            f"spacing {self.spacing:g}"
        )


@dataclass(frozen=True, slots=True)
class BoardDefinition:
    """A board, and the plate that it is mounted on where that is known.

    Attributes:
        board: What is printed.
        plate_size_m: (width along the board's x, height along its y) in metres, or None.
    """

    board: Board
    plate_size_m: tuple[float, float] | None = None


def load_board(text_or_path: str | Path) -> BoardDefinition:
    """Read a board from its text or from a board file.

    Args:
        text_or_path: `checkerboard:9x6:0.025`, `charuco:5x7:0.04:0.03[:5X5_250]`,
            `aprilgrid:6x6:0.088:0.3`, or a YAML file: percept's (`board`, `board_size`) or a
            Kalibr target.

    Raises:
        UsageError: If it is neither, a number makes no sense, or the pattern is larger than its
            plate.
    """
    path = Path(text_or_path)
    is_file = path.suffix in (".yaml", ".yml") or path.is_file()
    text, size = read_board_file(path) if is_file else (str(text_or_path), None)
    where = f"{path}: {text}" if is_file else text
    board = _parse(text, where)
    plate_size_m = None if size is None else _parse_size(size, where)
    if plate_size_m is not None:
        _check_fit(board, plate_size_m, where)
    return BoardDefinition(board, plate_size_m)


def _parse(text: str, where: str) -> Board:
    kind, *fields = text.strip().split(":")
    parsers = {"checkerboard": _checkerboard, "charuco": _charuco, "aprilgrid": _aprilgrid}
    try:
        columns, rows = (int(part) for part in fields[0].lower().split("x"))
        board = parsers[kind.lower()](columns, rows, fields[1:])
    except (ValueError, KeyError, IndexError) as error:
        raise UsageError("is no board", where=where, remedy=_FORMS) from error
    extent = max(board.pattern_size_m)
    if not 0 < columns * rows <= _MOST_CORNERS or not 0 < extent < _LARGEST_M:
        raise UsageError(f"a pattern of {extent:g} m makes no sense", where=where, remedy=_FORMS)
    return board


def _checkerboard(columns: int, rows: int, fields: list[str]) -> Board:
    (square_m,) = (_length(field) for field in fields)
    if min(columns, rows) < 3:
        raise ValueError(fields)
    return Checkerboard(columns, rows, square_m)


def _charuco(columns: int, rows: int, fields: list[str]) -> Board:
    square_m, marker_m = (_length(field) for field in fields[:2])
    dictionary = fields[2].upper().removeprefix("DICT_") if len(fields) > 2 else "5X5_250"
    if min(columns, rows) < 3 or marker_m >= square_m or len(fields) > 3:
        raise ValueError(fields)
    return CharucoBoard(columns, rows, square_m, marker_m, dictionary)


def _aprilgrid(columns: int, rows: int, fields: list[str]) -> Board:
    tag_m, spacing = (_length(field) for field in fields)
    if min(columns, rows) < 1 or columns * rows < 2 or spacing > 1:
        raise ValueError(fields)
    return AprilGrid(columns, rows, tag_m, spacing)


def _length(text: str) -> float:
    value = float(text)
    if not (math.isfinite(value) and value > 0):
        raise ValueError(text)
    return value


def _parse_size(text: str, where: str) -> tuple[float, float]:
    try:
        width_m, height_m = (_length(part) for part in text.lower().split("x"))
    except ValueError as error:
        raise UsageError(
            f"board_size '{text}' is no size", where=where, remedy="Write WIDTHxHEIGHT in metres"
        ) from error
    return width_m, height_m


def _check_fit(board: Board, plate_size_m: tuple[float, float], where: str) -> None:
    pattern = np.asarray(board.pattern_size_m)
    if (pattern <= np.asarray(plate_size_m) * (1 + 1e-6)).all():
        return
    turned = (pattern[::-1] <= np.asarray(plate_size_m) * (1 + 1e-6)).all()
    raise UsageError(
        f"a pattern of {pattern[0]:g} x {pattern[1]:g} m does not fit on a plate of "
        f"{plate_size_m[0]:g} x {plate_size_m[1]:g} m",
        where=where,
        remedy="Swap columns and rows, or width and height" if turned else "Check the sizes",
    )


def _lattice(columns: int, rows: int) -> _F64:
    """Return the points (columns * rows, 3) of a lattice of step 1, row by row."""
    row, column = np.divmod(np.arange(columns * rows), columns)
    return np.column_stack([column, row, np.zeros(len(row))]).astype(np.float64)
