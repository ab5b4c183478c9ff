"""Images wait for the scan nearest in time: order, limits, bounded waiting."""

from __future__ import annotations

import numpy as np
import pytest

from percept.core.clock import NS_PER_MS
from percept.core.errors import UsageError
from percept.core.results import Detections3D
from percept.core.samples import CameraImage, PointCloud
from percept.detection.result import ImageResult
from percept.detection.space.scan_match import ImageMatch, ScanMatcher
from percept.lidar.result import ScanResult


def _scan(stamp_ms: float, delay_ms: float = 60) -> ScanResult:
    stamp_ns = round(stamp_ms * NS_PER_MS)
    cloud = PointCloud(
        topic="/top",
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns + round(delay_ms * NS_PER_MS),
        points_xyz=np.zeros((1, 3), np.float32),
    )
    none, numbers = np.zeros(0), np.zeros(0, np.int64)
    boxes = Detections3D(stamp_ns, "top", "", np.zeros((0, 7)), (), none, none, numbers)
    return ScanResult(cloud, np.zeros(1, np.bool_), np.zeros(1, np.int32), boxes, {}, {})


def _image(frame: int, stamp_ms: float, delay_ms: float = 15, camera: str = "front") -> ImageResult:
    stamp_ns = round(stamp_ms * NS_PER_MS)
    return ImageResult(
        frame=frame,
        camera=camera,
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns + round(delay_ms * NS_PER_MS),
        image=None,
    )


def _depth(stamp_ms: float) -> CameraImage:
    stamp_ns = round(stamp_ms * NS_PER_MS)
    pixels = np.ones((2, 2), np.float32)
    return CameraImage(topic="/d", stamp_ns=stamp_ns, log_time_ns=stamp_ns, pixels=pixels)


def _fed(matcher: ScanMatcher, items: list[ScanResult | ImageResult]) -> list[ImageMatch]:
    """Feed in the order of the log times, and flush."""
    ordered = sorted(
        items, key=lambda i: i.log_time_ns if isinstance(i, ImageResult) else i.cloud.log_time_ns
    )
    matches: list[ImageMatch] = []
    for item in ordered:
        if isinstance(item, ImageResult):
            matches += matcher.add_image(item)
        else:
            matches += matcher.add_scan("top", item)
    return matches + matcher.flush()


def _pairs(matches: list[ImageMatch]) -> list[tuple[int, float | None]]:
    """The number of each image with the stamp of its scan in ms."""
    stamps = [{n: s.cloud.stamp_ns / NS_PER_MS for n, s in m.scans.items()} for m in matches]
    return [(m.image.frame, s.get("top")) for m, s in zip(matches, stamps, strict=True)]


def test_each_image_gets_the_scan_nearest_by_stamp_in_image_order() -> None:
    images = [_image(k, stamp) for k, stamp in enumerate((90, 130, 149, 151, 250))]
    matches = _fed(ScanMatcher(["top"]), [*images, *(_scan(s) for s in (100, 200, 300))])
    assert _pairs(matches) == [(0, 100), (1, 100), (2, 100), (3, 200), (4, 200)]


def test_a_scan_recorded_late_is_waited_for() -> None:
    """The scan at 200 is written 60 ms later, after the image at 190."""
    matcher = ScanMatcher(["top"])
    assert matcher.add_scan("top", _scan(100)) == []
    assert matcher.add_image(_image(0, 190)) == []
    assert _pairs(matcher.add_scan("top", _scan(200))) == [(0, 200)]


def test_an_image_with_nothing_near_has_no_scan_and_is_counted() -> None:
    matcher = ScanMatcher(["top"])
    images = [_image(0, 100), _image(1, 250), _image(2, 1000, camera="rear")]
    assert _pairs(_fed(matcher, [_scan(100), *images])) == [(0, 100), (1, None), (2, None)]
    assert matcher.unmatched == {"front": 1, "rear": 1}


