"""Views of a board by a camera that is known: corners by projection, and drawn images."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from hostile.case import Miss, Outcome
from numpy.typing import NDArray

from percept.calib import calibrate_camera
from percept.calib.boards.definitions import Checkerboard
from percept.calib.boards.detection import detect_boards
from percept.calib.boards.selection import select_views
from percept.calib.boards.views import BoardView
from percept.calib.intrinsics.calibrate import CameraCalibrationConfig
from percept.calib.intrinsics.projection_uncertainty import pixel_grid, projection_difference
from percept.calib.intrinsics.result import CameraCalibration
from percept.core.cameras import Camera, make_camera

__all__ = ["BOARD", "CAMERA", "SIZE", "calibrated", "drawn", "from_images", "lens", "views"]

_F64 = NDArray[np.float64]
_U8 = NDArray[np.uint8]

SIZE = (1280, 800)
BOARD = Checkerboard(8, 5, 0.06)


def lens(focal: float = 900.0, model: str = "pinhole", right_px: float = 0.0) -> Camera:
    """Return a camera with the distortion of an ordinary lens, or a fisheye."""
    K = np.array([[focal, 0, 652 + right_px], [0, 1.003 * focal, 388], [0, 0, 1]])
    distortion = [-0.28, 0.09, 0.0008, -0.0006, -0.01]
    return make_camera(model, SIZE, K, distortion if model == "pinhole" else [-0.03, 0.01, 0, 0])


CAMERA = lens()
_PLAIN = make_camera("pinhole", SIZE, CAMERA.K, np.zeros(5))


def _poses(
    camera: Camera,
    rng: np.random.Generator,
    *,
    tilt_deg: tuple[float, float] = (0.0, 45.0),
    width: tuple[float, float] = (0.3, 0.8),
    rows: tuple[float, float] = (0.0, 1.0),
    roll_rad: float = 0.2,
) -> tuple[_F64, _F64]:
    """Return rotation and translation of a board about its middle, somewhere in the image."""
    share = rng.uniform(*width)
    distance = BOARD.columns * BOARD.square_m * camera.K[0, 0] / (share * SIZE[0])
    tilt, way = np.radians(rng.uniform(*tilt_deg)), rng.uniform(0, 2 * np.pi)
    R = cv2.Rodrigues(np.array([np.cos(way) * tilt, np.sin(way) * tilt, 0]))[0]
    R = R @ cv2.Rodrigues(np.array([0, 0, rng.normal() * roll_rad]))[0]
    low, high = (part * SIZE[1] for part in rows)
    ray = camera.unproject(rng.uniform([0, low], [SIZE[0], high], (1, 2)))[0]
    return np.asarray(R, np.float64), distance * ray


def _corners(board: Checkerboard = BOARD) -> _F64:
    corners: _F64 = board.corners_board()
    corners -= corners.mean(axis=0)
    return corners


def views(
    camera: Camera = CAMERA,
    seed: int = 0,
    *,
    count: int = 16,
    noise_px: float = 0.1,
    tilt_deg: tuple[float, float] = (0.0, 45.0),
    width: tuple[float, float] = (0.3, 0.8),
    rows: tuple[float, float] = (0.0, 1.0),
    roll_rad: float = 0.2,
    stretch: tuple[float, float] = (1.0, 1.0),
    bend_m: float = 0.0,
) -> list[BoardView]:
    """Return views of boards all over a part of the image.

    Args:
        camera: The camera.
        seed: Of poses and noise.
        count: How many.
        noise_px: Of a corner along one axis.
        tilt_deg: Between board and image.
        width: Of the board, over the image's width.
        rows: Part of the image, from top to bottom.
        roll_rad: Spread of the turn within the image.
        stretch: Size of the printed board over the given one, along columns and rows.
        bend_m: How far the board's middle stands out of its edges.
    """
    rng = np.random.default_rng(seed)
    corners = _corners() * [*stretch, 1.0]
    corners[:, 2] += bend_m * (1 - (corners[:, 0] / corners[:, 0].max()) ** 2)
    low, high = (part * SIZE[1] for part in rows)
    found: list[BoardView] = []
    while len(found) < count:
        R, t = _poses(camera, rng, tilt_deg=tilt_deg, width=width, rows=rows, roll_rad=roll_rad)
        if not np.isfinite(t).all():
            continue
        pixels, seen = camera.project(corners @ R.T + t)
        if seen.all() and low <= pixels[:, 1].min() and pixels[:, 1].max() <= high:
            pixels = pixels + rng.normal(size=pixels.shape) * noise_px
            found.append(BoardView(f"v{len(found):02d}", SIZE, np.arange(len(pixels)), pixels))
    return found


def drawn(seed: int = 0, *, count: int = 14, sink: float = 0.0) -> list[_U8]:
    """Return images of the board by a camera without distortion.

    Args:
        seed: Of poses and noise.
        count: How many.
        sink: By how many image heights the board is moved out of the image.
    """
    rng = np.random.default_rng(seed)
    scale, margin = 40, 1
    squares = (BOARD.rows + 1 + 2 * margin, BOARD.columns + 1 + 2 * margin)
    row, column = np.indices(squares)
    black = (row + column) % 2 == 0
    black[[0, -1]] = False
    black[:, [0, -1]] = False
    pattern = np.where(black, 20, 230).astype(np.uint8).repeat(scale, 0).repeat(scale, 1)
    # From the pattern's pixels to metres about its middle.
    metre = BOARD.square_m / scale
    middle = (np.array(pattern.shape[::-1]) - 1) / 2
    M = np.array([[metre, 0, -metre * middle[0]], [0, metre, -metre * middle[1]], [0, 0, 1.0]])
    images: list[_U8] = []
    while len(images) < count:
        R, t = _poses(_PLAIN, rng, tilt_deg=(5, 40), width=(0.3, 0.6))
        _, seen = _PLAIN.project(_corners() * 1.4 @ R.T + t)
        if not seen.all():
            continue
        H = _PLAIN.K @ np.column_stack([R[:, :2], t]) @ M
        H = np.array([[1, 0, 0], [0, 1, sink * SIZE[1]], [0, 0, 1]]) @ H
        image = cv2.warpPerspective(pattern, H, SIZE, flags=cv2.INTER_AREA, borderValue=120)
        image = cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(0, 2, SIZE[::-1])
        images.append(np.asarray(np.clip(image, 0, 255), np.uint8))
    return images


def from_images(
    images: Sequence[_U8], board: Checkerboard = BOARD, truth: Camera | None = _PLAIN
) -> Outcome:
    """Detect, select and calibrate, as the command does."""
    found, without = detect_boards(
        [(f"image{k:02d}", lambda image=image: image) for k, image in enumerate(images)],  # type: ignore[misc]
        board,
    )
    kept, rejected = select_views(found)
    result = calibrate_camera(kept, board, rejected=[*without, *rejected])
    return _outcome(result, truth)


def calibrated(
    given: Sequence[BoardView],
    truth: Camera | None = CAMERA,
    board: Checkerboard = BOARD,
    config: CameraCalibrationConfig | None = None,
) -> Outcome:
    """Select views, calibrate, and compare with the truth; None where the data have none."""
    kept, rejected = select_views(given)
    return _outcome(calibrate_camera(kept, board, config, rejected=rejected), truth)


def _outcome(result: CameraCalibration, truth: Camera | None) -> Outcome:
    why = result.why[0] if result.why else ""
    if result.fit is None:
        return Outcome(str(result.verdict), why)
    if truth is None:
        nothing = Miss("what has no answer", np.inf, 0.0, 0.0, np.inf)
        return Outcome(str(result.verdict), why, (nothing,))
    found, sd = result.fit.camera.K, result.fit.sd
    misses = []
    for name, at, good, doubtful in (
        ("fx", (0, 0), 0.005, 0.02),
        ("fy", (1, 1), 0.005, 0.02),
        ("cx", (0, 2), 0.004, 0.02),
        ("cy", (1, 2), 0.004, 0.02),
    ):
        error, focal = abs(found[at] - truth.K[at]), truth.K[0, 0]
        misses.append(Miss(f"{name} (px)", error, sd[name], good * focal, doubtful * focal))
    pixels = pixel_grid(SIZE)
    apart = projection_difference(result.fit.camera, truth, pixels, np.ones(len(pixels)))
    spread = result.fit.validation.uncertainty_px
    misses.append(
        Miss(
            "projection, median (px)",
            float(np.nanmedian(apart)),
            float(np.nanmedian(spread)),
            0.001 * SIZE[0],
            0.01 * SIZE[0],
        )
    )
    return Outcome(str(result.verdict), why, tuple(misses))
