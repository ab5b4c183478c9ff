"""Which streams tell of the vehicle's motion, which of them gives its poses, gaps and jumps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.clock import NS_PER_MS, NS_PER_S
from percept.core.errors import (
    GeometryError,
    InputError,
    InsufficientDataError,
    TopicNotFoundError,
    UsageError,
)
from percept.core.geodesy import LocalFrame
from percept.core.navigation import NavigationTopics
from percept.core.results import Verdict
from percept.core.rig import Rig
from percept.core.samples import (
    GnssFix,
    ImuSample,
    OdometrySample,
    PoseSample,
    Sample,
    TransformSample,
)
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets import open_recording
from percept.datasets.navigation_topics import choose_navigation
from percept.datasets.recording import Recording
from percept.datasets.write import LogWriter
from percept.odometry import Jump, poses_from_samples
from percept.odometry.health import breaks_of, find_gaps, find_jumps

_START_NS = 1_760_000_000 * NS_PER_S
_STEP_NS = 20 * NS_PER_MS

Log = Callable[..., Recording]


@pytest.fixture
def log(tmp_path: Path) -> Iterator[Log]:
    """Writes samples into a log and opens it."""
    opened: list[Recording] = []

    def make(*samples: Sample) -> Recording:
        path = tmp_path / "log.mcap"
        with LogWriter(path, "mcap") as writer:
            for sample in samples:
                writer.write(sample)
        opened.append(open_recording(path))
        return opened[-1]

    yield make
    for recording in opened:
        recording.close()


def _at(n: int) -> dict[str, Any]:
    return {"stamp_ns": _START_NS + n * _STEP_NS, "log_time_ns": _START_NS + n * _STEP_NS}


def _placed(
    target: str, source: str, x: float = 0.0, y: float = 0.0, yaw: float = 0.0
) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(0.0, 0.0, yaw)
    matrix[:2, 3] = x, y
    return Transform(target, source, matrix)


def _odometry(n: int, x: float, child: str = "base_link", y: float = 0.0) -> OdometrySample:
    return OdometrySample(
        topic="/odom",
        frame="odom",
        T_frame_child=_placed("odom", child, x, y),
        linear_velocity_mps=np.zeros(3),
        angular_velocity_radps=np.zeros(3),
        **_at(n),
    )


def _edge(n: int, T: Transform, *, static: bool = False) -> TransformSample:
    topic = "/tf_static" if static else "/tf"
    return TransformSample(topic=topic, frame=T.target, T_frame_child=T, static=static, **_at(n))


def _imu(n: int, force: float = 9.81) -> ImuSample:
    return ImuSample(
        topic="/imu",
        frame="imu",
        angular_velocity_radps=np.zeros(3),
        linear_acceleration_mps2=np.array([0.0, 0.0, force]),
        **_at(n),
    )


def _fix(n: int, east_m: float = 0.0, sd_m: float = 0.1, **fields: int) -> GnssFix:
    latitude, longitude, altitude = LocalFrame(45.0, 9.0, 100.0).geodetic(
        np.array([east_m, 0.0, 0.0])
    )
    return GnssFix(
        topic="/fix",
        frame="gnss",
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_m=altitude,
        covariance_m2=np.eye(3) * sd_m**2,
        **_at(n),
        **fields,
    )


def _pose(n: int, topic: str = "/pose") -> PoseSample:
    return PoseSample(topic=topic, frame="map", T_frame_child=_placed("map", "", 0.1 * n), **_at(n))


# Topics -------------------------------------------------------------------------------------------


def test_topics_and_places_of_a_full_log(log: Log) -> None:
    recording = log(
        _edge(0, _placed("base_link", "imu", 0.4), static=True),
        _edge(0, _placed("base_link", "gnss", 0.3), static=True),
        _edge(0, _placed("odom", "base_link")),
        _edge(1, _placed("odom", "base_link", 0.1)),
        _odometry(0, 0.0),
        _imu(0),
        _fix(0),
        _pose(0),
        _pose(1),
        _pose(0, "/other"),
    )
    topics = choose_navigation(recording, None)
    assert topics.names() == ("/fix", "/imu", "/odom", "/pose", "/tf")
    assert topics.tf_edge == ("odom", "base_link")
    assert topics.T_base_imu is not None
    assert topics.T_base_imu.translation_m[0] == pytest.approx(0.4)
    assert topics.T_base_gnss is not None
    assert topics.T_base_gnss.translation_m[0] == pytest.approx(0.3)
    assert any("/other" in note and "left alone" in note for note in topics.notes)
    assert any("'/pose' does not say which frame" in note for note in topics.notes)


def test_a_place_that_is_not_known_is_noted(log: Log) -> None:
    topics = choose_navigation(log(_fix(0)), Rig("car", {}))
    assert topics.base_frame == "car"
    assert topics.T_base_gnss is None
    assert any("no transform leads from 'car' to frame 'gnss'" in note for note in topics.notes)


def test_only_what_was_asked_for_is_used(log: Log) -> None:
    recording = log(_odometry(0, 0.0), _imu(0), _pose(0))
    assert choose_navigation(recording, None, {"pose": "/pose"}).names() == ("/pose",)
    with pytest.raises(TopicNotFoundError, match="For pose: /pose"):
        choose_navigation(recording, None, {"pose": "/nowhere"})
    with pytest.raises(InputError, match="which is no pose"):
        choose_navigation(recording, None, {"pose": "/imu"})
    with pytest.raises(UsageError, match="gnss, imu, odometry, pose, tf"):
        choose_navigation(recording, None, {"poses": "/pose"})


def test_the_lowest_edge_that_moves_carries_the_vehicle(log: Log) -> None:
    recording = log(
        _edge(0, _placed("base_footprint", "base_link", 0.5), static=True),
        *(_edge(n, _placed("map", "odom", 0.01 * n)) for n in range(3)),
        *(_edge(n, _placed("odom", "lift", 0.1 * n)) for n in range(3)),
        *(_edge(n, _placed("lift", "base_footprint", 2.0)) for n in range(3)),
    )
    topics = choose_navigation(recording, None)
    assert topics.tf_edge == ("odom", "lift")
    assert topics.T_base_tf is not None
    assert topics.T_base_tf.translation_m[0] == pytest.approx(-2.5)


def test_transforms_of_other_things_carry_nothing(log: Log) -> None:
    topics = choose_navigation(log(_edge(0, _placed("world", "turtle"))), None)
    assert topics.tf is None
    assert topics.notes == ("no moving transform of '/tf' carries frame 'base_link'",)


# Sources ------------------------------------------------------------------------------------------

_ODOMETRY = NavigationTopics(odometry="/odom")
_ALL = NavigationTopics(odometry="/odom", pose="/pose", gnss="/fix", imu="/imu")


def test_odometry_of_another_frame_is_carried_to_the_base() -> None:
    topics = replace(_ODOMETRY, T_base_odometry=_placed("base_link", "wheel", 0.5, yaw=np.pi / 2))
    samples = [_odometry(n, 1.0 + n, "wheel") for n in range(20)]
    poses = poses_from_samples(topics, samples)
    # The wheel frame looks to the left of the base: the base is 0.5 behind it, to its right.
    assert poses.trajectory.matrices[0, :2, 3] == pytest.approx([1.0, 0.5])
    assert poses.trajectory.target == "odom"
    assert poses.source == "odometry"
    assert np.isnan(poses.sd_position_m).all()


def test_a_jump_of_the_odometry_is_found_named_and_not_bridged() -> None:
    samples = [_odometry(n, 0.16 * n, y=0.4 if n >= 60 else 0.0) for n in range(120)]
    poses = poses_from_samples(_ODOMETRY, samples)
    (jump,) = poses.jumps
    assert jump.start_ns == samples[59].stamp_ns
    assert jump.end_ns == samples[60].stamp_ns
    assert jump.moved_m == pytest.approx(0.4, abs=0.01)
    assert poses.verdict is Verdict.DOUBTFUL
    assert poses.why == ("jumps: 1, the largest of 0.40 m 1.20 s after the first pose",)
    assert poses.at(jump.start_ns + _STEP_NS // 2) is None
    assert poses.at(jump.start_ns) is not None
    assert len(poses.segments()) == 2


def test_braking_and_turning_are_no_jumps() -> None:
    time_s = np.arange(0, 20, 0.05)
    speed = np.clip(15 - 8 * np.clip(time_s - 5, 0, None), 0, None)
    yaw = 0.8 * np.sin(time_s)
    way = np.cumsum(speed * 0.05)
    matrices = np.stack([_placed("a", "b", x, 0, a).matrix for x, a in zip(way, yaw, strict=True)])
    stamps = _START_NS + np.arange(len(way)) * 50 * NS_PER_MS
    assert find_jumps(stamps, matrices, find_gaps(stamps)) == ()


def test_a_turn_on_the_spot_is_a_jump() -> None:
    yaw = np.where(np.arange(100) < 50, 0.0, 0.2)
    matrices = np.stack([_placed("a", "b", 0, 0, angle).matrix for angle in yaw])
    stamps = _START_NS + np.arange(100) * _STEP_NS
    (jump,) = find_jumps(stamps, matrices, find_gaps(stamps))
    assert jump.turned_rad == pytest.approx(0.2, abs=1e-6)


def test_gaps_are_long_against_the_stream() -> None:
    stamps = _START_NS + np.array([0, 20, 40, 60, 80, 100, 250, 270, 290]) * NS_PER_MS
    assert find_gaps(stamps).tolist() == [[stamps[5], stamps[6]]]
    assert find_gaps(stamps[:1]).shape == (0, 2)


def test_gaps_that_overlap_become_one() -> None:
    breaks = breaks_of(np.array([[10, 20], [40, 50]]), [Jump(15, 30, 1.0, 0.0)])
    assert breaks.tolist() == [[10, 30], [40, 50]]


def test_repeated_and_unset_stamps_are_counted() -> None:
    samples = [_odometry(n, 0.1 * n) for n in range(10)]
    unset = replace(samples[0], stamp_ns=0)
    poses = poses_from_samples(_ODOMETRY, [*reversed(samples), samples[3], unset])
    assert len(poses.trajectory) == 10
    assert poses.dropped == {
        "odometry with the stamp of another": 1,
        "odometry without a stamp": 1,
    }


def test_poor_fixes_give_way_to_odometry() -> None:
    samples: list[Sample] = [_odometry(n, 0.1 * n) for n in range(300)]
    samples += [_imu(n) for n in range(300)] + [_fix(n, 0.1 * n, 4.0) for n in range(0, 300, 10)]
    poses = poses_from_samples(_ALL, samples, origin=LocalFrame(45, 9, 100))
    assert poses.source == "odometry"
    assert "GNSS is poor here: the median fix is good to 4.0 m only" in poses.notes
    assert any("no place on earth" in note for note in poses.notes)


def test_what_cannot_be_used_is_said_and_the_next_source_taken() -> None:
    samples: list[Sample] = [_pose(n) for n in range(300)]
    samples += [_imu(n, 1.0) for n in range(300)] + [_fix(n, 0.1 * n) for n in range(0, 300, 10)]
    poses = poses_from_samples(_ALL, samples)
    assert poses.source == "pose"
    assert any("not from gnss+imu" in n and "not about 9.8" in n for n in poses.notes)
    with pytest.raises(InputError, match="gravity included"):
        poses_from_samples(_ALL, samples, prefer="gnss+imu")


def test_fixes_that_are_none_are_counted() -> None:
    fixes = [_fix(n, 0.2 * n) for n in range(0, 300, 10)]
    bad = [_fix(301, status=-1), replace(fixes[0], latitude_deg=float("nan"), **_at(302))]
    nowhere = replace(fixes[0], latitude_deg=0.0, longitude_deg=0.0, **_at(303))
    poses = poses_from_samples(_ALL, [*fixes, *bad, nowhere])
    assert poses.source == "gnss"
    assert poses.dropped == {
        "GNSS messages without a fix": 2,
        "GNSS fixes that are no place on earth": 1,
    }
    assert poses.trajectory.target == "enu"
    assert poses.origin is not None
    assert poses.origin.latitude_deg == pytest.approx(45.0)


def test_the_map_of_another_place_is_refused() -> None:
    fixes = [_fix(n, 0.2 * n) for n in range(0, 300, 10)]
    with pytest.raises(InputError, match="km from the fixes"):
        poses_from_samples(_ALL, fixes, prefer="gnss", origin=LocalFrame(48.0, 9.0, 0.0))


def test_a_vehicle_that_stands_without_orientation_has_no_heading() -> None:
    samples: list[Sample] = [_imu(n) for n in range(500)]
    samples += [_fix(n) for n in range(0, 500, 10)]
    with pytest.raises(InsufficientDataError, match="the vehicle never moves"):
        poses_from_samples(_ALL, samples)


def test_a_log_without_motion_says_so() -> None:
    with pytest.raises(InsufficientDataError, match="nothing in the log tells"):
        poses_from_samples(NavigationTopics(), [])


@pytest.mark.parametrize(
    ("name", "source", "frames", "count", "gaps"),
    [
        ("evo/nav2_turtlebot.mcap", "odometry", ("odom", "base_link"), 2639, 1),
        ("evo/ROS_example.bag", "pose", ("groundtruth", "base_link"), 12765, 87),
        ("embag/test.bag", "odometry", ("odom", "base_link"), 5, 0),
    ],
)
def test_real_logs(
    shared_data: Path, name: str, source: str, frames: tuple[str, str], count: int, gaps: int
) -> None:
    with open_recording(shared_data / "bags" / name) as recording:
        topics = choose_navigation(recording, None)
        poses = poses_from_samples(topics, recording.samples(topics=topics.names()))
    assert poses.source == source
    assert (poses.trajectory.target, poses.trajectory.source) == frames
    assert len(poses.trajectory) == count
    assert len(poses.gaps_ns) == gaps
    assert poses.jumps == ()


# Trajectories with gaps ---------------------------------------------------------------------------


def _trajectory(gaps: NDArray[np.int64]) -> Trajectory:
    matrices = np.stack([_placed("a", "b", n, 0, 0.3 * n).matrix for n in range(5)])
    return Trajectory("a", "b", np.arange(5) * 100, matrices, gaps)


def test_nothing_is_interpolated_over_a_gap() -> None:
    trajectory = _trajectory(np.array([[100, 200], [200, 300]]))
    stamps = np.array([-1, 0, 50, 100, 101, 199, 200, 250, 300, 350, 400, 401])
    known = [False, True, True, True, False, False, True, False, True, True, True, False]
    assert trajectory.covers(stamps).tolist() == known
    matrices, valid = trajectory.poses_at(stamps)
    assert valid.tolist() == known
    for stamp, matrix, is_known in zip(stamps.tolist(), matrices, known, strict=True):
        pose = trajectory.at(stamp)
        assert (pose is not None) == is_known
        expected = np.eye(4) if pose is None else pose.matrix
        assert matrix == pytest.approx(expected, abs=1e-12)


def test_gaps_that_do_not_rise_are_refused() -> None:
    with pytest.raises(GeometryError, match="gaps of a trajectory"):
        _trajectory(np.array([[200, 100]]))