@pytest.mark.parametrize(("difference_ms", "expected"), [(100, 100.0), (101, None)])
def test_the_largest_difference_belongs_to_it(difference_ms: int, expected: float | None) -> None:
    assert _pairs(_fed(ScanMatcher(["top"]), [_scan(100), _image(0, 100 + difference_ms)])) == [
        (0, expected)
    ]


def test_a_lidar_that_dies_holds_nothing_up_for_long() -> None:
    matcher = ScanMatcher(["top"])
    matcher.add_scan("top", _scan(0))
    most, done = 0, 0
    for k in range(200):
        done += len(matcher.add_image(_image(k, 33 * k)))
        most = max(most, k + 1 - done)
    assert most <= 17  # half a second of images
    assert done >= 183


def test_so_many_cameras_that_half_a_second_is_too_much_wait_less() -> None:
    matcher = ScanMatcher(["top"])
    assert sum(len(matcher.add_image(_image(k, k))) for k in range(300)) == 300 - 64


def test_memory_stays_flat() -> None:
    matcher = ScanMatcher(["top"])
    for k in range(500):
        matcher.add_scan("top", _scan(100 * k))
        matcher.add_image(_image(k, 100 * k + 70))
    assert len(matcher._scans["top"]._items) <= 8


def test_clocks_that_are_far_apart_match_nothing_and_hold_nothing_up() -> None:
    """The camera's stamps are an hour ahead; both are recorded at the same time."""
    matcher = ScanMatcher(["top"])
    hour_ms = 3_600_000
    images = [_image(k, hour_ms + 100 * k, delay_ms=-hour_ms) for k in range(20)]
    matches = _fed(matcher, [*images, *(_scan(100 * k) for k in range(20))])
    assert _pairs(matches) == [(k, None) for k in range(20)]
    assert matcher.unmatched == {"front": 20}


def test_what_is_recorded_half_a_second_later_does_not_belong_to_it() -> None:
    """A clock that was set back gives old stamps again."""
    for delay_ms, expected in ((515, 100), (516, None)):
        matcher = ScanMatcher(["top"])
        assert _pairs(_fed(matcher, [_image(0, 100), _scan(100, delay_ms)])) == [(0, expected)]


def test_separate_lidars_each_give_their_nearest_scan() -> None:
    matcher = ScanMatcher(["left", "right"])
    matcher.add_scan("left", _scan(100))
    matcher.add_scan("right", _scan(130))
    matcher.add_image(_image(0, 140))
    matcher.add_scan("left", _scan(200))
    (match,) = matcher.add_scan("right", _scan(230))
    assert {n: s.cloud.stamp_ns / NS_PER_MS for n, s in match.scans.items()} == {
        "left": 100,
        "right": 130,
    }


def test_a_depth_image_belongs_to_its_own_camera() -> None:
    matcher = ScanMatcher([], depth_cameras=["front"])
    assert [m.depth for m in matcher.add_image(_image(0, 100, camera="rear"))] == [None]
    assert matcher.add_image(_image(1, 100)) == []
    depth = _depth(120)
    (match,) = matcher.add_depth("front", depth)
    assert match.depth is depth
    assert not matcher.unmatched


def test_without_streams_images_pass_at_once_and_are_not_counted() -> None:
    matcher = ScanMatcher([])
    assert [m.image.frame for m in matcher.add_image(_image(3, 5))] == [3]
    assert not matcher.unmatched


def test_what_was_not_announced_is_refused() -> None:
    matcher = ScanMatcher(["top"], depth_cameras=["front"])
    with pytest.raises(UsageError, match="no LiDAR stream 'left' among top"):
        matcher.add_scan("left", _scan(0))
    with pytest.raises(UsageError, match="no camera 'rear' among front"):
        matcher.add_depth("rear", _depth(0))
    with pytest.raises(UsageError, match="negative"):
        ScanMatcher(["top"], -1)
