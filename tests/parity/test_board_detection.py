"""Board detection on real images, beside what OpenCV's own functions find in them."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.boards.definitions import Checkerboard
from percept.calib.boards.detection import BoardView, NoBoard, detect_boards
from percept.calib.boards.selection import select_views


def _detect(
    folder: Path, pattern: str, board: Checkerboard
) -> tuple[list[BoardView], list[NoBoard]]:
    files = sorted(folder.glob(pattern))
    assert files
    return detect_boards(((file.name, partial(_read, file)) for file in files), board)


def _read(file: Path) -> NDArray[Any]:
    image = cv2.imread(str(file))
    assert image is not None
    return image


@pytest.mark.parametrize(
    ("folder", "pattern", "board", "count", "outliers"),
    [
        ("intrinsics/opencv_samples", "left*.jpg", Checkerboard(9, 6, 0.025), 12, ["left02.jpg"]),
        ("intrinsics/opencalib_board15x17", "*.jpg", Checkerboard(15, 17, 0.05), 15, []),
        ("intrinsics/kalibr_test", "*.jpg", Checkerboard(8, 9, 0.07), 1, []),
        ("camera_lidar/acfr_vlp/images", "*.jpg", Checkerboard(7, 5, 0.095), 30, []),
    ],
)
def test_every_board_is_found(
    shared_data: Path,
    folder: str,
    pattern: str,
    board: Checkerboard,
    count: int,
    outliers: list[str],
) -> None:
    views, without = _detect(shared_data / folder, pattern, board)
    assert without == []
    kept, rejected = select_views(views)
    assert [none.name for none in rejected] == outliers
    assert all(none.reason.startswith("outlier") for none in rejected)
    assert len(kept) == count


def test_boards_out_of_view_and_wrong_sizes_are_named(shared_data: Path) -> None:
    folder = shared_data / "intrinsics/carnd_camera_cal"
    views, without = _detect(folder, "*.jpg", Checkerboard(9, 6, 0.03))
    assert {n.name for n in without} == {"calibration1.jpg", "calibration5.jpg"}
    assert all("part of the board" in n.reason for n in without)
    kept, rejected = select_views(views)
    assert {n.name for n in rejected} == {"calibration7.jpg", "calibration15.jpg"}
    assert all("1281x721" in n.reason for n in rejected)
    assert len(kept) == 16


def test_corners_serve_a_calibration_no_worse_than_opencvs(shared_data: Path) -> None:
    board = Checkerboard(9, 6, 0.025)
    folder = shared_data / "intrinsics/opencv_samples"
    views, _ = _detect(folder, "left*.jpg", board)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 1e-3)
    theirs = []
    for view in views:
        grey = cv2.cvtColor(_read(folder / view.name), cv2.COLOR_BGR2GRAY)
        corners = cv2.findChessboardCorners(grey, (9, 6))[1]
        theirs.append(cv2.cornerSubPix(grey, corners, (11, 11), (-1, -1), stop).reshape(-1, 2))
    places = [board.corners_board().astype(np.float32)] * len(views)
    ours = [view.corners_px.astype(np.float32) for view in views]
    rms = [
        cv2.calibrateCamera(places, corners, (640, 480), None, None)[0]
        for corners in (ours, theirs)
    ]
    assert rms[0] < 0.7 * rms[1]  # wide windows reach over left02's narrow margin
