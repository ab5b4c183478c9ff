"""Whatever the order of arrival, the tracks are those of the order in time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.results import Detections2D, Detections3D, Tracks
from percept.core.rig import CameraSensor
from percept.core.transform import Transform, rotation_from_rpy
from percept.tracking import Tracker, TrackerConfig
from percept.tracking.history import TrackHistory

_MS = 1_000_000
_WINDOW_MS = 300
_CONFIG = TrackerConfig(rollback_window_s=_WINDOW_MS / 1000)
_ORDERS = 1000

Pushed = Detections3D | Detections2D


def _camera() -> CameraSensor:
    # Optical frame of a camera that looks along x: z forward, x right, y down.
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(-np.pi / 2, 0.0, -np.pi / 2)
    matrix[:3, 3] = [0.0, 0.0, 1.5]
    place = Transform("base", "front", matrix)
    return CameraSensor(
        "front", None, "front", (640, 480), "pinhole", (400.0, 400.0, 320.0, 240.0), (0.0,) * 5,
        place,
    )  # fmt: skip


def _scan(rng: np.random.Generator, stamp_ms: int, sensor: str) -> Detections3D:
    """Three objects that cross each other, one of them sometimes missed, and false boxes."""
    t = stamp_ms / 1000
    truth = [
        ([10 + 8 * t, 3 - 2 * t, 0.8, 4.2, 1.8, 1.5, 0.0], "car"),
        ([12 + 4 * t, -1 + 2 * t, 0.9, 0.7, 0.6, 1.8, 1.5], "pedestrian"),
        ([20 - 6 * t, 0.5, 0.9, 1.7, 0.6, 1.7, 3.0], "cyclist"),
        ([rng.uniform(5, 30), rng.uniform(-8, 8), 0.5, 1, 1, 1, 0.0], "unknown"),
    ]
    seen = [one for one in truth if rng.random() > 0.2]
    boxes = np.array([box for box, _ in seen]).reshape(-1, 7)
    boxes = boxes + rng.normal(0, 0.05, boxes.shape)
    scores = rng.uniform(0.2, 1.0, len(seen))
    return Detections3D(
        stamp_ms * _MS, sensor, "base", boxes, tuple(label for _, label in seen), scores
    )


def _image(rng: np.random.Generator, stamp_ms: int) -> Detections2D:
    corners = rng.uniform(200, 300, (2, 2))
    boxes = np.hstack([corners, corners + np.array([60.0, 50.0])])
    labels, scores = ("person", "truck"), np.array([0.7, 0.6])
    return Detections2D(stamp_ms * _MS, "front", boxes, labels, scores)


def _drive(seed: int) -> list[Pushed]:
    """Two LiDARs and a camera of different rates; some stamps are equal."""
    rng = np.random.default_rng(seed)
    drive: list[Pushed] = [_scan(rng, ms, "left") for ms in range(0, 600, 100)]
    drive += [_scan(rng, ms, "right") for ms in range(0, 600, 150)]
    drive += [_image(rng, ms) for ms in range(50, 600, 200)]
    return sorted(drive, key=lambda one: one.stamp_ns)


def _run(arrivals: list[Pushed]) -> Tracker:
    tracker = Tracker(_CONFIG, cameras={"front": _camera()})
    for one in arrivals:
        tracker.push(one)
    return tracker


def _late(drive: list[Pushed], rng: np.random.Generator) -> list[Pushed]:
    """Delay each measurement by up to the window."""
    delays = rng.integers(0, _WINDOW_MS, len(drive)) * _MS
    arrival = np.array([one.stamp_ns for one in drive]) + delays
    return [drive[k] for k in np.argsort(arrival, kind="stable")]


def _columns(tracks: Tracks) -> tuple[NDArray[np.float64], tuple[object, ...]]:
    numbers = np.column_stack(
        [
            tracks.boxes_m, tracks.velocities_mps, tracks.label_probabilities,
            tracks.position_sd_m, tracks.velocity_sd_mps, tracks.scores, tracks.ids,
        ]
    )  # fmt: skip
    return numbers, (tracks.labels, tracks.states, tracks.observed.tolist())


def _assert_same(found: Sequence[Tracks], expected: Sequence[Tracks]) -> None:
    numbers, words = zip(*map(_columns, found), strict=True)
    expected_numbers, expected_words = zip(*map(_columns, expected), strict=True)
    assert words == expected_words
    np.testing.assert_allclose(
        np.concatenate(numbers), np.concatenate(expected_numbers), rtol=0, atol=1e-9
    )


def _assert_same_history(history: TrackHistory, expected: TrackHistory) -> None:
    assert (history.track_id, history.motion) == (expected.track_id, expected.motion)
    for name in ("stamps_ns", "states", "covariances", "shapes", "class_probabilities", "scores"):
        np.testing.assert_allclose(
            getattr(history, name), getattr(expected, name), rtol=0, atol=1e-9
        )


def test_any_order_within_the_window_gives_the_tracks_of_the_order_in_time() -> None:
    drive = _drive(0)
    stamps = sorted({one.stamp_ns for one in drive} | {s * _MS for s in (-5, 33, 444, 800)})
    in_order = _run(drive)
    expected = [in_order.tracks(stamp) for stamp in stamps]
    assert sum(len(tracks) for tracks in expected) > 30
    rng = np.random.default_rng(1)
    disordered = 0
    for _ in range(_ORDERS):
        arrivals = _late(drive, rng)
        disordered += [one.stamp_ns for one in arrivals] != [one.stamp_ns for one in drive]
        tracker = _run(arrivals[: len(arrivals) // 2])
        tracker.tracks(10**10)  # makes states, which what comes now has to rewind
        for one in arrivals[len(arrivals) // 2 :]:
            tracker.push(one)
        _assert_same([tracker.tracks(stamp) for stamp in stamps], expected)
        assert not tracker.dropped
    assert disordered > 0.99 * _ORDERS


def test_histories_do_not_depend_on_the_order_of_arrival() -> None:
    drive = _drive(2)
    expected = _run(drive).histories()
    tracker = _run([])
    for one in _late(drive, np.random.default_rng(3)):
        tracker.push(one)
        tracker.tracks(one.stamp_ns)
    histories = tracker.histories()
    assert len(histories) == len(expected) > 2
    for history, other in zip(histories, expected, strict=True):
        _assert_same_history(history, other)


def test_answers_on_the_way_are_those_of_what_has_arrived() -> None:
    drive = _drive(4)
    arrivals = _late(drive, np.random.default_rng(5))
    tracker = Tracker(_CONFIG, cameras={"front": _camera()})
    for count, one in enumerate(arrivals, start=1):
        tracker.push(one)
        known = _run(sorted(arrivals[:count], key=lambda each: each.stamp_ns))
        newest = max(each.stamp_ns for each in arrivals[:count])
        _assert_same([tracker.tracks(newest)], [known.tracks(newest)])


def test_what_is_later_than_the_window_changes_nothing_and_is_counted() -> None:
    drive = _drive(6)
    plain, disturbed = _run(drive), Tracker(_CONFIG, cameras={"front": _camera()})
    for one in drive:
        disturbed.push(one)
        disturbed.push(_scan(np.random.default_rng(7), one.stamp_ns // _MS - _WINDOW_MS - 1, "a"))
    assert sum(disturbed.dropped.values()) == len(drive)
    assert list(disturbed.dropped) == ["measurements later than the rollback window"]
    stamps = sorted({one.stamp_ns for one in drive})
    _assert_same([disturbed.tracks(s) for s in stamps], [plain.tracks(s) for s in stamps])


def test_a_measurement_at_the_edge_of_the_window_still_counts() -> None:
    rng = np.random.default_rng(8)
    first, late = _scan(rng, 1000, "left"), _scan(rng, 1000 - _WINDOW_MS, "left")
    tracker = _run([first, late])
    assert not tracker.dropped
    assert len(tracker.tracks(late.stamp_ns)) == len([s for s in late.confidences if s >= 0.3])


@pytest.mark.parametrize("swap", [False, True])
def test_equal_stamps_of_one_sensor_are_ordered_by_what_they_hold(swap: bool) -> None:  # noqa: FBT001
    rng = np.random.default_rng(9)
    pair: list[Pushed] = [_scan(rng, 0, "left"), _scan(rng, 0, "left")]
    tracks = _run(pair[::-1] if swap else pair).tracks(0)
    _assert_same([tracks], [_run(pair).tracks(0)])
