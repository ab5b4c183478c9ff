"""Boards in drawn and rendered images, and in images that hold none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.boards import checkerboard_corners as board_detection_checkerboard
from percept.calib.boards.definitions import AprilGrid, Board, CharucoBoard, Checkerboard
from percept.calib.boards.detection import BoardView, NoBoard, detect_board, detect_boards
from percept.calib.boards.selection import select_views
from percept.core.cameras import PinholeCamera
from percept.core.errors import InputError
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.synthetic.board_mesh import board_mesh
from percept.datasets.synthetic.render import RenderConfig, render_image

_U8 = NDArray[np.uint8]
_BOARD = Checkerboard(9, 6, 0.08)
_CAMERA = PinholeCamera(
    (960, 640),
    np.array([[700.0, 0, 478.3], [0, 702.0, 321.9], [0, 0, 1]]),
    np.array([-0.28, 0.08, 0.0012, -0.0007, -0.01]),
)
_FORWARD = Transform.from_quat_xyzw("cam", "map", (0, 0, 0), (0.5, -0.5, 0.5, 0.5))
_LIGHT = RenderConfig(noise_sd=0, sun=0.0, ambient=1.0, gamma=1.0)


def _pose(rpy_deg: tuple[float, float, float], centre_m: tuple[float, float, float]) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(*np.deg2rad(rpy_deg))
    matrix[:3, 3] = centre_m - matrix[:3, :3] @ _BOARD.corners_board().mean(axis=0)
    return Transform("cam", "board", matrix)


def _render(T_cam_board: Transform, board: Checkerboard = _BOARD) -> tuple[_U8, NDArray[Any]]:
    size = (board.pattern_size_m[0] + 0.1, board.pattern_size_m[1] + 0.1)
    mesh = board_mesh(board, size, _FORWARD.inverse() @ T_cam_board)
    image = render_image(mesh, _CAMERA, _FORWARD, _LIGHT)
    # A lens blurs a little, and corner finders count on it.
    blurred = np.asarray(cv2.GaussianBlur(image, (0, 0), 0.8), np.uint8)
    return blurred, _CAMERA.project(T_cam_board.apply(board.corners_board()))[0]


def _drawn(board: Checkerboard = _BOARD, side: int = 40, margin: int = 60) -> _U8:
    row, column = np.indices((board.rows + 1, board.columns + 1))
    cells = np.where((row + column) % 2 == 0, 20, 230).astype(np.uint8)
    image = np.pad(cells.repeat(side, 0).repeat(side, 1), margin, constant_values=230)
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.7), np.uint8)


def _found(image: NDArray[Any], board: Board = _BOARD) -> BoardView:
    result = detect_board(image, board)
    assert isinstance(result, BoardView), result
    return result


def _reason(image: NDArray[Any], board: Board = _BOARD) -> str:
    result = detect_board(image, board, name="it")
    assert isinstance(result, NoBoard)
    assert result.name == "it"
    return result.reason


@pytest.mark.parametrize(
    ("rpy_deg", "centre_m"),
    [
        ((0, 0, 0), (0.02, 0.01, 1.3)),
        ((30, -25, 10), (-0.1, 0.0, 1.4)),
        ((-20, 40, -170), (0.1, 0.05, 1.5)),
        ((10, 10, 95), (0.0, 0.02, 1.6)),
    ],
)
def test_rendered_corners_are_found_to_a_twentieth_of_a_pixel(
    rpy_deg: tuple[float, float, float], centre_m: tuple[float, float, float]
) -> None:
    image, truth_px = _render(_pose(rpy_deg, centre_m))
    view = _found(image)
    assert view.image_size == (960, 640)
    np.testing.assert_array_equal(view.ids, np.arange(54))
    errors = view.corners_px - truth_px
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 0.05
    assert np.abs(errors.mean(axis=0)).max() < 0.02


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_the_order_turns_with_an_unsymmetric_board(turns: int) -> None:
    upright = _drawn()
    height, width = upright.shape
    image = np.ascontiguousarray(np.rot90(upright, turns))
    u, v = _found(upright).corners_px.T
    expected = [(u, v), (v, width - 1 - u), (width - 1 - u, height - 1 - v), (height - 1 - v, u)]
    np.testing.assert_allclose(
        _found(image).corners_px, np.column_stack(expected[turns]), atol=0.02
    )


def test_columns_and_rows_swapped_give_the_same_board_turned() -> None:
    swapped = Checkerboard(6, 9, 0.08)
    corners = _found(_drawn(), swapped).corners_px.reshape(9, 6, 2)
    along, down = corners[0, -1] - corners[0, 0], corners[-1, 0] - corners[0, 0]
    assert along[0] * down[1] - along[1] * down[0] > 0  # seen from the front, not mirrored


@pytest.mark.parametrize("turns", [0, 2])
def test_a_symmetric_board_runs_to_the_right(turns: int) -> None:
    board = Checkerboard(7, 5, 0.08)
    corners = _found(np.ascontiguousarray(np.rot90(_drawn(board), turns)), board).corners_px
    assert corners[6, 0] > corners[0, 0]


def test_no_board() -> None:
    rng = np.random.default_rng(0)
    shape = (600, 800)
    assert "too dark" in _reason(np.zeros(shape, np.uint8))
    assert "too bright" in _reason(np.full(shape, 255, np.uint8))
    assert "hardly any contrast" in _reason(np.full(shape, 128, np.uint8))
    assert "too small" in _reason(np.zeros((1, 1), np.uint8))
    assert "too small" in _reason(np.zeros((0, 0), np.uint8))
    assert "no whole board" in _reason(rng.integers(0, 256, shape).astype(np.uint8))
    blobs = cv2.resize(rng.integers(0, 2, (30, 40)).astype(np.uint8) * 255, (800, 600))
    assert isinstance(detect_board(blobs, _BOARD), NoBoard)


def test_parts_and_other_sizes_are_named() -> None:
    image = _drawn()
    assert "only part of the board seen" in _reason(image[:, :400])
    assert "has 9x6 inner corners, not 10x7" in _reason(image, Checkerboard(10, 7, 0.08)) or (
        "of 70 corners (9x6)" in _reason(image, Checkerboard(10, 7, 0.08))
    )
    reason = _reason(image, Checkerboard(8, 5, 0.08))
    assert "has 9x6 inner corners" in reason or "goes on beyond" in reason


def test_no_slow_search_where_another_board_is_in_view(monkeypatch: pytest.MonkeyPatch) -> None:
    def slow(*_: object) -> None:
        raise AssertionError("this search takes seconds where the board is not")

    monkeypatch.setattr(board_detection_checkerboard, "_classic", slow)
    for columns, rows in ((10, 7), (8, 5), (7, 4)):
        assert isinstance(detect_board(_drawn(), Checkerboard(columns, rows, 0.08)), NoBoard)
    assert isinstance(detect_board(_drawn()[200:], _BOARD), NoBoard)


def test_smeared_boards_raise_no_warning() -> None:
    board = Checkerboard(10, 7, 0.06)
    smear = np.ones((1, 15), np.float32) / 15
    for side in (16, 24, 40):
        image = _drawn(board, side=side)
        for spoilt in (cv2.filter2D(image, -1, smear), cv2.GaussianBlur(image, (0, 0), 8)):
            assert isinstance(detect_board(np.asarray(spoilt), board), BoardView | NoBoard)


def test_blur_and_low_contrast() -> None:
    image = _drawn()
    heavy = np.asarray(cv2.GaussianBlur(image, (0, 0), 30), np.uint8)
    assert isinstance(detect_board(heavy, _BOARD), NoBoard)
    faint = (100 + image / 10).astype(np.uint8)
    np.testing.assert_allclose(_found(faint).corners_px, _found(image).corners_px, atol=0.1)
    mild = np.asarray(cv2.GaussianBlur(image, (0, 0), 3), np.uint8)
    assert _found(mild).blur_px > 2 * _found(image).blur_px


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_other_pixels(dtype: type) -> None:
    image = _drawn()
    wide: NDArray[Any] = (image.astype(np.float64) * 100).astype(dtype)
    colour = np.repeat(image[..., None], 3, axis=2)
    for other in (wide, colour, np.repeat(wide[..., None], 3, axis=2)):
        np.testing.assert_allclose(_found(other).corners_px, _found(image).corners_px, atol=0.05)


def test_large_images_are_searched_on_a_reduced_copy() -> None:
    large = _drawn(side=320, margin=400)
    assert large.size > 8e6
    expected = (400 + 320 * _BOARD.corners_board()[:, :2] / 0.08 + 320) - 0.5
    np.testing.assert_allclose(_found(large).corners_px, expected, atol=0.05)


def _charuco(board: CharucoBoard) -> _U8:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    pattern = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.square_m, board.marker_m, dictionary
    )
    drawn = pattern.generateImage((80 * board.columns + 80, 80 * board.rows + 80), marginSize=40)
    return np.asarray(cv2.GaussianBlur(drawn, (0, 0), 0.7), np.uint8)


def test_charuco_whole_cut_and_mirrored() -> None:
    board = CharucoBoard(6, 8, 0.04, 0.03)
    image = _charuco(board)
    view = _found(image, board)
    np.testing.assert_array_equal(view.ids, np.arange(35))
    np.testing.assert_allclose(
        view.corners_px, 40 + 80 + 2000 * board.corners_board()[:, :2] - 0.5, atol=0.1
    )
    cut = _found(image[: image.shape[0] // 2], board)
    assert 6 <= len(cut.ids) < 35
    np.testing.assert_allclose(cut.corners_px, view.corners_px[cut.ids], atol=0.1)
    assert "mirrored" in _reason(np.ascontiguousarray(image[:, ::-1]), board)


def _aprilgrid(board: AprilGrid, side: int = 100) -> tuple[_U8, NDArray[np.float64]]:
    """Draw Kalibr's grid: tags upside down, black squares at their corners."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    gap = round(side * board.spacing)
    step, margin = side + gap, 3 * gap
    height = 2 * margin + board.rows * step - gap
    image = np.full((height, 2 * margin + board.columns * step - gap), 255, np.uint8)
    for row in range(board.rows + 1):
        for column in range(board.columns + 1):
            v, u = height - margin + gap - (row * step), margin - gap + column * step
            image[v - gap : v, u : u + gap] = 0
    for tag in range(board.columns * board.rows):
        row, column = divmod(tag, board.columns)
        v, u = height - margin - row * step - side, margin + column * step
        drawn = cv2.aruco.generateImageMarker(dictionary, tag, side, borderBits=2)
        image[v : v + side, u : u + side] = drawn[::-1, ::-1]
    truth = board.corners_board()[:, :2] / board.tag_m * side + [margin, height - margin] - 0.5
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.7), np.uint8), truth


