"""Undistorted images and the way of boxes back to the recorded one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from percept.core.cameras import Camera, make_camera
from percept.core.errors import GeometryError
from percept.detection.images.undistort import Undistorter

_CAMERAS = {
    "none": make_camera("pinhole", (320, 201), [[260.0, 0, 161], [0.0, 262, 99], [0.0, 0, 1]], []),
    "barrel": make_camera(
        "pinhole",
        (640, 400),
        [[417.0, 0, 319.5], [0.0, 417, 199.5], [0.0, 0, 1]],
        [-0.3, 0.1, 0.001, -0.0005, 0],
    ),
    "rational": make_camera(
        "rational",
        (480, 270),
        [[250.0, 0, 242.5], [0.0, 251, 132.5], [0.0, 0, 1]],
        [1.2, 0.3, 0, 0, 0.01, 1.5, 0.6, 0.05],
    ),
    "fisheye": make_camera(
        "fisheye",
        (480, 302),
        [[237, 0, 240], [0, 237, 151], [0, 0, 1]],
        [-0.04, 0.003, -0.002, 0.0005],
    ),
    "wide fisheye": make_camera(
        "fisheye",
        (320, 200),
        [[82, 0, 160], [0, 82, 100], [0, 0, 1]],
        [-0.01, 0.003, -0.002, 0.0005],
    ),
}


@pytest.fixture(params=_CAMERAS)
def camera(request: pytest.FixtureRequest) -> Camera:
    return _CAMERAS[request.param]


def test_points_come_back_from_the_undistorted_image(camera: Camera) -> None:
    undistorter = Undistorter(camera)
    recorded = np.random.default_rng(1).uniform(0, 1, (500, 2)) * camera.image_size
    there, seen = undistorter.undistorted.project(camera.unproject(recorded - 0.5))
    back = undistorter.points_to_recorded(there[seen] + 0.5)
    assert np.abs(back - recorded[seen]).max() < 0.1
    assert seen.mean() == pytest.approx(undistorter.seen_share, abs=0.05)


@pytest.mark.parametrize("name", ["none", "barrel"])
def test_all_that_was_recorded_is_in_the_undistorted_image(name: str) -> None:
    assert Undistorter(_CAMERAS[name]).seen_share == 1


def test_a_very_wide_lens_says_how_much_it_leaves_out() -> None:
    undistorter = Undistorter(_CAMERAS["wide fisheye"])
    assert undistorter.undistorted.K[0, 0] == pytest.approx(0.7 * 82)
    assert 0.2 < undistorter.seen_share < 0.5


def test_pixels_appear_where_the_geometry_says(camera: Camera) -> None:
    """Dots that are drawn into the recorded image are found where their rays meet the new one."""
    undistorter = Undistorter(camera)
    width, height = camera.image_size
    recorded = np.zeros((height, width), np.uint8)
    dots = [(0.5 * width, 0.5 * height), (0.35 * width, 0.4 * height), (0.6 * width, 0.65 * height)]
    for u, v in dots:
        centre = (round(u * 16), round(v * 16))
        cv2.circle(recorded, centre, 3 * 16, 255, -1, shift=4, lineType=cv2.LINE_AA)
    image = undistorter.image(recorded)
    expected, _ = undistorter.undistorted.project(camera.unproject(np.array(dots)))
    for u, v in expected:
        rows, columns = (slice(max(0, round(x) - 7), round(x) + 8) for x in (v, u))
        patch = image[rows, columns].astype(np.float64)
        patch[patch == 114] = 0
        at_v, at_u = np.mgrid[rows, columns]
        found = np.array([(patch * at_u).sum(), (patch * at_v).sum()]) / patch.sum()
        assert np.abs(found - (u, v)).max() < 0.5


def test_a_box_comes_back_around_all_that_it_held(camera: Camera) -> None:
    """Whatever lies in the box of the undistorted image lies in the box of the recorded one."""
    undistorter = Undistorter(camera)
    width, height = camera.image_size
    box = np.array([0.3 * width, 0.25 * height, 0.65 * width, 0.7 * height])
    (recorded,) = undistorter.to_recorded(box[None])
    points = np.random.default_rng(2).uniform(box[:2], box[2:], (2000, 2))
    there = undistorter.points_to_recorded(points)
    assert (there >= recorded[:2] - 0.1).all()
    assert (there <= recorded[2:] + 0.1).all()
    # And it is no larger than that takes.
    spans = np.ptp(there, axis=0)
    assert (recorded[2:] - recorded[:2] <= spans * 1.1 + 1).all()


def test_without_distortion_boxes_stay() -> None:
    boxes = np.array([[0.0, 0, 320, 201], [10.25, 20, 30, 40.5], [300, 150, 320, 201]])
    np.testing.assert_allclose(Undistorter(_CAMERAS["none"]).to_recorded(boxes), boxes, atol=1e-6)


def test_boxes_at_the_border_stay_within_the_recorded_image(camera: Camera) -> None:
    undistorter = Undistorter(camera)
    width, height = camera.image_size
    boxes = np.array([[-20.0, -20, width + 20, height + 20], [0, 0, width / 2, height / 2]])
    found = undistorter.to_recorded(boxes)
    assert (found >= 0).all()
    assert (found <= [width, height, width, height]).all()


def test_a_box_on_nothing_recorded_is_no_box() -> None:
    undistorter = Undistorter(_CAMERAS["barrel"])
    assert (undistorter.image(np.zeros((400, 640), np.uint8))[0, 320 - 3 : 320 + 3] == 114).all()
    found = undistorter.to_recorded(np.array([[300.0, 0, 340, 2], [300, 150, 340, 200]]))
    assert np.isnan(found[0]).all()
    assert np.isfinite(found[1]).all()
    assert undistorter.to_recorded(np.zeros((0, 4))).shape == (0, 4)


def test_images_of_another_size_are_refused() -> None:
    with pytest.raises(GeometryError, match=r"640 x 480 pixels .* intrinsics for 640 x 400"):
        Undistorter(_CAMERAS["barrel"]).image(np.zeros((480, 640, 3), np.uint8))


def test_beyond_where_the_lens_model_folds_back_there_is_nothing() -> None:
    """1 - 0.3 r^2 turns back at 46 deg; a second picture must not appear around the first."""
    camera = make_camera("pinhole", (320, 200), [[100, 0, 160], [0, 100, 100], [0, 0, 1]], [-0.3])
    undistorter = Undistorter(camera)
    image = undistorter.image(np.full((200, 320), 255, np.uint8))
    assert image[100, 160] == 255
    assert image[100, 55] == 114
    assert (image[:, 0] == 114).all()
    assert (image[:, -1] == 114).all()
    assert np.isnan(undistorter.points_to_recorded(np.array([[10.0, 100]]))).all()
    assert undistorter.seen_share < 0.6
