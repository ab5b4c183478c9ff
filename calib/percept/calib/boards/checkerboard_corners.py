"""Finding a checkerboard's inner corners in an image, in bounded time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.calib.boards.definitions import Checkerboard
from percept.calib.boards.grid_check import canonical_order, grid_fault, smallest_gap_px

__all__ = ["find_checkerboard", "refine_corners"]

_F64 = NDArray[np.float64]
_U8 = NDArray[np.uint8]
_Search = Callable[[_U8, tuple[int, int]], _F64 | None]

_MOST_PIXELS = 1.5e6  # a search's time grows with the pixels; corners are refined on all of them
_PIXELS_OF_ANY = 2.5e5  # to see whether there is a board of another size
_TIME_LIMIT_S = 2.0
_LARGEST_WINDOW_PX = 11
_DISAGREEING_PX = 0.5  # between windows: more than noise does to either of them
_NEIGHBOURS = 12  # so few that a lens bends little between them
_SMALLEST_GAP_PX = 5.0  # below it a corner's window holds its neighbours
_GRAINY = 0.25  # white noise has 0.7, a street in the rain 0.1
_CLASSIC = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)


def find_checkerboard(grey: _U8, board: Checkerboard) -> tuple[_F64, _F64] | str:
    """Find all inner corners of a checkerboard.

    A call into OpenCV cannot be interrupted, so the searches run on a reduced image, in the
    order of their cost, and none begins after two seconds. What they find is refined on the
    full image and believed only when the squares' brightness agrees.

    Args:
        grey: (H, W) uint8.
        board: Its inner corners are all in view, or it is not found.

    Returns:
        Corners (N, 2) in the order of `corners_board()`, and how far (M,) the sub-pixel windows of
        the corners that were taken again disagreed, both in pixels; or why there are none.
    """
    began = time.thread_time()
    scale = min(1.0, float(np.sqrt(_MOST_PIXELS / grey.size)))
    small = _resized(grey, scale)
    fault: str | None = None
    for search in _searches(small, board):
        if time.thread_time() - began > _TIME_LIMIT_S:
            return fault or f"no board found within the time limit of {_TIME_LIMIT_S:g} s"
        found = search(small, (board.columns, board.rows))
        if found is None:
            continue
        # Area interpolation: a pixel's centre (0) lies in the middle of those that it covers.
        start = (found + 0.5) / scale - 0.5
        result = _settled(grey, start.reshape(board.rows, board.columns, 2))
        if not isinstance(result, str):
            return result
        fault = fault or result
    if fault is not None and not fault.startswith("no board"):
        return fault
    return _reason(*_any_grid(_resized(small, 0.5)), board)


def _searches(small: _U8, board: Checkerboard) -> Iterator[_Search]:
    """Yield the searches that are worth their time, the next only when the last was in vain.

    The classic one takes 0.03 s where the board is and seconds where it is not: it must look
    possible, and no other board may be in view.
    """
    yield _half_scale
    grid, whole = _any_grid(_for_any_grid(small))
    another = whole and grid is not None and not _has_shape(grid, board)
    if not another and cv2.checkChessboard(small, (board.columns, board.rows)):
        yield _classic
    yield _sectors
    if not another:
        yield _equalised


def refine_corners(
    grey: _U8, corners_px: _F64, places: _F64, gap_px: float
) -> tuple[_F64, NDArray[np.bool_], _F64]:
    """Place corners where the gradients around them meet (cv2.cornerSubPix).

    A wide window averages more noise and recovers from a poor guess; a narrow one sees less that
    is not the corner, such as a narrow margin. Where the two disagree, the corners around them
    decide.

    Args:
        grey: (H, W) uint8.
        corners_px: (N, 2) first guesses.
        places: (N, 2) or (N, 3) where they are on the board, in any unit.
        gap_px: Smallest distance between corners; half of it, at most 11, is the window.

    Returns:
        Corners (N, 2), which of them (N,) stayed within half the gap of their guess, and how far
        (N,) the two windows disagreed, pixels.
    """
    window = int(np.clip(gap_px / 2, 2, _LARGEST_WINDOW_PX))
    refined, _ = _by_windows(grey, corners_px, places, window)
    # A guess that was far off makes the windows disagree too; from the right place they do not.
    refined, jumps = _by_windows(grey, refined, places, window)
    moved = np.abs(refined - corners_px).max(axis=1)
    return refined, moved <= max(gap_px / 2, 1.5), jumps


def _by_windows(grey: _U8, start: _F64, places: _F64, window: int) -> tuple[_F64, _F64]:
    """Return corners (N, 2) by two windows, and how far (N,) the windows disagree."""
    wide, narrow = (_placed(grey, start, w) for w in (window, max(window // 2, 2)))
    agree = np.abs(wide - narrow).max(axis=1) <= _DISAGREEING_PX
    refined = wide.copy()
    for k in np.flatnonzero(~agree):
        expected = _expected(places[:, :2], wide, agree, int(k))
        if np.linalg.norm(narrow[k] - expected) < np.linalg.norm(wide[k] - expected):
            refined[k] = narrow[k]
    return refined, np.linalg.norm(wide - narrow, axis=1)


def _expected(places: _F64, corners_px: _F64, sound: NDArray[np.bool_], k: int) -> _F64:
    """Return where the nearest sound corners put corner k, by a homography of theirs."""
    near = np.argsort(np.linalg.norm(places - places[k], axis=1) + np.where(sound, 0.0, np.inf))
    near = near[: min(_NEIGHBOURS, np.count_nonzero(sound))]
    if len(near) < 4:
        return np.asarray(corners_px[k], np.float64)
    spread = np.linalg.svd(places[near] - places[near].mean(axis=0), compute_uv=False)
    if spread[1] < 1e-3 * spread[0]:
        return np.asarray(corners_px[k], np.float64)
    fitted: tuple[Any, ...] = cv2.findHomography(places[near], corners_px[near], 0)
    if fitted[0] is None:
        return np.asarray(corners_px[k], np.float64)
    put: _F64 = cv2.perspectiveTransform(places[None, k : k + 1], fitted[0])[0, 0]
    return put


def _placed(grey: _U8, corners_px: _F64, window: int) -> _F64:
    start = np.ascontiguousarray(corners_px, dtype=np.float32).reshape(-1, 1, 2)
    placed = cv2.cornerSubPix(grey, start.copy(), (window, window), (-1, -1), _STOP)
    return placed.reshape(-1, 2).astype(np.float64)


def _settled(grey: _U8, grid: _F64) -> tuple[_F64, _F64] | str:
    """Return a grid's corners refined, checked and in their order, or what is wrong with it.

    With them come the disagreements of the windows, of the corners where there is one.
    """
    height, width = grey.shape
    gap_px = smallest_gap_px(grid)
    if gap_px < _SMALLEST_GAP_PX:
        return f"the board is too small in the image: its squares are {gap_px:.1f} px wide"
    if (grid < 0).any() or (grid > [width - 1, height - 1]).any():
        return "the board is partly out of view"
    fault = grid_fault(grey, grid)
    if fault is not None:
        return fault
    corners, sound, jumps = refine_corners(grey, grid.reshape(-1, 2), _places(grid), gap_px)
    if not sound.all():
        return f"{np.count_nonzero(~sound)} of {len(sound)} corners could not be placed"
    grid = corners.reshape(grid.shape)
    fault = grid_fault(grey, grid)
    if fault is not None:
        return fault
    return canonical_order(grey, grid).reshape(-1, 2), jumps[jumps > _DISAGREEING_PX]


def _places(grid: _F64) -> _F64:
    row, column = np.indices(grid.shape[:2], dtype=np.float64).reshape(2, -1)
    return np.column_stack([column, row])


def _classic(small: _U8, size: tuple[int, int]) -> _F64 | None:
    # It follows every contour: ten seconds of them in noise. OpenCV's own FAST_CHECK against
    # that refuses sound boards with a dark vignette.
    if _graininess(small) > _GRAINY:
        return None
    return _corners(*cv2.findChessboardCorners(small, size, flags=_CLASSIC))


def _graininess(grey: _U8) -> float:
    """Return the share of an image's variation that a 3 x 3 smoothing takes away."""
    fine = cv2.absdiff(grey, cv2.GaussianBlur(grey, (3, 3), 0))
    return float(fine.mean() / max(float(grey.std()), 1.0))