def test_aprilgrid_whole_cut_turned_and_mirrored() -> None:
    board = AprilGrid(4, 3, 0.088, 0.3)
    image, truth_px = _aprilgrid(board)
    view = _found(image, board)
    np.testing.assert_array_equal(view.ids, np.arange(48))
    np.testing.assert_allclose(view.corners_px, truth_px, atol=0.1)
    cut = _found(image[:, :350], board)
    assert set(cut.ids // 4) == {0, 1, 4, 5, 8, 9}
    np.testing.assert_allclose(cut.corners_px, truth_px[cut.ids], atol=0.1)
    assert "mirrored" in _reason(np.ascontiguousarray(image[:, ::-1]), board)
    half_turn = _found(np.ascontiguousarray(image[::-1, ::-1]), board)
    expected = np.array(image.shape[::-1]) - 1 - truth_px
    np.testing.assert_allclose(half_turn.corners_px, expected, atol=0.1)


def test_aprilgrid_with_columns_and_rows_swapped_is_refused() -> None:
    image, _ = _aprilgrid(AprilGrid(4, 3, 0.088, 0.3))
    assert "columns and rows" in _reason(image, AprilGrid(3, 4, 0.088, 0.3))


def test_many_images_keep_their_order_and_name_what_cannot_be_read() -> None:
    def unreadable() -> _U8:
        raise InputError("is cut short", where="b.png")

    loaders = [("a", _drawn), ("b", unreadable), ("c", _drawn),
               ("d", lambda: np.zeros((100, 100), np.uint8)), ("e", _drawn)]  # fmt: skip
    done: list[float] = []
    views, without = detect_boards(loaders, _BOARD, done.append)
    assert [v.name for v in views] == ["a", "c", "e"]
    assert [n.name for n in without] == ["b", "d"]
    assert "cut short" in without[0].reason
    assert done == [1, 2, 3, 4, 5]


def _view(
    name: str, shift: float, *, blur: float = 2.0, width: int = 640, jumps: Sequence[float] = ()
) -> BoardView:
    corners = 300 * _BOARD.corners_board()[:, :2] + 100 + shift
    return BoardView(name, (width, 480), np.arange(54), corners, blur, np.array(jumps))


def test_views_are_selected_with_reasons() -> None:
    views = [
        _view("a", 0.0, blur=2.2), _view("b", 40.0), _view("again", 0.4, blur=2.0),
        _view("wide", 80.0, width=641), _view("smeared", 120.0, blur=9.0), _view("c", 160.0),
    ]  # fmt: skip
    kept, rejected = select_views(views)
    assert [v.name for v in kept] == ["b", "again", "c"]
    reasons = {n.name: n.reason for n in rejected}
    assert "641x480" in reasons["wide"]
    assert "640x480" in reasons["wide"]
    assert "blurred" in reasons["smeared"]
    assert "same place as again" in reasons["a"]
    assert select_views([]) == ([], [])


def test_a_view_with_several_wild_corners_is_an_outlier() -> None:
    views = [
        _view("clean", 0.0),
        _view("lone", 40.0, jumps=[6.0]),
        _view("noisy", 80.0, jumps=[0.9] * 9),
        _view("two", 120.0, jumps=[0.7, 2.5, 6.9]),
        _view("other", 160.0),
    ]
    kept, rejected = select_views(views)
    assert [v.name for v in kept] == ["clean", "lone", "noisy", "other"]
    assert [n.name for n in rejected] == ["two"]
    assert rejected[0].reason.startswith("outlier: 2 corners jump by up to 6.9 px")


def test_where_most_views_have_wild_corners_the_board_is_like_that() -> None:
    views = [_view(f"v{k}", 40.0 * k, jumps=[3.0, 3.0] if k else []) for k in range(3)]
    assert [v.name for v in select_views(views)[0]] == ["v0", "v1", "v2"]
