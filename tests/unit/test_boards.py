"""Board definitions: their texts, files and corners."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from percept.calib.boards.definitions import (
    AprilGrid,
    Board,
    CharucoBoard,
    Checkerboard,
    load_board,
)
from percept.core.errors import ConfigError, UsageError


@pytest.mark.parametrize(
    ("text", "board"),
    [
        ("checkerboard:9x6:0.025", Checkerboard(9, 6, 0.025)),
        ("charuco:5x7:0.04:0.03", CharucoBoard(5, 7, 0.04, 0.03)),
        ("charuco:5x7:0.04:0.03:DICT_4X4_50", CharucoBoard(5, 7, 0.04, 0.03, "4X4_50")),
        ("aprilgrid:6x6:0.088:0.3", AprilGrid(6, 6, 0.088, 0.3)),
    ],
)
def test_texts(text: str, board: Board) -> None:
    assert load_board(text).board == board
    assert load_board(text).plate_size_m is None


@pytest.mark.parametrize(
    "text",
    [
        "", "9x6", "checkerboard:9x6", "checkerboard:9x6:0", "checkerboard:9x6:-1",
        "checkerboard:9x6:nan", "checkerboard:9x6:inf", "checkerboard:9x6:25",
        "checkerboard:9:0.1", "checkerboard:2x2:0.1", "checkerboard:-9x-6:0.1",
        "checkerboard:9999x9999:0.0001", "checkerboard:9x6:0.1:0.2", "charuco:5x7:0.03:0.04",
        "charuco:5x7:0.03", "aprilgrid:1x1:0.1:0.3", "aprilgrid:6x6:0.1:3", "circles:4x5:0.1",
    ],
)  # fmt: skip
def test_nonsense_is_refused_with_the_forms(text: str) -> None:
    with pytest.raises(UsageError, match="checkerboard:COLUMNSxROWS:SQUARE"):
        load_board(text)


def test_board_file(tmp_path: Path) -> None:
    path = tmp_path / "board.yaml"
    path.write_text("board: checkerboard:7x5:0.095\nboard_size: 0.85x0.61\n")
    found = load_board(path)
    assert found.board == Checkerboard(7, 5, 0.095)
    assert found.plate_size_m == (0.85, 0.61)
    assert load_board(str(path)) == found


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("board: checkerboard:5x7:0.095\nboard_size: 0.85x0.61\n", "Swap columns and rows"),
        ("board: checkerboard:9x9:0.095\nboard_size: 0.85x0.61\n", "does not fit"),
        ("board: checkerboard:7x5:0.095\nboard_size: big\n", "WIDTHxHEIGHT"),
        ("bord: checkerboard:7x5:0.095\n", "board"),
        ("target_type: circlegrid\n", "not supported"),
        ("target_type: aprilgrid\ntagCols: 6\n", "tagRows"),
        ("target_type: checkerboard\ntargetCols: 6\ntargetRows: 7\n"
         "rowSpacingMeters: 0.06\ncolSpacingMeters: 0.07\n", "0.07 x 0.06 m"),
        ("[1, 2", "YAML"),
    ],
)  # fmt: skip
def test_wrong_board_files(tmp_path: Path, content: str, says: str) -> None:
    path = tmp_path / "board.yaml"
    path.write_text(content)
    with pytest.raises(UsageError, match=says):
        load_board(path)


def test_missing_board_file() -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load_board("nowhere.yaml")


def test_kalibr_targets(tmp_path: Path) -> None:
    path = tmp_path / "april_6x6.yaml"
    path.write_text(
        "target_type: 'aprilgrid' #gridtype\ntagCols: 6\ntagRows: 6\ntagSize: 0.088\n"
        "tagSpacing: 0.3\n"
    )
    assert load_board(path).board == AprilGrid(6, 6, 0.088, 0.3)
    path.write_text(
        "target_type: 'checkerboard'\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: 0.06\n"
        "colSpacingMeters: 0.06\n"
    )
    assert load_board(path).board == Checkerboard(6, 7, 0.06)


def test_charuco_corners_are_opencvs() -> None:
    board = CharucoBoard(5, 7, 0.04, 0.03)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    theirs = cv2.aruco.CharucoBoard((5, 7), 0.04, 0.03, dictionary).getChessboardCorners()
    np.testing.assert_allclose(
        board.corners_board(), np.array(theirs) - np.array(theirs)[0], atol=1e-7
    )


def test_aprilgrid_corners_follow_kalibr() -> None:
    corners = AprilGrid(3, 2, 0.1, 0.5).corners_board()
    assert corners.shape == (24, 3)
    # Tag 0 from the bottom left, counter-clockwise; y points down.
    np.testing.assert_allclose(
        corners[:4, :2], np.array([[0, 0], [0.1, 0], [0.1, -0.1], [0, -0.1]]), atol=1e-12
    )
    np.testing.assert_allclose(corners[4, :2], [0.15, 0.0], atol=1e-12)  # tag 1 is right of it
    np.testing.assert_allclose(corners[12, :2], [0.0, -0.15], atol=1e-12)  # tag 3 above it


@pytest.mark.parametrize(
    "text", ["checkerboard:9x6:0.025", "charuco:5x7:0.04:0.03", "aprilgrid:6x4:0.088:0.3"]
)
def test_the_corners_lie_centred_in_the_pattern(text: str) -> None:
    board = load_board(text).board
    corners = board.corners_board()[:, :2]
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    np.testing.assert_allclose(corners.mean(axis=0), middle)
    assert (np.ptp(corners, axis=0) <= np.array(board.pattern_size_m) + 1e-12).all()
    assert text.split(":")[1] in board.describe()


def test_symmetric_boards_say_so() -> None:
    assert not Checkerboard(9, 6, 0.1).symmetric
    assert Checkerboard(7, 5, 0.1).symmetric
    assert Checkerboard(8, 6, 0.1).symmetric
