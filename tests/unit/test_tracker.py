"""The tracker as others use it: frames, times, sensors, classes, histories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from percept.core.results import Detections2D, Detections3D, Tracks
from percept.core.rig import CameraSensor
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform, rotation_from_rpy
from percept.tracking import Tracker, TrackerConfig
from percept.tracking.common_motion import common_motion
from percept.tracking.history import TrackHistory
from percept.tracking.motion import motion_model
from percept.tracking.track_table import empty_table

_F64 = NDArray[np.float64]
_S = 10**9


def _scan(
    stamp_ns: int, boxes: object, labels: tuple[str, ...], *, frame: str = "base",
    sensor: str = "top", score: float = 0.9,
) -> Detections3D:  # fmt: skip
    array = np.asarray(boxes, dtype=np.float64).reshape(-1, 7)
    return Detections3D(stamp_ns, sensor, frame, array, labels, np.full(len(array), score))


def _car(x: float, y: float, yaw: float = 0.0) -> list[float]:
    return [x, y, 0.8, 4.2, 1.8, 1.5, yaw]


def _poses(path: Callable[[float], tuple[float, float, float]], seconds: float) -> Trajectory:
    """Poses of a vehicle that is at path(t) = x, y, yaw."""
    stamps = np.arange(0, round(seconds * 100) + 1) * 10_000_000
    matrices = np.tile(np.eye(4), (len(stamps), 1, 1))
    for matrix, stamp in zip(matrices, stamps, strict=True):
        x, y, yaw = path(stamp / _S)
        matrix[:3, :3], matrix[:2, 3] = rotation_from_rpy(0, 0, yaw), [x, y]
    return Trajectory("map", "base", stamps, matrices)


def _seen_from(trajectory: Trajectory, stamp_ns: int, box_map: list[float]) -> _F64:
    pose = trajectory.at(stamp_ns)
    assert pose is not None
    box = np.array(box_map)
    box[:3] = pose.inverse().apply(box[None, :3])[0]
    box[6] -= np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])
    return box


def _drive(poses: Trajectory, tracker: Tracker, seconds: float) -> Tracks:
    """One parked car and one that drives 5 m/s along y, seen from a moving vehicle."""
    stamp_ns = 0
    for k in range(round(seconds * 10) + 1):
        stamp_ns = k * _S // 10
        boxes = [
            _seen_from(poses, stamp_ns, _car(30.0, 6.0, 0.2)),
            _seen_from(poses, stamp_ns, _car(40.0, -10.0 + 0.5 * k, np.pi / 2)),
        ]
        tracker.push(_scan(stamp_ns, boxes, ("car", "car")))
    return tracker.tracks(stamp_ns)


def test_with_poses_velocities_are_over_the_ground() -> None:
    poses = _poses(lambda t: (8 * t, np.sin(t), 0.3 * t), 3.0)
    tracker = Tracker(poses=poses)
    tracks = _drive(poses, tracker, 3.0)
    assert (tracker.frame_id, tracks.frame_id) == ("map", "map")
    assert_allclose(tracks.velocities_mps, [[0, 0], [0, 5]], atol=0.05)
    assert_allclose(tracks.boxes_m[0], _car(30.0, 6.0, 0.2), atol=0.05)
    assert_allclose(tracks.boxes_m[1, [0, 1, 6]], [40.0, 5.0, np.pi / 2], atol=0.05)


@pytest.mark.parametrize("with_poses", [True, False])
def test_boxes_that_were_measured_at_another_time_than_the_scan(*, with_poses: bool) -> None:
    # The vehicle drives 10 m/s; each box is measured 50 ms before or after the stamp.
    poses = _poses(lambda t: (10 * t, 0.0, 0.0), 3.2)
    tracker = Tracker(poses=poses if with_poses else None)
    for k in range(1, 31):
        stamp_ns = k * _S // 10
        offsets = np.array([50_000_000, -50_000_000])
        parked = _seen_from(poses, stamp_ns + int(offsets[0]), _car(50.0, 6.0))
        y_m = -10.0 + 5.0 * (stamp_ns + int(offsets[1])) / _S
        driving = _seen_from(poses, stamp_ns + int(offsets[1]), _car(40.0, y_m, np.pi / 2))
        scan = _scan(stamp_ns, [parked, driving], ("car", "car"))
        tracker.push(replace(scan, offsets_ns=offsets))
    tracks = tracker.tracks(3 * _S)
    moved = 0.0 if with_poses else 30.0
    assert_allclose(tracks.boxes_m[:, 0], [50.0 - moved, 40.0 - moved], atol=0.03)
    assert_allclose(tracks.boxes_m[:, 1], [6.0, 5.0], atol=0.03)


def test_without_poses_the_frame_of_the_detections_is_the_frame() -> None:
    poses = _poses(lambda t: (8 * t, 0.0, 0.0), 3.0)
    tracks = _drive(poses, Tracker(), 3.0)
    assert tracks.frame_id == "base"
    assert_allclose(tracks.velocities_mps, [[-8, 0], [-8, 5]], atol=0.05)


def test_without_poses_a_new_track_has_the_velocity_that_the_others_share() -> None:
    still = np.array([_car(x, y) for x in (10.0, 20.0, 30.0) for y in (-6.0, 6.0)])
    tracker = Tracker()
    for k in range(6):
        boxes = still - np.array([0.8 * k, 0, 0, 0, 0, 0, 0])
        extra = [_car(50.0, 0.0)] if k == 5 else []
        boxes = np.vstack([boxes, *extra])
        tracker.push(_scan(k * _S // 10, boxes, ("car",) * len(boxes)))
    tracks = tracker.tracks(5 * _S // 10)
    assert tracks.states[-1] == "trial"
    assert_allclose(tracks.velocities_mps[-1], [-8.0, 0.0], atol=0.3)


def test_the_common_motion_is_that_of_the_majority() -> None:
    # Seen from a vehicle with 10 m/s that turns with 0.2 rad/s; one of five drives by itself.
    places = np.array([[10.0, 5], [20, -5], [30, 5], [15, -8], [25, 2]])
    tracks = empty_table(1, 5)
    tracks["state"][:, :2] = places
    tracks["state"][:, 3] = -10 + 0.2 * places[:, 1]
    tracks["state"][:, 4] = -0.2 * places[:, 0]
    tracks["state"][4, 3:5] += [25.0, 3.0]
    tracks["covariance"][:] = np.eye(6) * 0.1
    scene = common_motion(tracks)
    assert_allclose(scene.mean[:2], [-10, 0], atol=0.5)
    assert scene.mean[2] == pytest.approx(-0.2, abs=0.03)
    velocity, spread = scene.at(np.array([[0.0, 10.0]]))
    assert_allclose(velocity, [[-8.0, 0.0]], atol=0.6)
    assert np.linalg.eigvalsh(spread[0]).min() > 0


def test_nothing_is_known_of_the_common_motion_without_tracks() -> None:
    velocity, spread = common_motion(empty_table(1)).at(np.zeros((1, 2)))
    assert_allclose(velocity, 0.0)
    assert_allclose(spread[0], np.diag([100.0, 100.0]))


def test_detections_without_a_pose_are_dropped_and_named() -> None:
    tracker = Tracker(poses=_poses(lambda _: (0.0, 0.0, 0.0), 1.0))
    tracker.push(_scan(2 * _S, [_car(10, 0)], ("car",)))
    tracker.push(_scan(0, [_car(10, 0)], ("car",), frame="lidar_left"))
    tracker.push(_scan(0, [_car(10, 0)], ("car",), frame="map"))
    assert dict(tracker.dropped) == {
        "scans at times without a pose": 1,
        "scans in 'lidar_left', a frame without poses": 1,
    }
    assert len(tracker.tracks(0)) == 1


def test_boxes_that_cannot_be_tracked_are_dropped_and_named() -> None:
    tracker = Tracker()
    bad = _car(np.nan, 0)
    tracker.push(_scan(0, [_car(9, 0), bad, _car(20, 0)], ("car", "car", "traffic light")))
    assert dict(tracker.dropped) == {
        "boxes labelled 'traffic light', which is no class of tracks": 1,
        "boxes that are not finite": 1,
    }
    assert len(tracker.tracks(0)) == 1


def test_there_is_nothing_before_the_first_measurement() -> None:
    tracker = Tracker()
    assert len(tracker.tracks(0)) == 0
    assert tracker.histories() == []
    tracker.push(_scan(_S, [_car(10, 0)], ("car",)))
    assert len(tracker.tracks(_S - 1)) == 0
    assert len(tracker.tracks(_S)) == 1


def test_tracks_between_scans_are_predicted_from_the_past_alone() -> None:
    tracker = Tracker()
    for k in range(11):
        tracker.push(_scan(k * _S // 10, [_car(10 + k, 0)], ("car",)))
    between = tracker.tracks(_S // 2 + _S // 20)
    assert not between.observed[0]
    assert between.boxes_m[0, 0] == pytest.approx(15.5, abs=0.1)
    older = Tracker()
    for k in range(6):
        older.push(_scan(k * _S // 10, [_car(10 + k, 0)], ("car",)))
    assert_allclose(between.boxes_m, older.tracks(_S // 2 + _S // 20).boxes_m, atol=1e-12)


def test_the_uncertainty_grows_while_nothing_is_seen() -> None:
    tracker = Tracker()
    for k in range(5):
        tracker.push(_scan(k * _S // 10, [_car(10 + k, 0)], ("car",)))
    sd = [tracker.tracks(4 * _S // 10 + t).position_sd_m[0] for t in (0, _S // 4, _S // 2)]
    assert 0.05 < sd[0] < sd[1] < sd[2] < 3.0


def test_a_class_may_change_and_its_identity_stays() -> None:
    tracker = Tracker()
    words = ["pedestrian"] * 2 + ["cyclist"] * 8
    for k, word in enumerate(words):
        box = [10 + 0.4 * k, 0.0, 0.9, 1.7, 0.6, 1.7, 0.0]
        tracker.push(_scan(k * _S // 10, [box], (word,), score=0.8))
    first, last = tracker.tracks(0), tracker.tracks(9 * _S // 10)
    assert (first.labels, last.labels) == (("pedestrian",), ("cyclist",))
    assert first.ids.tolist() == last.ids.tolist()
    assert last.label_probabilities[0] > 0.9


def _camera(place: bool = True) -> CameraSensor:  # noqa: FBT001, FBT002
    matrix = np.eye(4)  # looks along x from 1.5 m above the ground
    matrix[:3, :3] = rotation_from_rpy(-np.pi / 2, 0.0, -np.pi / 2)
    matrix[:3, 3] = [0.0, 0.0, 1.5]
    return CameraSensor(
        "front", None, "front", (640, 480), "pinhole", (400.0, 400.0, 320.0, 240.0), (0.0,) * 5,
        Transform("base", "front", matrix) if place else None,
    )  # fmt: skip


def _image_of(x: float, y: float, word: str, stamp_ns: int) -> Detections2D:
    """A box of 0.6 x 1.8 m that stands on the ground at x, y in front of the camera."""
    u, v = 320 - 400 * y / x, 240 - 400 * (0.9 - 1.5) / x
    half = np.array([0.3, 0.9]) * 400 / x
    box = np.array([[u - half[0], v - half[1], u + half[0], v + half[1]]])
    return Detections2D(stamp_ns, "front", box, (word,), np.array([0.9]))


def _with_images(poses: Trajectory | None) -> tuple[Tracker, Tracks, Tracks]:
    """An unknown object at x = 15 m, y = 2 m of the map that images call a person."""
    tracker = Tracker(poses=poses, cameras={"front": _camera()})
    plain = Tracker(poses=poses)
    for k in range(5):
        stamp_ns = k * _S // 10
        box = np.array([15.0, 2.0, 0.9, 0.6, 0.6, 1.8, 0.0])
        if poses is not None:
            box = _seen_from(poses, stamp_ns, box.tolist())
        for one in (tracker, plain):
            one.push(_scan(stamp_ns, [box], ("unknown",)))
        tracker.push(_image_of(float(box[0]), float(box[1]), "person", stamp_ns))
    return tracker, tracker.tracks(4 * _S // 10), plain.tracks(4 * _S // 10)


@pytest.mark.parametrize("moving", [False, True])
def test_images_speak_about_the_class_and_nothing_else(moving: bool) -> None:  # noqa: FBT001
    poses = _poses(lambda t: (4 * t, 0.0, 0.0), 1.0) if moving else None
    tracker, tracks, plain = _with_images(poses)
    assert (plain.labels, tracks.labels) == (("unknown",), ("pedestrian",))
    assert not tracker.dropped
    assert_allclose(tracks.boxes_m, plain.boxes_m, atol=0.02)


def test_images_that_cannot_be_placed_are_dropped_and_named() -> None:
    tracker = Tracker(
        poses=_poses(lambda _: (0.0, 0.0, 0.0), 1.0),
        cameras={"front": _camera(), "rear": _camera(place=False)},
    )
    tracker.push(_image_of(10, 0, "person", 2 * _S))
    lost = _image_of(10, 0, "person", 0)
    for name in ("rear", "side"):
        tracker.push(Detections2D(0, name, lost.boxes_px, lost.labels, lost.confidences))
    tracker.push(_image_of(10, 0, "traffic light", 0))
    assert dict(tracker.dropped) == {
        "images at times without a pose": 1,
        "images of 'rear', a camera without a place": 1,
        "images of 'side', a camera without a place": 1,
        "boxes labelled 'traffic light', which is no class of tracks": 1,
    }


def _history() -> tuple[Tracker, TrackHistory]:
    tracker = Tracker()
    for k in range(30):
        seen = k < 10 and k != 4
        boxes = [_car(10 + k, 0)] if seen else []
        tracker.push(_scan(k * _S // 10, boxes, ("car",) * len(boxes), score=0.5 + 0.05 * k))
    (history,) = tracker.histories()
    return tracker, history


def test_a_history_has_each_scan_from_birth_to_end() -> None:
    tracker, history = _history()
    assert (history.track_id, history.motion) == (0, "turn")
    assert len(history) == 20  # nine steps after the last detection it was given up
    assert history.stamps_ns.tolist() == [k * _S // 10 for k in range(20)]
    assert history.observed.tolist() == [k < 10 and k != 4 for k in range(20)]
    assert history.full.tolist() == [k > 0 for k in range(20)]
    assert history.states.shape == (20, 6)
    assert history.class_probabilities.shape == (20, len(tracker.classes))
    assert history.scores[1] == pytest.approx(0.525)


def test_a_history_keeps_what_was_measured() -> None:
    _, history = _history()
    assert_allclose(history.measured[9], _car(19, 0))
    assert history.variances_m2[9, 0] == pytest.approx(0.25**2 + (0.005 * 19) ** 2)
    missing = np.isnan(history.measured).all(axis=1)
    assert missing.tolist() == (~history.observed).tolist()


def test_a_history_says_what_was_answered() -> None:
    tracker, history = _history()
    for k in (0, 5, 12):
        tracks = tracker.tracks(int(history.stamps_ns[k]))
        assert_allclose(tracks.boxes_m[0, :3], history.states[k, :3])
        assert_allclose(tracks.boxes_m[0, 3:], history.shapes[k])
        assert_allclose(tracks.velocities_mps[0], history.states[k, 3:5])


def test_settings_without_poses_allow_for_the_vehicle() -> None:
    config = TrackerConfig(vehicle_walk_mps=3.0)
    walk = config.classes["pedestrian"].velocity_walk_mps
    assert Tracker(config).config.classes["pedestrian"].velocity_walk_mps == np.hypot(walk, 3.0)
    assert Tracker(config, poses=_poses(lambda _: (0, 0, 0), 1.0)).config is config


@pytest.mark.parametrize(("word", "motion"), [("car", "turn"), ("pedestrian", "velocity")])
def test_a_step_without_a_detection_is_the_prediction_of_the_model(word: str, motion: str) -> None:
    config = TrackerConfig()
    tracker = Tracker(config, poses=_poses(lambda _: (0.0, 0.0, 0.0), 2.0))
    for k in range(12):
        boxes = [_car(10 + 0.1 * k, 0.02 * k**2)] if k < 8 else []
        tracker.push(_scan(k * _S // 10, boxes, (word,) * len(boxes), frame="map"))
    (history,) = tracker.histories()
    model = motion_model(history.motion, config.classes[word])
    assert history.motion == motion
    for k in range(8, 12):
        states, covariances, _ = model.predict(
            history.states[[k - 1]], history.covariances[[k - 1]], np.array([0.1])
        )
        assert_allclose(history.states[k], states[0], atol=1e-9)
        assert_allclose(history.covariances[k], covariances[0], atol=1e-9)


def test_slow_scans_find_a_fast_car_again() -> None:
    poses = _poses(lambda _: (0.0, 0.0, 0.0), 4.0)
    tracker = Tracker(poses=poses)
    for k in range(4):  # 7.5 m from scan to scan
        tracker.push(_scan(k * _S // 2, [_car(7.5 * k, 0)], ("car",), frame="map"))
    tracks = tracker.tracks(3 * _S // 2)
    assert tracks.ids.tolist() == [0]
    assert_allclose(tracks.velocities_mps, [[15.0, 0.0]], atol=0.3)


def test_the_tracker_says_what_it_assumes_without_poses() -> None:
    assert "without poses" in " ".join(Tracker().notes)
    assert Tracker(poses=_poses(lambda _: (0.0, 0.0, 0.0), 1.0)).notes == ()
