"""The pictures of calibration reports: what is drawn where, of any size, and of nothing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from percept.core.cameras import make_camera
from percept.core.errors import GeometryError
from percept.export.calibration.pictures import (
    board_overlay,
    cloud_in_image,
    clouds_from_above,
    clouds_zoom,
    contact_sheet,
    coverage_map,
    heat_map,
    residual_quiver,
)
from percept.export.canvas import BACKGROUND, as_bgr, round_length, round_limit
from percept.export.palette import sensor_colour, sequential_colours

_SIZES = [(1, 1), (64, 48), (640, 480), (2560, 1440), (4000, 20)]
_EMPTY = np.zeros((0, 3))
_CAMERA = make_camera(
    "pinhole", (640, 480), np.array([[500, 0, 320], [0, 500, 240], [0, 0, 1]]), []
)


def _is_picture(image: np.ndarray) -> bool:
    return image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3 and image.size > 0


def _nearest(image: np.ndarray, rgb: tuple[int, int, int], tolerance: int = 40) -> np.ndarray:
    """Return rows and columns (N, 2) of pixels with about a colour."""
    off = np.abs(image.astype(int) - np.array(rgb[::-1])).max(axis=2)
    return np.argwhere(off <= tolerance)


def _of_hue(image: np.ndarray, rgb: tuple[int, int, int]) -> np.ndarray:
    """Return rows and columns (N, 2) of pixels with a colour of any brightness."""
    brightest = image.max(axis=2, keepdims=True).astype(float)
    hue = np.array(rgb[::-1]) / max(rgb)
    off = np.abs(image / np.maximum(brightest, 1) - hue).max(axis=2)
    return np.argwhere((off < 0.25) & (brightest[..., 0] > 120))


def _only(image: np.ndarray, index: int) -> np.ndarray:
    """Return the middle (row, column) of what one sensor drew below the legend."""
    found = _of_hue(image[60:], sensor_colour(index))
    assert len(found)
    middle: np.ndarray = found.mean(axis=0) + np.array([60, 0])
    return middle


def _blob(at: list[float], count: int = 60) -> np.ndarray:
    return np.array(at) + np.random.default_rng(0).normal(0, 0.05, (count, 3))


# ---- clouds


def test_from_above_forward_is_up_and_left_is_left() -> None:
    clouds = {"top": _blob([8, 0, 0]), "left": _blob([0, 8, 0]), "right": _blob([0, -8, 0])}
    image = clouds_from_above(clouds, "rig")
    ahead, left, right = (_only(image, index) for index in range(3))
    assert ahead[0] < left[0] - 100
    assert left[1] < ahead[1] - 100 < right[1] - 200


def test_from_above_shows_what_two_clouds_reach() -> None:
    # One cloud that reaches far must not make the overlap small.
    near = np.random.default_rng(1).uniform(-10, 10, (500, 3))
    far = near + np.where(np.abs(near) > 6, 190 * np.sign(near), 0)
    wide = clouds_from_above({"a": near, "b": near, "far": far})
    extent = np.ptp(_of_hue(np.maximum(wide, 1)[60:], (230, 180, 233)), axis=0)  # both
    assert extent.min() > 500


@pytest.mark.parametrize(
    ("axes", "moved_m", "down_px", "right_px"),
    [
        (("x", "y"), [1, 0, 0], -1, 0),
        (("y", "x"), [0, 1, 0], 0, -1),
        (("x", "z"), [1, 0, 0], 0, 1),
        (("z", "y"), [0, 1, 0], 0, -1),
        (("y", "z"), [0, 0, 1], -1, 0),
    ],
)
def test_a_zoom_says_which_way_is_up(
    axes: tuple[str, str], moved_m: list[float], down_px: int, right_px: int
) -> None:
    clouds = {"a": _blob([5, 5, 1]), "b": _blob([5, 5, 1]) + moved_m}
    image = clouds_zoom(clouds, np.array([5, 5, 1]), 4.0, axes)
    step = _only(image, 1) - _only(image, 0)
    assert np.allclose(step, np.array([down_px, right_px]) * 860 / 4, atol=4)


def test_a_zoom_leaves_out_what_is_outside_of_its_cube() -> None:
    clouds = {"a": _blob([0, 0, 5])}
    assert not len(_of_hue(clouds_zoom(clouds, np.zeros(3), 4.0)[60:], sensor_colour(0)))
    with pytest.raises(GeometryError, match="two of the axes"):
        clouds_zoom(clouds, np.zeros(3), 4.0, ("x", "x"))
    with pytest.raises(GeometryError, match=r"middle \(3,\)"):
        clouds_zoom(clouds, np.zeros(2), 4.0)
    with pytest.raises(GeometryError, match="size"):
        clouds_zoom(clouds, np.zeros(3), 0.0)


def test_clouds_of_nothing_nan_and_infinity_are_pictures() -> None:
    odd = np.array([[np.nan, 0, 0], [np.inf, 1, 1], [1e300, 0, 0]])
    for clouds in ({}, {"a": _EMPTY}, {"a": odd}, {"a": odd, "b": _blob([1, 1, 1])}):
        assert _is_picture(clouds_from_above(clouds, "x"))
        assert _is_picture(clouds_zoom(clouds, np.zeros(3), 3.0))
    with pytest.raises(GeometryError, match=r"\(N, 3\)"):
        clouds_from_above({"a": np.zeros((3, 4))})


def test_a_foreign_name_is_drawn_in_letters_that_exist() -> None:
    assert _is_picture(
        clouds_from_above({"läser \N{DOG} " * 30: _blob([1, 1, 1])}, "\N{DOG}" * 200)
    )


# ---- a cloud in an image


def test_points_are_drawn_where_the_camera_sees_them_near_ones_yellow() -> None:
    points = np.array([[-1.0, 0, 5]] + [[18.0, 0, 100]] * 20)
    image = cloud_in_image(np.zeros((480, 640), np.uint8), points, _CAMERA)
    header = image.shape[0] - 480 - 40
    near = tuple(int(c) for c in sequential_colours(np.array([1.0]))[0])
    found = _nearest(image[header : header + 480], (near[0], near[1], near[2]), 60)
    assert np.allclose(found.mean(axis=0), [240, 220], atol=2)


def test_a_near_point_hides_a_far_one() -> None:
    points = np.array([[0.0, 0, 2], [0, 0, 60]])
    first = cloud_in_image(np.zeros((480, 640), np.uint8), points, _CAMERA)
    assert (first == cloud_in_image(np.zeros((480, 640), np.uint8), points[::-1], _CAMERA)).all()


@pytest.mark.parametrize("size", _SIZES)
def test_images_of_any_size_and_depth_are_drawn_on(size: tuple[int, int]) -> None:
    camera = make_camera("fisheye", size, np.diag([size[0], size[0], 1.0]), [])
    points = np.random.default_rng(0).uniform(-3, 3, (50, 3))
    for pixels in (
        np.zeros(size[::-1], np.uint8),
        np.full((*size[::-1], 3), 7, np.uint16),
        np.full(size[::-1], np.nan, np.float32),
    ):
        assert _is_picture(cloud_in_image(pixels, points, camera, title="t"))
        assert _is_picture(board_overlay(pixels, points[:, :2], points[:, 1:]))


def test_an_image_of_another_size_or_shape_is_refused() -> None:
    with pytest.raises(GeometryError, match="100x50 and the camera 640x480"):
        cloud_in_image(np.zeros((50, 100), np.uint8), _EMPTY, _CAMERA)
    with pytest.raises(GeometryError, match="no image"):
        as_bgr(np.zeros((0, 4), np.uint8))
    assert _is_picture(cloud_in_image(np.zeros((480, 640), np.uint8), _EMPTY, _CAMERA))


# ---- corners


def test_arrows_point_where_the_residuals_do() -> None:
    image = residual_quiver((1000, 600), np.array([[300.0, 300]]), np.array([[1.0, 0]]), 100.0)
    drawn = np.argwhere((image[40:500] > 150).any(axis=2))  # below the title, above the bar
    rows, columns = drawn.T
    assert 320 < rows.mean() + 40 < 350  # the title takes 32 rows
    assert columns.min() == pytest.approx(300, abs=2)
    assert columns.max() == pytest.approx(400, abs=2)


def test_residuals_that_are_missing_or_none_are_a_picture() -> None:
    corners = np.array([[10.0, 10], [np.nan, 3], [30, 30]])
    residuals = np.array([[np.nan, 0], [1.0, 1], [0.0, 0]])
    assert _is_picture(residual_quiver((640, 480), corners, residuals))
    assert _is_picture(residual_quiver((640, 480), np.zeros((0, 2)), np.zeros((0, 2))))
    with pytest.raises(GeometryError, match="2 corners"):
        residual_quiver((640, 480), corners[:2], residuals)


def test_coverage_is_bright_where_boards_were_and_hatched_elsewhere() -> None:
    left = np.array([[0.0, 0], [319, 0], [319, 479], [0, 479]])
    image = coverage_map((640, 480), [left, left, np.array([[np.nan, 1]]), np.zeros((0, 2))])
    top = image.shape[0] - 480 - 40
    assert image[top + 240, 160].max() > 200
    assert image[top + 100 : top + 400, 400:600].max() < 110
    assert _is_picture(coverage_map((640, 480), []))


@pytest.mark.parametrize("most", [1, 2, 6, 7, 40])
def test_the_scale_of_the_coverage_has_whole_numbers(most: int) -> None:
    from percept.export.calibration.corner_pictures import _whole_limit

    last, parts = _whole_limit(most)
    assert last >= most
    assert (last - 1) % parts == 0


def test_a_heat_map_has_the_colours_of_its_values() -> None:
    values = np.tile(np.linspace(0, 2, 16), (9, 1))
    values[8, 0] = np.nan
    image = heat_map(values, (800, 450), "px", limits=(0, 2), title="t")
    top = image.shape[0] - 450 - 40
    row = image[top + 200].astype(int).sum(axis=1)
    assert row[700:790].mean() > row[10:60].mean() + 50
    assert image[top + 440, 10].max() < 110  # hatched
    assert _is_picture(heat_map(np.full((3, 3), np.nan), (640, 480), "px"))
    with pytest.raises(GeometryError, match="grid"):
        heat_map(np.zeros(3), (640, 480), "px")


@pytest.mark.parametrize("size", _SIZES)
def test_maps_of_any_size(size: tuple[int, int]) -> None:
    corners = np.random.default_rng(0).uniform(-5, 5000, (40, 2))
    assert _is_picture(residual_quiver(size, corners, corners * 1e-3, title="t"))
    assert _is_picture(coverage_map(size, [corners], title="t"))
    assert _is_picture(heat_map(np.ones((2, 3)), size, "px"))
    with pytest.raises(GeometryError, match="no size"):
        coverage_map((0, 5), [])


def test_found_and_expected_corners_are_told_apart() -> None:
    gray = np.full((480, 640), 60, np.uint8)
    image = board_overlay(gray, np.array([[100.0, 100]]), np.array([[300.0, 200]]), title="v")
    top = image.shape[0] - 480
    found = _nearest(image[top:], sensor_colour(1), 40)
    expected = _nearest(image[top:], sensor_colour(0), 40)
    assert np.allclose(found.mean(axis=0), [100, 100], atol=1)
    assert np.allclose(expected.mean(axis=0), [200, 300], atol=1)
    assert board_overlay(gray, np.zeros((0, 2))).shape == (480, 640, 3)


@pytest.mark.parametrize("count", [0, 1, 2, 7, 40])
def test_a_contact_sheet_holds_every_picture(count: int) -> None:
    pictures = [np.full((30 + 7 * k, 60, 3), 250, np.uint8) for k in range(count)]
    sheet = contact_sheet(pictures, [f"view {k}" for k in range(count)])
    assert _is_picture(sheet)
    assert sheet.shape[1] <= 1200
    white = (sheet == 250).all(axis=2).sum()
    assert (white > 0) == (count > 0)
    with pytest.raises(GeometryError, match="titles"):
        contact_sheet(pictures, ["x"] * (count + 1))


# ---- scales and colours


@pytest.mark.parametrize("rounded", [round_length, round_limit])
@pytest.mark.parametrize("value", [1e-9, 0.13, 0.2, 1.0, 4.99, 5.0, 77, 123456.0])
def test_rounded_lengths_hold_the_value(rounded: Callable[[float], float], value: float) -> None:
    assert value * (1 - 1e-6) <= rounded(value) <= 2.51 * value
    assert rounded(float("nan")) == rounded(-1) == rounded(0) == 1


def test_the_sequence_grows_in_brightness() -> None:
    colours = sequential_colours(np.array([0.0, 0.25, 0.5, 0.75, 1.0, np.nan, 9, -9])).astype(int)
    light = colours[:5] @ np.array([0.299, 0.587, 0.114])
    assert (np.diff(light) > 20).all()
    assert light[0] > np.array(BACKGROUND) @ np.array([0.299, 0.587, 0.114]) + 20
    assert np.ptp(colours[5]) == 0  # NaN is grey
    assert (colours[6] == colours[4]).all()
    assert (colours[7] == colours[0]).all()


def test_sensors_have_colours_of_their_own() -> None:
    assert len({sensor_colour(index) for index in range(8)}) == 8
    assert sensor_colour(8) == sensor_colour(0)
