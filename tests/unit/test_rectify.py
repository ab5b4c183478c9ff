"""Images and boxes without lens distortion: against OpenCV, and there and back."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.rig import CameraSensor
from percept.datasets.labelling.images.rectify import (
    has_distortion,
    recorded_boxes,
    rectified_boxes,
    rectified_camera,
    rectify_image,
)

_SIZE = (320, 200)
_K = (190.0, 191.0, 158.5, 99.25)


def _camera(model: str, *distortion: float, f: float = 190.0) -> CameraSensor:
    K = (f, f * 1.005, *_K[2:])
    return CameraSensor("front", None, "front", _SIZE, model, K, distortion, None)


_BARREL = _camera("pinhole", -0.24, 0.05, 0.001, -0.0008, 0.0)
_FISHEYE = _camera("fisheye", 0.01, -0.003, 0.0, 0.0, f=130.0)
_FOLDING = _camera("pinhole", -0.45, 0.0, 0.0, 0.0, 0.0, f=120.0)
_PLAIN = _camera("pinhole", 0.0, 0.0, 0.0, 0.0, 0.0)
_BENT = {"barrel": _BARREL, "fisheye": _FISHEYE}


def _matrix(sensor: CameraSensor) -> NDArray[np.float64]:
    fx, fy, cx, cy = sensor.K
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def _smooth_picture() -> NDArray[np.uint8]:
    small = np.random.default_rng(1).integers(0, 256, (10, 16, 3), dtype=np.uint8)
    return np.asarray(cv2.resize(small, _SIZE, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def _boxes(count: int) -> NDArray[np.float64]:
    random = np.random.default_rng(2)
    corners = random.uniform(0, 1, (2, count, 2)) * _SIZE
    return np.hstack([corners.min(axis=0), corners.max(axis=0)])


@pytest.mark.parametrize("name", _BENT)
def test_images_are_those_that_opencv_makes(name: str) -> None:
    sensor, picture = _BENT[name], _smooth_picture()
    K, D = _matrix(sensor), np.array(sensor.distortion)
    if name == "fisheye":
        expected = cv2.fisheye.undistortImage(picture, K, D, Knew=K)
    else:
        expected = cv2.undistort(picture, K, D)
    inner = np.s_[20:-20, 20:-20]  # at the edges OpenCV blends with black by its own rounding
    off = np.abs(rectify_image(picture, sensor)[inner].astype(int) - expected[inner])
    assert off.max() <= 2


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_kinds_of_pixels_stay(dtype: str) -> None:
    grey = np.full(_SIZE[::-1], 200, dtype=dtype)
    straight = rectify_image(grey, _BARREL)
    assert straight.dtype == grey.dtype
    assert straight.shape == grey.shape
    assert straight[100, 160] == 200


def test_an_image_of_another_size_is_refused() -> None:
    with pytest.raises(GeometryError, match="front: an image of 160 x 200 pixels"):
        rectify_image(np.zeros((200, 160), np.uint8), _BARREL)


def test_a_lens_without_distortion_changes_nothing() -> None:
    picture, boxes = _smooth_picture(), _boxes(5)
    assert not has_distortion(_PLAIN)
    assert rectify_image(picture, _PLAIN) is picture
    straight, shown = rectified_boxes(boxes, _PLAIN)
    np.testing.assert_array_equal(straight, boxes)
    np.testing.assert_array_equal(shown, 1)
    np.testing.assert_array_equal(recorded_boxes(boxes, _PLAIN), boxes)


def test_a_fisheye_bends_also_without_coefficients() -> None:
    assert has_distortion(_camera("fisheye", 0.0, 0.0, 0.0, 0.0))


def test_the_rectified_camera_is_a_pinhole_of_the_same_matrix() -> None:
    plain = rectified_camera(_FISHEYE)
    assert (plain.model, plain.K, plain.image_size) == ("pinhole", _FISHEYE.K, _SIZE)
    assert not has_distortion(plain)


def test_sides_go_where_their_middles_go() -> None:
    box = np.array([[190.0, 40.0, 230.0, 60.0]])
    middles = np.array([[190, 50], [210, 40], [230, 50], [210, 60.0]]) - 0.5
    K, D = _matrix(_BARREL), np.array(_BARREL.distortion)
    moved = cv2.undistortPoints(middles[:, None], K, D, P=K)[:, 0] + 0.5
    straight, _ = rectified_boxes(box, _BARREL)
    expected = [[moved[0, 0], moved[1, 1], moved[2, 0], moved[3, 1]]]
    np.testing.assert_allclose(straight, expected, atol=1e-3)  # OpenCV stops early


@pytest.mark.parametrize("name", _BENT)
def test_boxes_that_are_not_cut_come_back(name: str) -> None:
    boxes = _boxes(400)
    straight, shown = rectified_boxes(boxes, _BENT[name])
    whole = (shown > 0) & (straight[:, :2] > 0).all(axis=1) & (straight[:, 2:] < _SIZE).all(axis=1)
    assert whole.sum() > 100
    back = recorded_boxes(straight[whole], _BENT[name])
    np.testing.assert_allclose(back, boxes[whole], atol=1e-5)


def test_how_much_of_a_box_the_rectified_image_shows() -> None:
    boxes = np.array([[0.0, 0, 12, 10], [0, 60, 80, 140], [140, 80, 180, 120]])
    straight, shares = rectified_boxes(boxes, _FISHEYE)
    assert shares[0] == 0
    assert 0.3 < shares[1] < 0.7
    assert shares[2] == 1
    assert straight[1, 0] == 0  # cut at the edge
    assert (straight >= 0).all()
    assert (straight <= [*_SIZE, *_SIZE]).all()


def test_a_box_beyond_the_lens_ends_where_the_lens_does() -> None:
    """The model of this lens folds back before the corners of the rectified image."""
    back = recorded_boxes(np.array([[0.0, 0.0, 30.0, 20.0], [100, 60, 200, 140]]), _FOLDING)
    middle = rectified_boxes(back[1:], _FOLDING)[0]
    np.testing.assert_allclose(middle, [[100, 60, 200, 140]], atol=1e-5)
    radii = np.linspace(0, 1, 1000)
    reach = 120.0 * (radii * (1 - 0.45 * radii**2)).max()
    off = np.linalg.norm(back[0].reshape(2, 2) - _K[2:], axis=1)
    np.testing.assert_allclose(off, reach, atol=4)


def test_no_boxes_are_no_boxes() -> None:
    straight, shown = rectified_boxes(np.zeros((0, 4)), _BARREL)
    assert straight.shape == (0, 4)
    assert shown.shape == (0,)
    assert recorded_boxes(np.zeros((0, 4)), _BARREL).shape == (0, 4)
