"""KITTI's rows, with numbers worked by hand: a camera that looks straight ahead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.datasets.labelling.formats.camera_views import CameraView, rectified_labels
from percept.datasets.labelling.formats.kitti_boxes import kitti_rows, row_text, tilt_deg
from percept.datasets.labelling.labelled_set import ImageBoxes, LabelledFrame, SolidBoxes

_SENSOR = CameraSensor(
    "front", None, "front", (640, 400), "pinhole", (400.0, 400.0, 319.5, 199.5), (0.0,) * 5, None
)


def _image_boxes(count: int) -> ImageBoxes:
    return ImageBoxes(
        ids=np.arange(1, count + 1),
        boxes_px=np.tile([10.0, 20.0, 30.0, 50.0], (count, 1)),
        labels=("car",) * count,
        confidences=np.ones(count),
        sources=("net",) * count,
        track_ids=np.full(count, -1),
        solids=np.zeros(count, np.int64),
        truncated=np.full(count, np.nan),
        occluded=np.full(count, np.nan),
    )


def _view(boxes: ImageBoxes) -> CameraView:
    optical = np.array([[0, 0, 1.0, 1.5], [-1, 0, 0, 0], [0, -1, 0, 1.6], [0, 0, 0, 1]])
    T_base_camera = Transform("base_link", "front", optical)
    frame = LabelledFrame(
        frame=0, camera="front", stamp_ns=0, offset_ns=0, file="images/a.jpg",
        rectified_file=None, image_size=(640, 400), boxes=boxes,
    )  # fmt: skip
    return CameraView(
        frame=frame, sensor=_SENSOR, T_base_camera=T_base_camera,
        T_then_base=Transform.identity("base_link", "base_link"),
        T_camera_base=T_base_camera.inverse(), moved=True, boxes=boxes, left_out=0,
    )  # fmt: skip


def _solids(*boxes: tuple[float, ...]) -> SolidBoxes:
    count = len(boxes)
    return SolidBoxes(
        ids=np.arange(5, 5 + count),
        boxes_m=np.array(boxes).reshape(-1, 7),
        labels=("car",) * count,
        confidences=np.ones(count),
        sources=("tracks",) * count,
        track_ids=np.full(count, -1),
        velocities_mps=np.zeros((count, 2)),
        points=np.zeros(count, np.int64),
    )


def _rows(boxes: ImageBoxes, solids: SolidBoxes) -> NDArray[np.float64]:
    return kitti_rows(_view(boxes), solids)


def test_a_car_that_drives_ahead_on_the_right() -> None:
    """It is 10 m before the camera and 10 m to its right: the bearing is 45 degrees."""
    boxes = replace(_image_boxes(1), solids=np.array([5]))
    row = _rows(boxes, _solids((11.5, -10.0, 0.8, 4.5, 1.8, 1.6, 0.0)))[0]
    np.testing.assert_allclose(row[7:13], [1.6, 1.8, 4.5, 10, 1.6, 10])  # 1.6 m down is the ground
    np.testing.assert_allclose(row[13], -np.pi / 2)  # along the camera's z
    np.testing.assert_allclose(row[2], -np.pi * 3 / 4)


def test_a_car_that_drives_to_the_right() -> None:
    boxes = replace(_image_boxes(1), solids=np.array([5]))
    row = _rows(boxes, _solids((11.5, 0.0, 0.8, 4.5, 1.8, 1.6, -np.pi / 2)))[0]
    np.testing.assert_allclose(row[[2, 13]], 0, atol=1e-12)  # along the camera's x


def test_how_visible_an_object_is() -> None:
    boxes = replace(
        _image_boxes(5),
        truncated=np.array([0.0, 0.3, 0.9, np.nan, 0.1]),
        occluded=np.array([0.1, 0.2, 0.7, np.nan, 0.0]),
    )
    rows = _rows(boxes, _solids())
    np.testing.assert_array_equal(rows[:, 0], [0, 0.3, 0.9, -1, 0.1])
    np.testing.assert_array_equal(rows[:, 1], [0, 1, 2, 3, 0])
    np.testing.assert_array_equal(rows[:, 2], -10)
    shares = [row_text("car", row).split()[:3] for row in rows]
    assert shares[1:4] == [["car", "0.30", "1"], ["car", "0.90", "2"], ["car", "-1.00", "3"]]
    levels = [row_text("car", row, whole_truncated=True).split()[1] for row in rows]
    assert levels == ["0", "1", "2", "-1", "0"]


def test_what_rectifying_cuts_off_counts_as_truncated() -> None:
    fisheye = replace(
        _SENSOR, model="fisheye", distortion=(0.0,) * 4, K=(250.0, 250.0, 319.5, 199.5)
    )
    boxes = replace(
        _image_boxes(3),
        boxes_px=np.array([[0.0, 150, 160, 250], [0, 150, 160, 250], [300, 180, 340, 220]]),
        truncated=np.array([np.nan, 0.5, np.nan]),
    )
    rectified, kept = rectified_labels(boxes, fisheye)
    assert kept.all()
    cut = rectified.truncated[0]
    assert 0.2 < cut < 0.7
    np.testing.assert_allclose(rectified.truncated[1], 1 - 0.5 * (1 - cut))
    assert np.isnan(rectified.truncated[2])


def test_boxes_that_are_not_shown_are_left_out_with_all_they_have() -> None:
    fisheye = replace(
        _SENSOR, model="fisheye", distortion=(0.0,) * 4, K=(250.0, 250.0, 319.5, 199.5)
    )
    boxes = replace(
        _image_boxes(2),
        boxes_px=np.array([[0.0, 0, 20, 20], [300, 180, 340, 220]]),
        labels=("truck", "car"), track_ids=np.array([4, 9]), solids=np.array([5, 6]),
    )  # fmt: skip
    rectified, kept = rectified_labels(boxes, fisheye)
    assert kept.tolist() == [False, True]
    assert rectified.labels == ("car",)
    assert (rectified.ids[0], rectified.track_ids[0], rectified.solids[0]) == (2, 9, 6)


def test_the_tilt_of_a_camera() -> None:
    view = _view(_image_boxes(0))
    assert tilt_deg(view.T_camera_base) < 1e-6
    down = np.eye(4)
    angle = np.radians(10)
    down[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    tilted = Transform("front", "front", down) @ view.T_camera_base
    np.testing.assert_allclose(tilt_deg(tilted), 10)