def _sectors(small: _U8, size: tuple[int, int]) -> _F64 | None:
    """Duda and Frese 2018, by Radon transform: steady in time, stronger with blur and noise."""
    return _corners(*cv2.findChessboardCornersSB(small, size))


def _half_scale(small: _U8, size: tuple[int, int]) -> _F64 | None:
    half = cv2.GaussianBlur(_resized(small, 0.5), (0, 0), 1.0)
    found = _corners(*cv2.findChessboardCorners(np.asarray(half, np.uint8), size, flags=_CLASSIC))
    return None if found is None else 2 * found + 0.5


def _equalised(small: _U8, size: tuple[int, int]) -> _F64 | None:
    return _sectors(_locally_equalised(small), size)


def _corners(found: bool, corners: NDArray[Any] | None) -> _F64 | None:  # noqa: FBT001 - OpenCV's pair
    if not found or corners is None:
        return None
    return corners.reshape(-1, 2).astype(np.float64)


def _resized(grey: _U8, scale: float) -> _U8:
    if scale == 1.0:
        return grey
    return np.asarray(
        cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8
    )


def _locally_equalised(grey: _U8) -> _U8:
    return np.asarray(cv2.createCLAHE(clipLimit=3.0, tileGridSize=(8, 8)).apply(grey), np.uint8)


def _reason(grid: _F64 | None, whole: bool, board: Checkerboard) -> str:  # noqa: FBT001 - a pair
    """Say why no board was found, from what part of one can be seen."""
    if grid is None:
        return f"no whole board of {board.columns}x{board.rows} inner corners in view"
    rows, columns = grid.shape[:2]
    larger = max(rows, columns) > max(board.rows, board.columns)
    if larger or (whole and min(rows, columns) > min(board.rows, board.columns)):
        return (
            f"the board in view has {columns}x{rows} inner corners, "
            f"not {board.columns}x{board.rows}"
        )
    return (
        f"only part of the board seen: {rows * columns} of {board.rows * board.columns} "
        f"corners ({columns}x{rows})"
    )


def _has_shape(grid: _F64, board: Checkerboard) -> bool:
    return sorted(grid.shape[:2]) == sorted((board.rows, board.columns))


def _for_any_grid(small: _U8) -> _U8:
    return _resized(small, min(1.0, float(np.sqrt(_PIXELS_OF_ANY / small.size))))


def _any_grid(image: _U8) -> tuple[_F64 | None, bool]:
    """Return a checkerboard of any size (rows, columns, 2), and whether it is all in view."""
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners, meta = cv2.findChessboardCornersSBWithMeta(image, (3, 3), flags)
    if not found:
        return None, False
    grid = corners.reshape(*meta.shape[:2], 2).astype(np.float64)
    fault = grid_fault(image, grid)
    if fault is not None and fault.startswith("no board"):
        return None, False
    if abs(grid[0, -1, 0] - grid[0, 0, 0]) < abs(grid[0, -1, 1] - grid[0, 0, 1]):
        grid = grid.swapaxes(0, 1)  # columns are what lies side by side in the image
    return grid, fault is None
