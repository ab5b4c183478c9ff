"""Which views of a board can be used for intrinsics at all, and their corners as arrays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from percept.calib.intrinsics.solver import Observations

if TYPE_CHECKING:
    from percept.calib.boards.definitions import Board
    from percept.calib.boards.detection import BoardView

__all__ = ["UsableViews", "usable_views"]

_F64 = NDArray[np.float64]

_FEWEST_CORNERS = 6
_THINNEST = 0.05  # second over first extent of the corners seen, on the board


@dataclass(frozen=True, slots=True, eq=False)
class UsableViews:
    """Views that show enough of a board, in images of one size.

    Attributes:
        image_size: (width, height) in pixels of most views.
        indices: (V,) which of the views that were given.
        observations: Their corners.
        counted: For each of these, which of its corners (N,) the observations hold.
        unusable: Why not, by index, for the others.
    """

    image_size: tuple[int, int]
    indices: NDArray[np.int64]
    observations: Observations
    counted: tuple[NDArray[np.bool_], ...]
    unusable: dict[int, str]


def usable_views(views: Sequence[BoardView], board: Board) -> UsableViews:
    """Sort out what cannot be used: another image size, too few corners, a mirrored board.

    A corner that is not finite or has no counterpart on the board is left out; a view of which
    fewer than six are left, or only a line of them, is not used.
    """
    sizes = Counter((view.image_size[0], view.image_size[1]) for view in views)
    image_size: tuple[int, int] = (
        max(sizes, key=lambda size: (sizes[size], size)) if sizes else (0, 0)
    )
    corners = board.corners_board()
    unusable: dict[int, str] = {}
    turns: dict[int, float] = {}
    for index, view in enumerate(views):
        reason = _size_reason(view, image_size) or _corner_reason(view, corners)
        if reason is None:
            turns[index] = _turn(view, corners)
        else:
            unusable[index] = reason
    usual = np.sign(sum(np.sign(list(turns.values()))))
    for index, turn in turns.items():
        if usual and np.sign(turn) == -usual:
            unusable[index] = "mirrored: its corners run the other way round than in most views"
    indices = np.array([index for index in turns if index not in unusable], dtype=np.int64)
    kept = [views[index] for index in indices]
    counted = tuple(_counts(view, corners) for view in kept)
    return UsableViews(image_size, indices, _stack(kept, corners), counted, unusable)


def _size_reason(view: BoardView, image_size: tuple[int, int]) -> str | None:
    if tuple(view.image_size) == image_size:
        return None
    width, height = view.image_size
    return f"is {width}x{height}, most are {image_size[0]}x{image_size[1]}"


def _corner_reason(view: BoardView, corners: _F64) -> str | None:
    seen = corners[view.ids[_counts(view, corners)]]
    if len(seen) < _FEWEST_CORNERS:
        return f"has {len(seen)} usable corners, {_FEWEST_CORNERS} are needed"
    extents = np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False)
    if extents[1] < _THINNEST * extents[0]:
        return "its corners lie on one line of the board"
    return None


def _counts(view: BoardView, corners: _F64) -> NDArray[np.bool_]:
    """Return which corners (N,) are finite and on the board."""
    known = (view.ids >= 0) & (view.ids < len(corners))
    counted: NDArray[np.bool_] = np.isfinite(view.corners_px).all(axis=1) & known
    return counted


def _turn(view: BoardView, corners: _F64) -> float:
    """Return the determinant of the best linear map from board to image: its sign is the turn."""
    counted = _counts(view, corners)
    board, pixels = corners[view.ids[counted], :2], view.corners_px[counted]
    to_image = np.linalg.lstsq(board - board.mean(axis=0), pixels - pixels.mean(axis=0))[0]
    return float(np.linalg.det(to_image))


def _stack(views: Sequence[BoardView], corners: _F64) -> Observations:
    most = max((len(view.ids) for view in views), default=0)
    board = np.zeros((len(views), most, 3))
    pixels, weights = np.zeros((len(views), most, 2)), np.zeros((len(views), most))
    bend = np.zeros((len(views), most, 2))
    middle = (corners.max(axis=0) + corners.min(axis=0))[:2] / 2
    half = (corners.max(axis=0) - corners.min(axis=0))[:2] / 2
    bends = 1 - ((corners[:, :2] - middle) / half) ** 2
    for row, view in enumerate(views):
        counted = _counts(view, corners)
        count = int(counted.sum())
        board[row, :count] = corners[view.ids[counted]]
        bend[row, :count] = bends[view.ids[counted]]
        pixels[row, :count] = view.corners_px[counted]
        weights[row, :count] = 1.0
    return Observations(board, bend, pixels, weights)
