"""Finding calibration boards in images: one image, or many on all cores."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.calib.boards.checkerboard_corners import find_checkerboard
from percept.calib.boards.definitions import AprilGrid, Board, CharucoBoard, Checkerboard
from percept.calib.boards.marker_corners import find_aprilgrid, find_charuco
from percept.calib.boards.views import BoardView, NoBoard
from percept.core.errors import GeometryError, InputError

__all__ = ["BoardView", "NoBoard", "detect_board", "detect_boards"]

_U8 = NDArray[np.uint8]
_Loader = Callable[[], NDArray[Any]]

_WORKERS = 2  # OpenCV's own threads use further cores
_SMALLEST_SIDE_PX = 32
_LEAST_CONTRAST = 8.0  # grey levels between the darkest and the brightest half percent
_DARK = 40.0
_BRIGHT = 215.0
_NO_JUMPS = np.zeros(0)
_RISES = 16  # corners at which the blur is measured
_LONGEST_RISE = 0.5  # of the gap between corners; then black and white run into each other


def detect_board(pixels: NDArray[Any], board: Board, *, name: str = "image") -> BoardView | NoBoard:
    """Find a board in an image.

    Args:
        pixels: (H, W) or (H, W, 3) BGR; uint8, or any other number that is stretched to it.
        board: What is printed on the board.
        name: Of the image, for the result.

    Returns:
        The board's corners, or why it was not found.

    Raises:
        GeometryError: If the pixels have another shape.
        UsageError: If the board's marker dictionary does not exist.
    """
    grey = _grey(pixels)
    dull = _dullness(grey)
    if dull is not None:
        return NoBoard(name, dull)
    found = _find(grey, board)
    if isinstance(found, str):
        return NoBoard(name, _with_blur(grey, found))
    ids, corners_px, jumps_px = found
    size = (grey.shape[1], grey.shape[0])
    rise_px, gap_px = _edge_rise_px(grey, corners_px), _corner_gap_px(corners_px)
    if rise_px > _LONGEST_RISE * gap_px:
        return NoBoard(name, f"too blurred: edges rise over {rise_px:.1f} of {gap_px:.0f} px")
    return BoardView(name, size, ids, corners_px, rise_px, jumps_px)


def detect_boards(
    images: Iterable[tuple[str, _Loader]],
    board: Board,
    progress: Callable[[float], None] | None = None,
) -> tuple[list[BoardView], list[NoBoard]]:
    """Find a board in many images, two at a time, with no more than four of them in memory.

    Args:
        images: Name and a function that returns the pixels, as `detect_board` takes them.
        board: What is printed on the board.
        progress: Called with the number of images done.

    Returns:
        The views, and the images without a board or that cannot be read, each in the order given.
    """
    views: list[BoardView] = []
    without: list[NoBoard] = []
    waiting: deque[Future[BoardView | NoBoard]] = deque()

    def collect() -> None:
        result = waiting.popleft().result()
        (views if isinstance(result, BoardView) else without).append(result)  # type: ignore[arg-type] # one list a kind
        if progress is not None:
            progress(len(views) + len(without))

    with ThreadPoolExecutor(_WORKERS) as pool:
        for name, load in images:
            waiting.append(pool.submit(_load_and_detect, name, load, board))
            if len(waiting) >= 2 * _WORKERS:
                collect()
        while waiting:
            collect()
    return views, without


def _load_and_detect(name: str, load: _Loader, board: Board) -> BoardView | NoBoard:
    try:
        pixels = load()
    except InputError as error:
        return NoBoard(name, f"cannot be read ({error.what})")
    return detect_board(pixels, board, name=name)


def _find(
    grey: _U8, board: Board
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]] | str:
    if isinstance(board, CharucoBoard):
        marked = find_charuco(grey, board)
        return marked if isinstance(marked, str) else (*marked, _NO_JUMPS)
    if isinstance(board, AprilGrid):
        marked = find_aprilgrid(grey, board)
        return marked if isinstance(marked, str) else (*marked, _NO_JUMPS)
    if not isinstance(board, Checkerboard):
        raise GeometryError(f"no detector for a {type(board).__name__}")
    found = find_checkerboard(grey, board)
    if isinstance(found, str):
        return found
    corners, jumps_px = found
    return np.arange(len(corners), dtype=np.int64), corners, jumps_px


def _grey(pixels: NDArray[Any]) -> _U8:
    image = np.asarray(pixels)
    if image.ndim == 3 and image.shape[2] == 3:
        image = image if image.dtype in (np.uint8, np.uint16) else image.astype(np.float32)
        image = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_BGR2GRAY)
    if image.ndim != 2:
        raise GeometryError(f"an image is (H, W) or (H, W, 3), not {image.shape}")
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    if image.size == 0:
        return np.zeros(image.shape, np.uint8)
    values = np.nan_to_num(image.astype(np.float32), posinf=0.0, neginf=0.0)
    low, high = np.percentile(values, [0.1, 99.9])
    stretched = np.rint(255 * (values - low) / max(float(high - low), 1e-6))
    return np.asarray(np.clip(stretched, 0, 255), np.uint8)


def _dullness(grey: _U8) -> str | None:
    """Return why an image cannot show a board at all, or None."""
    height, width = grey.shape
    if min(height, width) < _SMALLEST_SIDE_PX:
        return f"an image of {width}x{height} px is too small"
    low, high = np.percentile(grey[:: max(1, height // 500), :: max(1, width // 500)], [0.5, 99.5])
    if high - low >= _LEAST_CONTRAST:
        return None
    if high < _DARK:
        return "too dark: nothing in it is brighter than black"
    if low > _BRIGHT:
        return "too bright: nothing in it is darker than white"
    return f"hardly any contrast: {high - low:.0f} of 255 grey levels"


def _with_blur(grey: _U8, reason: str) -> str:
    """Add to a reason that the image is blurred, where nothing in it is sharp."""
    small = cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    steepest = float(np.percentile(_slope(np.asarray(small, np.uint8)), 99.9))
    low, high = np.percentile(small, [0.5, 99.5])
    rise_px = 2 * (high - low) / max(steepest, 1e-6)
    blurred = rise_px > max(20.0, 0.01 * max(grey.shape))
    return f"too blurred: edges rise over {rise_px:.0f} px; {reason}" if blurred else reason


def _slope(grey: _U8) -> NDArray[np.float32]:
    """Return the absolute slopes (2, H, W) along u and v, grey levels a pixel."""
    along = [cv2.Sobel(grey, cv2.CV_32F, du, 1 - du, scale=1 / 8) for du in (1, 0)]
    return np.abs(np.stack(along)).astype(np.float32)


def _corner_gap_px(corners_px: NDArray[np.float64]) -> float:
    """Return the median distance from a corner to the nearest other one."""
    apart = np.linalg.norm(corners_px[:, None] - corners_px, axis=2)
    np.fill_diagonal(apart, np.inf)
    return float(np.median(apart.min(axis=1)))


def _edge_rise_px(grey: _U8, corners_px: NDArray[np.float64]) -> float:
    """Return over how many pixels the edges at the corners rise: contrast over steepest slope.

    The median over some of the corners; a sharp image has about 2 px. Edges of both directions
    meet at a corner: the flatter slope counts, since a hand that shakes smears only one of them.
    """
    half = int(np.clip(_corner_gap_px(corners_px) / 2, 3, 40))
    rises = []
    some = corners_px[:: -(-len(corners_px) // _RISES)]
    for u, v in np.rint(some).astype(int):
        patch = grey[max(v - half, 0) : v + half + 1, max(u - half, 0) : u + half + 1]
        if min(patch.shape) > half:
            low, high = np.percentile(patch, [5, 95])
            rises.append((high - low) / max(float(_slope(patch).max(axis=(1, 2)).min()), 1e-6))
    return float(np.median(rises)) if rises else float("nan")
