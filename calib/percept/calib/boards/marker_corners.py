"""Finding the corners of ChArUco boards and AprilGrids; a part of the board is enough."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.calib.boards.checkerboard_corners import refine_corners
from percept.calib.boards.definitions import AprilGrid, CharucoBoard
from percept.core.errors import UsageError

__all__ = ["find_aprilgrid", "find_charuco"]

_F64 = NDArray[np.float64]
_U8 = NDArray[np.uint8]
_Found = tuple[NDArray[np.int64], _F64]

_NO_MARKER = "no marker could be read; is the board in view, the image sharp and not mirrored?"
_FEWEST_CORNERS = 6
_KALIBR_BORDER_BITS = 2
_FARTHEST_OFF = 0.25  # of a tag's side, from where the other tags put it; a lens bends less
_WRONG_TURN = 0.5  # tags turned by 90 deg lie a whole side off


def find_charuco(grey: _U8, board: CharucoBoard) -> _Found | str:
    """Find the inner corners of a ChArUco board next to the markers that can be read.

    Args:
        grey: (H, W) uint8.
        board: Corners are identified by the markers, so that none is mistaken for another.

    Returns:
        Ids (N,) into `corners_board()` and corners (N, 2) in pixels, or why there are none.

    Raises:
        UsageError: If there is no dictionary of that name, or it has too few markers.
    """
    dictionary = _dictionary(board.dictionary)
    if len(dictionary.bytesList) < board.columns * board.rows // 2:
        raise UsageError(
            f"{board.dictionary} has too few markers for {board.columns}x{board.rows} squares"
        )
    read = 0
    for legacy in (False, True):
        pattern = cv2.aruco.CharucoBoard(
            (board.columns, board.rows), board.square_m, board.marker_m, dictionary
        )
        # Before OpenCV 4.6 a pattern of even rows began with a white square.
        pattern.setLegacyPattern(legacy)
        detector = cv2.aruco.CharucoDetector(pattern)
        found: tuple[Any, ...] = detector.detectBoard(grey)  # ids are None where there are none
        corners, ids, quads, _ = found
        read = len(quads)
        if read == 0:
            return _NO_MARKER
        if ids is not None and len(ids) >= _FEWEST_CORNERS:
            return _charuco_corners(grey, corners, ids, board)
    return f"{read} markers, but fewer than {_FEWEST_CORNERS} corners between them"


def _charuco_corners(
    grey: _U8, corners: NDArray[Any], ids: NDArray[Any], board: CharucoBoard
) -> _Found | str:
    index = ids.reshape(-1).astype(np.int64)
    start = corners.reshape(-1, 2).astype(np.float64)
    places = board.corners_board()[index]
    sides_px = _spacing_px(start, places, board.square_m)
    # Half the white rim between a square's corner and its marker bounds the window.
    room = (board.square_m - board.marker_m) / board.square_m
    refined, sound, _ = refine_corners(grey, start, places, sides_px * max(room, 0.2))
    return _enough(index[sound], refined[sound], board.corners_board())


def find_aprilgrid(grey: _U8, board: AprilGrid) -> _Found | str:
    """Find the corners of the tags of a Kalibr AprilGrid that can be read.

    Args:
        grey: (H, W) uint8.
        board: Its tags carry the ids 0 to columns * rows - 1.

    Returns:
        Ids (N,) into `corners_board()` and corners (N, 2) in pixels, or why there are none.
    """
    dictionary = _dictionary("APRILTAG_36h11")
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = _KALIBR_BORDER_BITS
    # Kalibr's black squares touch the tags' corners; only a narrow search tells them apart.
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    found: tuple[Any, ...] = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(grey)
    quads, ids, _ = found
    if ids is None or len(ids) == 0:
        return _NO_MARKER
    tags = ids.reshape(-1).astype(np.int64)
    corners = np.array(quads, dtype=np.float64).reshape(-1, 4, 2)
    once = np.isin(tags, [t for t in tags if np.count_nonzero(tags == t) == 1])
    once &= tags < board.columns * board.rows
    if np.count_nonzero(once) < 2:
        return f"only {np.count_nonzero(once)} tag of the board could be read"
    return _settled_tags(grey, tags[once], corners[once], board)


def _settled_tags(
    grey: _U8, tags: NDArray[np.int64], corners: _F64, board: AprilGrid
) -> _Found | str:
    """Turn the tags as the grid wants them, refine their corners and drop what does not fit."""
    places = board.corners_board().reshape(-1, 4, 3)[tags, :, :2] / board.tag_m
    offs = [_misfits(places, np.roll(corners[:, ::-1], turn, axis=1)) for turn in range(4)]
    best = int(np.argmin([np.median(off) for off in offs]))
    if np.median(offs[best]) > _FARTHEST_OFF:
        return (
            "the tags do not lie as on a Kalibr grid: ids run from the bottom left to the right,"
            " then up; are columns and rows right?"
        )
    fits = offs[best] <= _WRONG_TURN
    turned = np.roll(corners[:, ::-1], best, axis=1)[fits]
    sides = np.linalg.norm(turned - np.roll(turned, 1, axis=1), axis=2).min()
    gap_px = sides * min(board.spacing, _KALIBR_BORDER_BITS / 10)
    index = (4 * tags[fits][:, None] + np.arange(4)).reshape(-1)
    on_board = board.corners_board()[index]
    refined, sound, _ = refine_corners(grey, turned.reshape(-1, 2), on_board, 2 * gap_px)
    return _enough(index[sound], refined[sound], board.corners_board())


def _misfits(places: _F64, corners: _F64) -> _F64:
    """Return how far each tag (T,) lies, in tag sides, from where a common homography puts it."""
    target, source = places.reshape(-1, 2), corners.reshape(-1, 2)
    fitted: tuple[Any, ...] = cv2.findHomography(source, target, cv2.LMEDS)
    H, _ = fitted
    if H is None:
        return np.full(len(places), np.inf)
    put = cv2.perspectiveTransform(source[None], H)[0]
    off: _F64 = np.linalg.norm((put - target).reshape(places.shape), axis=2).max(axis=1)
    return off


def _enough(index: NDArray[np.int64], corners: _F64, places: _F64) -> _Found | str:
    if len(index) < _FEWEST_CORNERS:
        return f"only {len(index)} corners of the board could be placed"
    spread = np.linalg.svd(places[index, :2] - places[index, :2].mean(axis=0), compute_uv=False)
    if spread[1] < 1e-3 * spread[0]:
        return "the corners that could be placed lie on one line"
    order = np.argsort(index)
    return index[order], corners[order]


def _spacing_px(corners: _F64, places: _F64, square_m: float) -> float:
    """Return the smallest distance in the image between corners one square apart."""
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    near = np.argwhere((apart > 0) & (apart < 1.1 * square_m))
    if len(near) == 0:
        return 0.0
    return float(np.linalg.norm(corners[near[:, 0]] - corners[near[:, 1]], axis=1).min())


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    # Some OpenCV versions spell the bits of AprilTag families in capitals.
    names = {key.upper(): key for key in dir(cv2.aruco) if key.startswith("DICT_")}
    key = names.get(f"DICT_{name}".upper())
    if key is None:
        known = ", ".join(sorted(found.removeprefix("DICT_") for found in names))
        raise UsageError(f"no marker dictionary '{name}'", remedy=f"Choose from {known}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, key))
