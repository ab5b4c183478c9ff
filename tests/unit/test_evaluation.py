"""Scores of ground, clusters and detections against truth that is counted by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from percept.core.errors import GeometryError, InputError
from percept.core.results import Detections3D
from percept.evaluation import (
    SegmentationScores,
    ground_scores,
    match_detections,
    points_in_box,
    range_band,
    score_clusters,
    score_run,
)
from percept.export.tables import detections_3d_table


def _detections(boxes: list[list[float]], labels: list[str], scores: list[float]) -> Detections3D:
    count = len(labels)
    return Detections3D(
        stamp_ns=0,
        sensor="top",
        frame_id="top",
        boxes_m=np.array(boxes, dtype=np.float64).reshape(count, 7),
        labels=tuple(labels),
        confidences=np.array(scores, dtype=np.float64),
        mean_intensity=np.full(count, np.nan),
        points=np.full(count, 10),
    )


def _box(x: float, y: float, length: float = 4.0, width: float = 2.0) -> list[float]:
    return [x, y, 1.0, length, width, 2.0, 0.0]


def test_range_bands_meet_at_their_edges() -> None:
    bands = [range_band(r) for r in (0.0, 14.99, 15.0, 30.0, 50.0, 500.0)]
    assert bands == ["0-15 m", "0-15 m", "15-30 m", "30-50 m", "50+ m", "50+ m"]


def test_points_in_a_turned_box() -> None:
    box = np.array([10.0, 5.0, 1.0, 4.0, 2.0, 2.0, np.pi / 2])
    inside = [[10.0, 6.9, 1.0], [10.9, 5.0, 0.1], [9.1, 3.1, 1.9]]
    outside = [[11.9, 5.0, 1.0], [10.0, 7.1, 1.0], [10.0, 5.0, 2.1]]
    assert points_in_box(np.array(inside + outside), box).tolist() == [True] * 3 + [False] * 3


def test_ground_scores_count_only_what_counts() -> None:
    predicted = np.array([True, True, True, False, False, True])
    truth = np.array([True, True, False, True, False, False])
    counts = np.array([True, True, True, True, True, False])
    scores = ground_scores(predicted, truth, counts)
    assert (scores.precision, scores.recall, scores.points) == (2 / 3, 2 / 3, 5)
    assert scores.f1 == pytest.approx(2 / 3)
    assert np.isnan(ground_scores(truth[:0], truth[:0]).f1)
    with pytest.raises(GeometryError):
        ground_scores(predicted, truth[:3])


def _objects() -> tuple[NDArray[np.float32], NDArray[np.float64], list[str]]:
    """Return 40 points in each of three boxes, on a line along z, 10, 20 and 60 m away."""
    boxes = np.array([_box(10.0, 0.0), _box(20.0, 0.0), _box(60.0, 0.0)])
    z = np.linspace(0.25, 1.9, 40)
    points = np.concatenate(
        [np.stack([np.full(40, box[0]), np.zeros(40), z], axis=1) for box in boxes]
    )
    return points.astype(np.float32), boxes, ["car", "car", "pedestrian"]


def test_perfect_clusters_find_every_box() -> None:
    points, boxes, labels = _objects()
    scores = score_clusters(points, np.repeat([0, 1, 2], 40).astype(np.int32), boxes, labels)
    assert [entry.iou for entry in scores.objects] == [1.0, 1.0, 1.0]
    assert scores.recall() == 1.0
    assert scores.of("car", "15-30 m").objects[0].points == 40
    assert not any(entry.split or entry.merged for entry in scores.objects)


def test_split_and_merged_boxes_are_told_apart() -> None:
    points, boxes, labels = _objects()
    ids = np.repeat([0, 1, 2], 40).astype(np.int32)
    ids[20:40] = 3  # the first car falls into halves
    ids[40:80] = 2  # the second is one with the pedestrian
    outside = np.tile(np.array([0.0, 30.0, 1.0], np.float32), (60, 1))
    ids = np.concatenate([ids, np.full(60, 2, np.int32)])
    scores = score_clusters(np.concatenate([points, outside]), ids, boxes, labels)
    halved, swallowed, pedestrian = scores.objects
    assert (halved.iou, halved.split, halved.merged) == (0.5, True, False)
    assert (swallowed.split, swallowed.merged, pedestrian.merged) == (False, True, True)
    assert swallowed.iou == pytest.approx(40 / 140)
    assert scores.recall() == pytest.approx(1 / 3)


def test_points_at_the_bottom_count_for_no_one_and_lost_points_against() -> None:
    points, boxes, labels = _objects()
    bottom = np.tile(np.array([10.0, 0.0, 0.1], np.float32), (30, 1))
    cloud = np.concatenate([points, bottom])
    ids = np.concatenate([np.repeat([0, 1, 2], 40), np.zeros(30)]).astype(np.int32)
    assert score_clusters(cloud, ids, boxes, labels).objects[0].iou == 1.0
    ids[:30] = -1  # taken for ground, well above the bottom
    assert score_clusters(cloud, ids, boxes, labels).objects[0].iou == 0.25


def test_boxes_with_few_points_are_left_out_and_scenes_add_up() -> None:
    points, boxes, labels = _objects()
    ids = np.repeat([0, 1, 2], 40).astype(np.int32)
    part = score_clusters(points[25:], ids[25:], boxes, labels)
    assert len(part.objects) == 2
    assert len((part + part).objects) == 4
    assert np.isnan(SegmentationScores().recall())
    table = str(part).splitlines()
    assert table[0].split() == ["class", "range", "boxes", "found", "share", "split", "merged"]
    assert table[-1].split() == ["all", "all", "2", "2", "1.00", "0", "0"]


def test_clusters_of_another_length_are_refused() -> None:
    points, boxes, labels = _objects()
    with pytest.raises(GeometryError):
        score_clusters(points, np.zeros(3, np.int32), boxes, labels)


def test_detections_are_matched_counted_and_compared() -> None:
    truth = np.array([_box(10.0, 0.0), _box(20.0, 0.0), _box(40.0, 0.0), _box(60.0, 0.0)])
    labels = ["car", "car", "cone", "car"]
    found = _detections(
        [_box(11.0, 0.0), _box(20.5, 0.5), _box(25.0, 0.0)],
        ["car", "truck", "car"],
        [0.9, 0.8, 0.7],
    )
    scores = match_detections(found, truth, labels)
    assert scores.recall() == 0.5
    assert scores.recall(same_class=True) == 0.25
    assert scores.recall("car") == pytest.approx(2 / 3)
    assert scores.precision() == pytest.approx(2 / 3)
    assert scores.precision("car", same_class=True) == 0.5
    assert scores.confusion() == {("car", "car"): 1, ("car", "truck"): 1}
    assert scores.within("0-15 m").recall() == 1.0
    assert scores.within("30-50 m").recall() == 0.0
    assert np.isnan(scores.within("50+ m").precision())
    assert scores.matches[0].centre_error_m == pytest.approx(1.0)
    assert str(scores).splitlines()[-1].split()[:4] == ["all", "all", "4", "3"]


def test_the_more_confident_detection_takes_the_truth_box() -> None:
    found = _detections([_box(10.1, 0.0), _box(10.9, 0.0)], ["car", "truck"], [0.3, 0.9])
    scores = match_detections(found, np.array([_box(10.0, 0.0)]), ["car"])
    assert scores.confusion() == {("car", "truck"): 1}
    assert scores.precision() == 0.5


def test_the_gate_is_half_the_diagonal_and_one_metre_at_least() -> None:
    truth = np.array([_box(10.0, 0.0, 4.0, 3.0), _box(30.0, 0.0, 0.5, 0.5)])
    near = _detections([_box(12.4, 0.0), _box(30.9, 0.0)], ["a", "a"], [1.0, 1.0])
    far = _detections([_box(12.6, 0.0), _box(31.1, 0.0)], ["a", "a"], [1.0, 1.0])
    assert match_detections(near, truth, ["a", "a"]).recall() == 1.0
    assert match_detections(far, truth, ["a", "a"]).recall() == 0.0


def test_ignored_truth_is_neither_missed_nor_a_false_detection() -> None:
    truth = np.array([_box(10.0, 0.0), _box(20.0, 0.0)])
    found = _detections([_box(10.0, 0.0)], ["car"], [1.0])
    scores = match_detections(found, truth, ["car", "car"], np.array([True, True]))
    assert scores.matches == ()
    nothing = match_detections(_detections([], [], []), np.empty((0, 7)), [])
    assert nothing.matches == ()
    assert np.isnan(nothing.recall())
    with pytest.raises(GeometryError):
        match_detections(found, truth, ["car"])


_STAMP_NS = 1_000_000_000


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    """Two objects in the map; the vehicle stands at (100, 50) and looks along the map's y."""
    half = np.sqrt(0.5)
    poses = {"stamp_ns": [0, 2 * _STAMP_NS], "x": [100.0] * 2, "y": [50.0] * 2, "z": [0.0] * 2,
             "qx": [0.0] * 2, "qy": [0.0] * 2, "qz": [half] * 2, "qw": [half] * 2}  # fmt: skip
    objects = {"stamp_ns": [_STAMP_NS] * 2, "x": [100.0, 95.0], "y": [60.0, 70.0], "z": [1.0] * 2,
               "length": [4.0] * 2, "width": [2.0] * 2, "height": [2.0] * 2, "yaw_rad": [0.0] * 2,
               "label": ["car", "cone"], "points": [10, 9]}  # fmt: skip
    pq.write_table(pa.table(poses), tmp_path / "poses.parquet")
    pq.write_table(pa.table(objects), tmp_path / "objects.parquet")
    return tmp_path


def _run_folder(folder: Path, stamp_ns: int, frame: str = "base_link") -> Path:
    found = _detections([_box(10.0, 0.0), _box(20.0, 5.0)], ["car", "cone"], [0.9, 0.8])
    found = replace(found, stamp_ns=stamp_ns, frame_id=frame)
    pq.write_table(detections_3d_table(0, found), folder / "detections_3d.parquet")
    return folder


def test_a_run_is_scored_in_the_vehicles_frame(truth: Path, tmp_path: Path) -> None:
    run = _run_folder(tmp_path, _STAMP_NS + 50_000_000)
    (match,) = score_run(run, truth).matches
    assert (match.truth, match.detected) == ("car", "car")
    assert match.range_m == pytest.approx(10.0)
    assert match.centre_error_m == pytest.approx(0.0, abs=1e-9)
    assert len(score_run(run, truth, fewest_points=9).matches) == 2


def test_a_run_in_another_frame_or_at_another_time_is_refused(truth: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="detections are in lidar, truth needs base_link"):
        score_run(_run_folder(tmp_path, _STAMP_NS, "lidar"), truth)
    with pytest.raises(InputError, match="no scan fits the truth in time"):
        score_run(_run_folder(tmp_path, _STAMP_NS + 70_000_000), truth)
