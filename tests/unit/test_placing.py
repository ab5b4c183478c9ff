"""Images on their last step: boxes that count, places from scans and depth images, and lenses."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.cli.detect.camera_part import CameraPart
from percept.core.cameras import make_camera
from percept.core.errors import GeometryError
from percept.core.results import Detections2D, Detections3D
from percept.core.samples import CameraImage, PointCloud
from percept.core.transform import Transform
from percept.detection.images.undistort import Undistorter
from percept.detection.result import ImageResult
from percept.detection.runner import ImageDetector
from percept.detection.schedule import ModelSchedule
from percept.detection.space.lensless import LenslessDetector
from percept.detection.space.placing import BoxPlacer, CameraPlace, PlacedImage
from percept.lidar.result import ScanResult

_K = np.array([[200.0, 0, 159.5], [0, 200, 99.5], [0, 0, 1]])
_CAMERA = make_camera("pinhole", (320, 200), _K, [])
_MIDDLE, _LEFT = [140.0, 80.0, 180.0, 120.0], [20.0, 80.0, 60.0, 120.0]
_MS = 1_000_000


def _image(*boxes: list[float], models: tuple[str, ...] = ("one",)) -> ImageResult:
    rows = np.array(boxes, np.float64).reshape(-1, 4)
    found = Detections2D(0, "cam", rows, ("car",) * len(rows), np.full(len(rows), 0.5))
    return ImageResult(
        frame=0, camera="cam", stamp_ns=0, log_time_ns=0, image=None,
        boxes=dict.fromkeys(models, found),
    )  # fmt: skip


def _scan(depth_m: float) -> ScanResult:
    """A plate in the middle of the image, of one cluster, in the optical frame."""
    x, y = np.meshgrid(np.linspace(-0.9, 0.9, 12), np.linspace(-0.9, 0.9, 12))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(144, 10.0)]) * depth_m / 10
    cloud = PointCloud(
        topic="/lidar", stamp_ns=5 * _MS, log_time_ns=5 * _MS, frame="cloud",
        points_xyz=points.astype(np.float32),
    )  # fmt: skip
    one, none = np.zeros((1, 7)), np.full(1, np.nan)
    boxes = Detections3D(0, "top", "cloud", one, ("x",), none, none, np.zeros(1, np.int64))
    return ScanResult(cloud, np.zeros(144, np.bool_), np.zeros(144, np.int32), boxes, {}, {})


def _depth(pixels: NDArray[Any]) -> CameraImage:
    return CameraImage(topic="/depth", stamp_ns=0, log_time_ns=6 * _MS, pixels=pixels)


def _place(*, depth: bool = False) -> CameraPlace:
    return CameraPlace(
        camera=_CAMERA,
        T_camera_clouds={"top": Transform("camera", "cloud", np.eye(4))},
        T_target_camera=Transform("cloud", "camera", np.eye(4)) if depth else None,
    )


def _pixels(size: tuple[int, int]) -> CameraImage:
    pixels = np.zeros((size[1], size[0], 3), np.uint8)
    return CameraImage(topic="/cam", stamp_ns=0, log_time_ns=0, pixels=pixels)


def _placed(placer: BoxPlacer, image: ImageResult, depth: CameraImage | None) -> PlacedImage:
    matches = [*placer.add_image(image), *placer.add_scan(_scan(10.0))]
    matches += placer.add_depth("cam", depth) if depth is not None else []
    (match,) = matches + placer.end()
    return placer.place(match)


def test_a_scan_places_the_boxes_of_every_network() -> None:
    placer = BoxPlacer({"cam": _place()}, 100 * _MS)
    placed = _placed(placer, _image(_MIDDLE, _LEFT, models=("one", "two")), None)
    for model in ("one", "two"):
        positions = placed.result.positions[model]
        assert positions.sources == ("cluster", "")
        assert positions.range_m[0] == pytest.approx(10.0, abs=0.01)
        assert np.isnan(positions.range_m[1])
    assert placed.result.primary["one"].all()
    assert not placed.result.primary["two"].any()
    assert list(placed.scans) == ["top"]


def test_a_depth_image_tells_where_no_scan_does() -> None:
    placer = BoxPlacer({"cam": _place(depth=True)}, 100 * _MS)
    placed = _placed(placer, _image(_MIDDLE, _LEFT), _depth(np.full((200, 320), 7.0, np.float32)))
    positions = placed.result.positions["one"]
    assert positions.sources == ("cluster", "depth")
    assert positions.points_m[:, 2] == pytest.approx([10.0, 7.0], abs=0.01)
    assert (positions.points > 0).all()


def test_a_depth_image_that_cannot_be_used_is_counted() -> None:
    placer = BoxPlacer({"cam": _place(depth=True)}, 100 * _MS)
    placed = _placed(placer, _image(_LEFT), _depth(np.zeros((200, 320, 3), np.uint8)))
    assert placed.result.positions["one"].sources == ("",)
    ((reason, count),) = placer.dropped.items()
    assert (count, reason.startswith("/depth: ")) == (1, True)


def test_an_image_of_another_size_than_the_lens_has_no_places_and_is_counted() -> None:
    placer = BoxPlacer({"cam": _place()}, 100 * _MS)
    for size, located in {(320, 200): 1, (640, 400): 0, (200, 320): 0}.items():
        placed = _placed(placer, replace(_image(_MIDDLE), image=_pixels(size)), None)
        assert len(placed.result.positions) == len(placed.scans) == located
        assert len(placed.result.boxes["one"]) == 1
    broken = replace(_image(models=()), image=_pixels((200, 320)), failure="one: no numbers")
    assert not _placed(placer, broken, None).scans  # and it is not counted twice
    assert placer.dropped == {
        "images of cam without places: they have 640x400 pixels, and the lens is known for "
        "320x200": 1,
        "images of cam without places: they have 200x320 pixels, and the lens is known for "
        "320x200": 1,
    }


def test_images_of_other_cameras_pass_without_places() -> None:
    placer = BoxPlacer({}, 100 * _MS)
    assert placer.reach_ns is None
    (match,) = placer.add_image(_image(_MIDDLE))
    assert not placer.place(match).result.positions
    assert placer.add_scan(_scan(10.0)) == []


def test_places_of_one_camera_are_in_one_frame() -> None:
    with pytest.raises(GeometryError, match="one frame"):
        CameraPlace(
            camera=_CAMERA,
            T_camera_clouds={"top": Transform("camera", "cloud", np.eye(4))},
            T_target_camera=Transform("base", "camera", np.eye(4)),
        )


class _Fixed:
    """Finds the same boxes in every image."""

    def __init__(self, *boxes: list[float]) -> None:
        self.boxes = np.array(boxes)

    def detect_one(self, pixels: NDArray[Any]) -> tuple[Detections2D, dict[str, float]]:
        assert pixels.shape == (200, 320, 3)
        labels = tuple(f"thing {k}" for k in range(len(self.boxes)))
        found = Detections2D(0, "", self.boxes, labels, np.full(len(labels), 0.5))
        return found, {"prepare": 1.0, "network": 2.0}


def test_boxes_without_a_lens_come_back_in_the_recorded_image() -> None:
    lens = Undistorter(make_camera("pinhole", (320, 200), _K, [-0.3, 0.1, 0, 0, 0]))
    outside = [-4000.0, -4000.0, -3990.0, -3990.0]
    detector = LenslessDetector(_Fixed(_MIDDLE, outside, _LEFT), lens)
    found, timings_ms = detector.detect_one(np.zeros((200, 320, 3), np.uint8))
    assert found.labels == ("thing 0", "thing 2")
    np.testing.assert_allclose(found.boxes_px, lens.to_recorded(np.array([_MIDDLE, _LEFT])))
    assert sum(detector.dropped.values()) == 1
    assert timings_ms["prepare"] > 1.0
    with pytest.raises(GeometryError, match="undistorted"):
        detector.detect_one(np.zeros((50, 320, 3), np.uint8))


def test_a_run_says_what_of_the_image_no_network_sees() -> None:
    K = np.array([[90.0, 0, 159.5], [0, 90, 99.5], [0, 0, 1]])
    fisheye = make_camera("fisheye", (320, 200), K, [0] * 4)
    detectors: dict[str, dict[str, ImageDetector]] = {
        camera: {"one": LenslessDetector(_Fixed(_MIDDLE), Undistorter(lens))}
        for camera, lens in (("wide", fisheye), ("plain", _CAMERA))
    }
    part = CameraPart(
        cameras={}, models=(), schedule=ModelSchedule({"one": 1}), detectors=detectors,
        messages_in_log=0, images_expected=0,
    )  # fmt: skip
    (note,) = part.notes
    share = re.fullmatch(r"wide: an image without its lens shows (\d+)% of .*", note)
    assert share is not None
    assert 10 < int(share[1]) < 99
