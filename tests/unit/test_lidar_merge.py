"""Several LiDARs: groups by stamp with bounded waiting, and clouds merged in the base frame."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from percept.core.errors import GeometryError, UsageError
from percept.core.samples import PointCloud
from percept.core.transform import Transform
from percept.lidar import ScanGrouper, merge_clouds

_MS = 1_000_000


def _scan(topic: str, stamp_ms: float, **fields: Any) -> PointCloud:
    stamp_ns = round(stamp_ms * _MS)
    defaults: dict[str, Any] = {"points_xyz": np.ones((2, 3), np.float32), "frame": topic}
    return PointCloud(
        topic=topic, stamp_ns=stamp_ns, log_time_ns=stamp_ns + 5, **(defaults | fields)
    )


def _stamps(groups: list[tuple[PointCloud, ...]]) -> list[list[tuple[str, int]]]:
    return [[(scan.topic, scan.stamp_ns // _MS) for scan in group] for group in groups]


def test_groups_take_the_nearest_scan_of_each_topic() -> None:
    scans = []
    for k in range(4):
        scans += [_scan("left", 100 * k + 30), _scan("top", 100 * k), _scan("right", 100 * k - 20)]
    grouper = ScanGrouper(["top", "left", "right"])
    groups = _stamps(list(grouper.groups(sorted(scans, key=lambda scan: scan.log_time_ns))))
    assert groups == [
        [("top", 100 * k), ("left", 100 * k + 30), ("right", 100 * k - 20)] for k in range(4)
    ]
    assert not grouper.missing
    assert not grouper.unmatched
    assert grouper.tolerance_ns == 50 * _MS


def test_a_scan_that_comes_late_in_the_log_is_still_taken() -> None:
    grouper = ScanGrouper(["top", "left"], tolerance_ns=10 * _MS)
    order = [("top", 0), ("top", 100), ("left", 0), ("top", 200), ("left", 100), ("left", 200)]
    groups = _stamps(list(grouper.groups(_scan(*item) for item in order)))
    assert groups == [[("top", t), ("left", t)] for t in (0, 100, 200)]


def test_a_group_goes_out_as_soon_as_no_later_scan_can_be_nearer() -> None:
    grouper = ScanGrouper(["top", "left"], tolerance_ns=10 * _MS)
    assert grouper.push(_scan("top", 0)) == []
    assert _stamps(grouper.push(_scan("left", 0))) == [[("top", 0), ("left", 0)]]


def test_stamps_decide_which_scans_belong_together_not_times_of_recording() -> None:
    grouper = ScanGrouper(["top", "left"], tolerance_ns=10 * _MS)
    delayed = replace(_scan("left", 0), log_time_ns=101 * _MS)
    order = [_scan("top", 0), _scan("top", 100), delayed, _scan("left", 100)]
    assert _stamps(list(grouper.groups(order))) == [[("top", t), ("left", t)] for t in (0, 100)]


def test_gaps_are_counted_and_scans_are_used_once() -> None:
    grouper = ScanGrouper(["top", "left"], tolerance_ns=40 * _MS)
    order = [("top", 0), ("left", 5), ("left", 55), ("top", 100), ("top", 130), ("left", 131)]
    groups = _stamps(list(grouper.groups(_scan(*item) for item in order)))
    assert groups == [[("top", 0), ("left", 5)], [("top", 100)], [("top", 130), ("left", 131)]]
    assert grouper.missing == {"left": 1}
    assert grouper.unmatched == {"left": 1}


def test_a_dead_sensor_holds_nothing_up() -> None:
    grouper = ScanGrouper(["top", "left"])
    waiting = 0
    for k in range(50):
        groups = grouper.push(_scan("top", 100 * k))
        waiting += 1 - len(groups)
        assert waiting <= 5
    grouper.flush()
    assert grouper.missing == {"left": 50}


def test_a_dead_reference_keeps_memory_flat() -> None:
    grouper = ScanGrouper(["top", "left"])
    for k in range(100):
        assert grouper.push(_scan("left", 100 * k)) == []
    assert grouper.unmatched["left"] >= 90
    assert grouper.flush() == []
    assert grouper.unmatched == {"left": 100}


def test_one_topic_passes_through() -> None:
    grouper = ScanGrouper(["top"])
    groups = list(grouper.groups(_scan("top", 100 * k) for k in range(3)))
    assert [len(group) for group in groups] == [1, 1, 1]


def test_bad_topics_are_refused() -> None:
    for topics in ([], ["top", "top"]):
        with pytest.raises(UsageError, match="different topics"):
            ScanGrouper(topics)
    with pytest.raises(UsageError, match="negative"):
        ScanGrouper(["top"], tolerance_ns=-1)
    with pytest.raises(UsageError, match="'rear' is none of top"):
        ScanGrouper(["top"]).push(_scan("rear", 0))


def _placement(frame: str, x: float, base: str = "base_link") -> Transform:
    matrix = np.eye(4)
    matrix[0, 3] = x
    return Transform(base, frame, matrix)


def test_merge_keeps_all_fields_aligned() -> None:
    top = _scan(
        "top",
        100,
        intensity=np.array([1, 2], np.float32),
        offset_ns=np.array([0, 7]),
        ring=np.array([3, 4], np.int32),
        dropped_nonfinite=2,
    )
    left = _scan("left", 103, offset_ns=np.array([-1, 0]), dropped_nonfinite=1)
    places = {"top": _placement("top", 1.0), "left": _placement("left", -2.0)}
    merged = merge_clouds([top, left], places)
    assert (merged.topic, merged.frame, merged.stamp_ns) == ("top+left", "base_link", 100 * _MS)
    assert merged.log_time_ns == left.log_time_ns
    assert merged.points_xyz[:, 0].tolist() == [2, 2, -1, -1]
    np.testing.assert_array_equal(merged.intensity, [1, 2, np.nan, np.nan])
    assert merged.offset_ns is not None
    assert merged.offset_ns.tolist() == [0, 7, 3 * _MS - 1, 3 * _MS]
    assert merged.ring is not None
    assert merged.ring.tolist() == [3, 4, -1, -1]
    assert merged.dropped_nonfinite == 3


def test_merge_without_fields_has_none() -> None:
    places = {name: _placement(name, 0.0) for name in ("top", "left")}
    merged = merge_clouds([_scan("top", 100), _scan("left", 100)], places)
    assert merged.intensity is None
    assert merged.ring is None
    assert merged.offset_ns is None
    shifted = merge_clouds([_scan("top", 100), _scan("left", 98)], places)
    assert shifted.offset_ns is not None
    assert shifted.offset_ns.tolist() == [0, 0, -2 * _MS, -2 * _MS]


def test_merge_refuses_what_has_no_place() -> None:
    with pytest.raises(GeometryError, match="'left' has no transform"):
        merge_clouds([_scan("left", 0)], {"top": _placement("top", 0)})
    places = {"top": _placement("top", 0), "left": _placement("left", 0, base="map")}
    with pytest.raises(GeometryError, match="several base frames"):
        merge_clouds([_scan("top", 0), _scan("left", 0)], places)
    with pytest.raises(GeometryError, match="no cloud"):
        merge_clouds([], {})
