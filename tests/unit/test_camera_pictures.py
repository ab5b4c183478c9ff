"""Images with boxes for reports, and clouds in images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_images import make_image

from percept.core.cameras import PinholeCamera
from percept.core.errors import GeometryError
from percept.core.results import Detections2D
from percept.core.samples import CameraImage
from percept.core.transform import Transform
from percept.detection.result import ImageResult
from percept.export.camera_pictures import boxes_on_image, jpeg_data_uri
from percept.export.canvas import Image
from percept.export.palette import model_colours, sensor_colour_name
from percept.export.projection import project_cloud

_COLOURS = model_colours(("near", "far"))
_HEADER_PX = 30


def _found(boxes_px: list[list[float]], label: str = "car") -> Detections2D:
    count = len(boxes_px)
    return Detections2D(0, "front", np.array(boxes_px), (label,) * count, np.full(count, 0.9))


def _image(pixels: np.ndarray, **boxes: Detections2D) -> ImageResult:
    sample = CameraImage(topic="/i", stamp_ns=0, log_time_ns=0, frame="front", pixels=pixels)
    return replace(make_image(0), image=sample, boxes=boxes, primary={}, positions={})


def _picture(pixels: np.ndarray, **boxes: Detections2D) -> Image:
    """Return the picture without its legend."""
    return boxes_on_image(_image(pixels, **boxes), _COLOURS)[_HEADER_PX:]


def _is(picture: Image, column: int, row: int, model: str) -> bool:
    return bool(np.abs(picture[row, column].astype(int) - _COLOURS[model][::-1]).max() < 40)


def test_boxes_have_the_colour_of_their_model_and_their_place() -> None:
    grey = np.full((200, 300, 3), 90, np.uint8)
    picture = _picture(
        grey, near=_found([[40, 60, 120, 160]]), far=_found([[200, 60.4, 280, 160.2]])
    )
    assert picture.shape == (200, 320, 3)  # the legend is wider than the image
    left = (320 - 300) // 2
    for column, row in ((40, 110), (119, 110), (80, 60), (80, 159)):
        assert _is(picture, left + column, row, "near"), (column, row)
    assert _is(picture, left + 200, 110, "far")
    assert (picture[110, left + 80] == 90).all()  # the inside is free
    assert (grey == 90).all()


def test_a_wide_image_is_made_smaller_with_its_boxes() -> None:
    picture = _picture(np.full((540, 1920, 3), 90, np.uint8), near=_found([[400, 200, 1200, 400]]))
    assert picture.shape[:2] == (270, 960)
    assert _is(picture, 200, 150, "near")
    assert _is(picture, 600, 150, "near")


def test_a_duplicate_is_thin_and_has_no_text() -> None:
    grey = np.full((200, 400, 3), 90, np.uint8)
    image = _image(grey, near=_found([[100, 60, 300, 160]]))
    whole = boxes_on_image(image, _COLOURS)
    thin = boxes_on_image(replace(image, primary={"near": np.array([False])}), _COLOURS)
    changed = [np.count_nonzero((p[_HEADER_PX:] != 90).any(axis=2)) for p in (whole, thin)]
    assert changed[1] < changed[0] / 2
    assert (thin[_HEADER_PX + 44 : _HEADER_PX + 58] == 90).all()  # where the text would be


def test_texts_do_not_cover_each_other_and_stay_inside() -> None:
    same = [[0.0, 0.0, 60.0, 30.0]] * 30
    picture = _picture(np.full((60, 400, 3), 90, np.uint8), near=_found(same, "a long class name"))
    assert picture.shape == (60, 400, 3)


@pytest.mark.parametrize("box", [[-50.0, -20, 500, 300], [1e9, 1e9, 2e9, 2e9], [5, 5, 5, 5]])
def test_boxes_over_the_edge_are_drawn_as_far_as_they_go(box: list[float]) -> None:
    picture = _picture(np.full((100, 400, 3), 90, np.uint8), near=_found([box]))
    assert picture.shape == (100, 400, 3)


def test_grey_and_deep_images_are_drawn() -> None:
    deep = np.linspace(0, 60_000, 400 * 50).reshape(50, 400).astype(np.uint16)
    picture = _picture(deep, near=_found([[10, 10, 30, 30]]))
    assert picture[40, 200].max() > 150


def test_the_legend_counts_by_model() -> None:
    grey = np.full((100, 400, 3), 90, np.uint8)
    header = boxes_on_image(_image(grey, near=_found([[5, 5, 30, 30]])), _COLOURS)[:_HEADER_PX]
    assert (header.reshape(-1, 3) == _COLOURS["near"][::-1]).all(axis=1).sum() > 80


def test_a_picture_needs_pixels() -> None:
    with pytest.raises(GeometryError, match="cannot be drawn"):
        boxes_on_image(make_image(0, failure="cut"), _COLOURS)
    assert jpeg_data_uri(np.zeros((4, 4, 3), np.uint8)).startswith("data:image/jpeg;base64,/9j/")


def test_models_have_colours_of_their_own() -> None:
    names = ("a", "b", "c", "d", "e", "f", "g", "h")
    assert len(set(model_colours(names).values())) == len(names)
    assert len({sensor_colour_name(i) for i in range(8)}) == 8


class TestProjection:
    camera = PinholeCamera(
        (200, 100), np.array([[100.0, 0, 100], [0, 100.0, 50], [0, 0, 1]]), np.zeros(5)
    )
    # A LiDAR 1 m behind the camera; it looks along x, the camera along z.
    T_camera_cloud = Transform(
        "camera", "lidar", np.array([[0, -1.0, 0, 0], [0, 0, -1.0, 0], [1, 0, 0, -1], [0, 0, 0, 1]])
    )

    def test_points_come_with_pixel_and_depth(self) -> None:
        points = np.array([[11.0, 0, 0], [11, 2, 1], [-5, 0, 0], [3, 9, 0]])
        found = project_cloud(points, self.T_camera_cloud, self.camera)
        assert np.allclose(found, [[100, 50, 10], [80, 40, 10]])  # behind and beside are left out

    def test_a_large_cloud_is_thinned_evenly(self) -> None:
        points = np.column_stack([np.full(9_000, 11.0), np.linspace(-9, 9, 9_000), np.zeros(9_000)])
        found = project_cloud(points, self.T_camera_cloud, self.camera, most=100)
        assert 90 <= len(found) <= 100
        steps = np.diff(found[:, 0])
        assert np.allclose(steps, steps[0])

    def test_no_points_are_no_pixels(self) -> None:
        assert project_cloud(np.zeros((0, 3)), self.T_camera_cloud, self.camera).shape == (0, 3)
