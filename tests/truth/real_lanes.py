"""Figures of lanes in real images: what the benchmark prints and a test holds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.calib.boards.definitions import Checkerboard
from percept.calib.boards.detection import BoardView, detect_board
from percept.calib.intrinsics.calibrate import CameraCalibrationConfig, calibrate_camera
from percept.core.lane_markings import LaneDetections
from percept.core.rig import CameraSensor

__all__ = [
    "CARND_CAMERA",
    "SURE",
    "both_found",
    "carnd_camera",
    "ego_lines_of_mask",
    "lane_pixels",
    "rows_within",
    "video_frames",
]

SURE = 0.1  # a line of this confidence was placed beside another one, not seen

# What `carnd_camera` makes of the images of `carnd_camera_cal`, in numbers: it takes half a minute.
CARND_CAMERA = CameraSensor(
    name="camera",
    topic=None,
    frame="camera",
    image_size=(1280, 720),
    model="pinhole",
    K=(1161.1533, 1156.4988, 674.2873, 388.3727),
    distortion=(-0.28009, 0.165994, -0.000562, 0.000376, -0.304543),
    T_base_sensor=None,
)

Pixels = Sequence[NDArray[np.float64] | None]


def lane_pixels(found: LaneDetections) -> Pixels:
    """Return the pixels of the left and the right line, None where one was not seen."""
    sides = [found.line(side) for side in ("left", "right")]
    return [
        line.points_px if line is not None and line.confidence > SURE else None for line in sides
    ]


def both_found(found: LaneDetections) -> bool:
    """Return whether both lines were seen."""
    return all(line is not None for line in lane_pixels(found))


def ego_lines_of_mask(mask: NDArray[np.uint8]) -> list[NDArray[np.float64]]:
    """Return rows and columns (K, 2) of u, v of the two lines beside the middle of the image.

    Rows are TuSimple's: every tenth one from 160 of 720.
    """
    height, width = mask.shape
    rows = np.arange(round(160 / 720 * height), height, 10)
    lines = []
    for value in np.unique(mask[mask > 0]):
        shown = [(float(np.flatnonzero(mask[v] == value).mean()), float(v)) for v in rows
                 if (mask[v] == value).any()]  # fmt: skip
        if len(shown) > 2:
            lines.append(np.array(shown))
    low = [np.polyval(np.polyfit(line[:, 1], line[:, 0], 1), height - 1) for line in lines]
    left = max((k for k, u in enumerate(low) if u < width / 2), key=lambda k: low[k])
    right = min((k for k, u in enumerate(low) if u >= width / 2), key=lambda k: low[k])
    return [lines[left], lines[right]]


def rows_within(
    found: Pixels, truth: Sequence[NDArray[np.float64]], limit_px: float, *, across: bool = False
) -> float:
    """Return the share of the rows of both lines at which the found one is as near as the limit.

    With `across` the limit holds across the line, as in TuSimple's own evaluation: along a row it
    is the limit over the cosine of the line's angle from the vertical.
    """
    near = []
    for line, true in zip(found, truth, strict=True):
        if line is None:
            near.append(np.zeros(len(true), dtype=bool))
            continue
        order = np.argsort(line[:, 1])
        u = np.interp(true[:, 1], line[order, 1], line[order, 0], left=np.nan, right=np.nan)
        with np.errstate(invalid="ignore"):
            near.append(np.abs(u - true[:, 0]) < limit_px * (_stretch(true) if across else 1.0))
    return float(np.concatenate(near).mean())


def _stretch(line: NDArray[np.float64]) -> float:
    slope = np.polyfit(line[:, 1], line[:, 0], 1)[0]
    return float(np.hypot(1.0, slope))


def carnd_camera(data: Path) -> CameraSensor:
    """Return the camera of the images of `carnd_advanced`, calibrated with its own board.

    Raises:
        AssertionError: If the calibration fails.
    """
    board = Checkerboard(9, 6, 0.025)
    files = sorted((data / "intrinsics" / "carnd_camera_cal").glob("*.jpg"))
    found = (
        detect_board(np.asarray(cv2.imread(str(file))), board, name=file.name) for file in files
    )
    views = [view for view in found if isinstance(view, BoardView)]
    camera = calibrate_camera(views, board, CameraCalibrationConfig(model="pinhole")).camera
    assert camera is not None
    (fx, _, cx), (_, fy, cy), _ = camera.K.tolist()
    return CameraSensor(
        name="camera",
        topic=None,
        frame="camera",
        image_size=camera.image_size,
        model=camera.model,
        K=(fx, fy, cx, cy),
        distortion=tuple(camera.distortion.tolist()),
        T_base_sensor=None,
    )


def video_frames(path: Path) -> list[NDArray[np.uint8]]:
    """Return the frames of a clip."""
    reader = cv2.VideoCapture(str(path))
    frames: list[NDArray[np.uint8]] = []
    while True:
        more, frame = reader.read()
        if not more:
            return frames
        frames.append(np.asarray(frame, dtype=np.uint8))
