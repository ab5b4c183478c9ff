"""Poses from GNSS and IMU against the exact motion of synthetic drives, and of a real one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline
from scipy.stats import chi2
from town_motion import TownMotion

from percept.core.clock import NS_PER_S
from percept.core.navigation import NavigationTopics
from percept.core.results import Verdict
from percept.core.samples import GnssFix, ImuSample, Sample
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.synthetic.drive import MAP_ORIGIN, START_NS
from percept.datasets.synthetic.ego import EgoMotion, Motion
from percept.datasets.synthetic.navigation import (
    GNSS_TOPIC,
    IMU_TOPIC,
    ODOMETRY_TOPIC,
    Navigation,
)
from percept.datasets.synthetic.sensor_rig import T_BASE_GNSS, T_BASE_IMU
from percept.datasets.synthetic.world import World
from percept.odometry import FilterConfig, PoseSource, VehiclePoses, poses_from_samples
from percept.odometry.alignment import find_start
from percept.odometry.filter import make_drive, smooth
from percept.odometry.fixes import local_fixes
from percept.odometry.imu import read_imu
from percept.odometry.readings import collect_readings

_F = NDArray[np.float64]

TOPICS = NavigationTopics(
    gnss=GNSS_TOPIC, imu=IMU_TOPIC, T_base_gnss=T_BASE_GNSS, T_base_imu=T_BASE_IMU
)
# The synthetic IMU's own figures, for the strict test of the spread.
_MATCHED = FilterConfig(
    gyro_bias_sd_radps=0.001,
    force_bias_sd_mps2=0.02,
    gyro_bias_walk=1e-7,
    force_bias_walk=1e-6,
    lateral_sd_mps=None,
)


@cache
def _samples(motion: Motion, seed: int, noise: float, seconds: int) -> tuple[Sample, ...]:
    """Return GNSS and IMU samples; the IMU tells no orientation."""
    navigation = Navigation(motion, MAP_ORIGIN, seed, noise)
    duration_ns = seconds * NS_PER_S
    imu = (s for s in navigation.imu(duration_ns) if isinstance(s, ImuSample))
    return (*(replace(s, quat_xyzw=None) for s in imu), *navigation.gnss(duration_ns))


@cache
def _street(seed: int) -> Motion:
    return EgoMotion(World.from_seed(seed).profile, START_NS)


@cache
def _town(seed: int, speed_mps: float = 8.0) -> Motion:
    return TownMotion(World.from_seed(seed).profile, START_NS, speed_mps=speed_mps)


def _seconds(sample: Sample) -> float:
    return (sample.stamp_ns - START_NS) / NS_PER_S


def _changed(samples: tuple[Sample, ...], change: Callable[[GnssFix], GnssFix]) -> list[Sample]:
    return [change(s) if isinstance(s, GnssFix) else s for s in samples]


def _moved(fix: GnssFix, by_m: _F) -> GnssFix:
    place = np.array([[fix.latitude_deg, fix.longitude_deg, fix.altitude_m]])
    latitude, longitude, altitude = MAP_ORIGIN.geodetic(MAP_ORIGIN.local(place)[0] + by_m)
    return replace(fix, latitude_deg=latitude, longitude_deg=longitude, altitude_m=altitude)


def _coarse(samples: tuple[Sample, ...], sd_m: float, seed: int) -> list[Sample]:
    """Return the samples with one fix a second that is as good as it says."""
    rng = np.random.default_rng(seed)
    sd = sd_m * np.array([1.0, 1.0, 2.0])
    kept = [s for s in samples if isinstance(s, ImuSample) or s.stamp_ns % NS_PER_S == 0]
    return _changed(
        tuple(kept),
        lambda fix: replace(_moved(fix, sd * rng.standard_normal(3)), covariance_m2=np.diag(sd**2)),
    )


def _poses(samples: Iterable[Sample], source: PoseSource = "gnss+imu") -> VehiclePoses:
    return poses_from_samples(TOPICS, samples, origin=MAP_ORIGIN, prefer=source)


def _errors(poses: VehiclePoses, motion: Motion) -> tuple[_F, _F]:
    """Return the distance from the true position (N,) and the error of the heading (N,)."""
    truth = motion.poses(motion.seconds(poses.trajectory.stamps_ns))
    found = poses.trajectory.matrices
    turn = np.swapaxes(truth[:, :3, :3], 1, 2) @ found[:, :3, :3]
    off_m = np.linalg.norm(found[:, :3, 3] - truth[:, :3, 3], axis=1)
    return off_m, np.arctan2(turn[:, 1, 0], turn[:, 0, 0])


def _normalised(poses: VehiclePoses, motion: Motion) -> tuple[float, float]:
    """Return the mean squares of both errors over their expected squares: 1 where all is right."""
    off_m, turn = _errors(poses, motion)
    return (
        float(np.mean((off_m / poses.sd_position_m) ** 2)),
        float(np.mean((turn / poses.sd_heading_rad) ** 2)),
    )


def _bounds(dimensions: int, drives: int) -> tuple[float, float]:
    """Return the 95 % bounds of a mean of squared errors, one of each drive being independent."""
    low, high = chi2.ppf([0.025, 0.975], dimensions * drives) / drives
    return float(low), float(high)


def _squared_errors(seed: int) -> _F:
    """Return (2,) mean normalised squared errors of place (3), and of place and attitude (6)."""
    readings = collect_readings(TOPICS, _samples(_street(seed), seed, 1.0, 20))
    fixes, imu = local_fixes(readings, MAP_ORIGIN, _MATCHED), read_imu(readings, Counter())
    T_imu_base = T_BASE_IMU.inverse()
    antenna = T_imu_base.apply(T_BASE_GNSS.translation_m[None])[0]
    drive, stamps_ns = make_drive(imu, fixes, T_imu_base, antenna, _MATCHED)
    start = find_start(drive, T_imu_base, _MATCHED)
    found = smooth(drive, start.state, start.covariance)
    truth = _street(seed).poses(_street(seed).seconds(stamps_ns)) @ T_BASE_IMU.matrix
    R = np.swapaxes(found.states[:, 6:15].reshape(-1, 3, 3), 1, 2) @ truth[:, :3, :3]
    place = truth[:, :3, 3] - found.states[:, :3]
    error = np.concatenate([place, Rotation.from_matrix(R).as_rotvec()], axis=1)
    means = []
    for size in (3, 6):
        inverse = np.linalg.inv(found.covariances[:, :size, :size])
        means.append(np.einsum("ni,nij,nj->n", error[:, :size], inverse, error[:, :size]).mean())
    return np.array(means)


def test_errors_are_as_large_as_the_filter_says() -> None:
    seeds = range(8)
    place, pose = np.mean([_squared_errors(seed) for seed in seeds], axis=0)
    low, high = _bounds(3, len(seeds))
    assert low < place < high
    low, high = _bounds(6, len(seeds))
    assert low < pose < high


@pytest.mark.parametrize("seed", [0, 1])
def test_exact_readings_give_exact_poses(seed: int) -> None:
    poses = _poses(_samples(_street(seed), seed, 0.0, 20))
    off_m, turn = _errors(poses, _street(seed))
    assert off_m.max() < 0.01
    assert np.abs(turn).max() < np.radians(0.05)
    assert poses.verdict is Verdict.GOOD
    assert not poses.dropped
    assert poses.trajectory.target == "map"
    assert poses.origin == MAP_ORIGIN
    assert len(poses.trajectory) == pytest.approx(20 * 50, abs=2)


def test_coarse_fixes_in_town_forward_and_backward() -> None:
    results = []
    for seed, speed in ((0, 8.0), (1, 8.0), (2, -4.0), (3, -4.0)):
        motion = _town(seed, speed)
        poses = _poses(_coarse(_samples(motion, seed, 1.0, 80), 0.5, seed))
        results.append(_normalised(poses, motion))
        backwards = any("backwards" in note for note in poses.notes)
        assert backwards == (speed < 0)
    place, heading = np.mean(results, axis=0)
    assert _bounds(3, 4)[0] / 3 < place < _bounds(3, 4)[1] / 3
    assert _bounds(1, 4)[0] < heading < _bounds(1, 4)[1]


@pytest.mark.parametrize("seed", [0, 1])
def test_the_spread_grows_in_an_outage_and_covers_the_error(seed: int) -> None:
    motion = _town(seed)
    whole = _samples(motion, seed, 1.0, 80)
    cut = [s for s in whole if isinstance(s, ImuSample) or not 40 < _seconds(s) < 50]
    poses = _poses(cut)
    since_s = motion.seconds(poses.trajectory.stamps_ns)
    outside = (since_s > 20) & (since_s < 39)
    inside = (since_s > 43) & (since_s < 47)
    assert poses.sd_position_m[inside].min() > 3 * np.median(poses.sd_position_m[outside])
    off_m, turn = _errors(poses, motion)
    assert np.mean(off_m[inside] < 2 * poses.sd_position_m[inside]) >= 0.95
    assert np.abs(turn).max() < 3 * poses.sd_heading_rad.max()
    assert any("the longest of 10.0 s" in note for note in poses.notes)


def test_outliers_are_refused_and_counted() -> None:
    rng = np.random.default_rng(4)
    planted = 0

    def spoilt(fix: GnssFix) -> GnssFix:
        nonlocal planted
        if _seconds(fix) < 5 or rng.random() > 0.1:
            return fix
        planted += 1
        return _moved(fix, rng.choice([-1, 1], 3) * rng.uniform(1, 5, 3))

    motion = _town(0)
    poses = _poses(_changed(_samples(motion, 0, 1.0, 80), spoilt))
    off_m, _ = _errors(poses, motion)
    assert off_m.max() < 0.03
    assert planted <= poses.dropped["GNSS fixes refused as outliers"] <= planted + 3
    assert poses.verdict is Verdict.DOUBTFUL
    assert any("contradict the IMU" in reason for reason in poses.why)


def test_a_lasting_contradiction_is_a_jump_without_poses() -> None:
    def shifted(fix: GnssFix) -> GnssFix:
        return _moved(fix, np.array([0.0, 8.0, 0.0])) if _seconds(fix) > 40 else fix

    poses = _poses(_changed(_samples(_town(0), 0, 1.0, 80), shifted))
    (jump,) = poses.jumps
    assert jump.start_ns == pytest.approx(START_NS + 40 * NS_PER_S, abs=NS_PER_S)
    assert jump.moved_m == pytest.approx(8.0, abs=0.5)
    assert poses.at((jump.start_ns + jump.end_ns) // 2) is None
    assert poses.at(START_NS + 60 * NS_PER_S) is not None
    assert poses.verdict is not Verdict.GOOD


def test_bad_poses_give_way_to_odometry() -> None:
    def torn(fix: GnssFix) -> GnssFix:
        return _moved(fix, np.array([0.0, 20.0 * (int(_seconds(fix) / 10) % 2), 0.0]))

    motion = _town(0)
    samples = _changed(_samples(motion, 0, 1.0, 80), torn)
    odometry = [*Navigation(motion, MAP_ORIGIN, 0, 1.0).odometry(80 * NS_PER_S)]
    topics = replace(TOPICS, odometry=ODOMETRY_TOPIC)
    poses = poses_from_samples(topics, [*samples, *odometry], origin=MAP_ORIGIN)
    assert poses.source == "odometry"
    assert any("poses from gnss+imu are bad" in note for note in poses.notes)
    assert any("no place on earth" in note for note in poses.notes)
    assert poses_from_samples(TOPICS, samples).source == "gnss+imu"


@pytest.mark.parametrize(("pause_s", "lost"), [(0.6, 0), (5.0, 49)])
def test_nothing_is_known_while_the_imu_pauses(pause_s: float, lost: int) -> None:
    kept = [
        s
        for s in _samples(_town(0), 0, 1.0, 80)
        if isinstance(s, GnssFix) or not 30 < _seconds(s) < 30 + pause_s
    ]
    poses = _poses(kept)
    assert (poses.gaps_ns - START_NS) / NS_PER_S == pytest.approx(
        np.array([[30.0, 30.0 + pause_s]])
    )
    assert len(poses.segments()) == 2
    assert poses.at(START_NS + round((30 + pause_s / 2) * NS_PER_S)) is None
    assert poses.dropped["GNSS fixes outside the span of the IMU"] == lost
    off_m, _ = _errors(poses, _town(0))
    assert off_m.max() < 0.05


def test_a_turned_imu_gives_the_same_poses() -> None:
    turn = rotation_from_rpy(np.pi, 0.3, 2.0)
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = turn, T_BASE_IMU.translation_m
    topics = replace(TOPICS, T_base_imu=Transform("base_link", "imu", place))
    samples = [
        replace(
            s,
            angular_velocity_radps=turn.T @ s.angular_velocity_radps,
            linear_acceleration_mps2=turn.T @ s.linear_acceleration_mps2,
        )
        if isinstance(s, ImuSample)
        else s
        for s in _samples(_town(0), 0, 1.0, 80)
    ]
    off_m, heading = _errors(poses_from_samples(topics, samples, origin=MAP_ORIGIN), _town(0))
    assert off_m.max() < 0.03
    assert np.abs(heading).max() < np.radians(0.2)


def test_gnss_alone_is_headed_as_it_goes() -> None:
    motion = _town(0)
    fixes = [s for s in _samples(motion, 0, 1.0, 80) if isinstance(s, GnssFix)]
    poses = _poses(fixes, "gnss")
    off_m, turn = _errors(poses, motion)
    assert np.mean(off_m < 2 * poses.sd_position_m) > 0.95
    assert np.mean(np.abs(turn) < 2 * poses.sd_heading_rad) > 0.95
    moving = np.abs(motion.seconds(poses.trajectory.stamps_ns) - 20) < 3
    assert np.abs(turn[moving]).max() < np.radians(3)
    assert poses.verdict is Verdict.DOUBTFUL


def test_a_real_motion_comes_back(shared_data: Path) -> None:
    table = np.genfromtxt(
        shared_data / "scenes/av2/7fab2350/city_SE3_egovehicle_at_annotations.csv",
        delimiter=",",
        names=True,
    )
    times = (table["timestamp_ns"] - table["timestamp_ns"][0]) / NS_PER_S
    place = CubicSpline(times, np.column_stack([table[f"t{a}_m"] for a in "xyz"]), axis=0)
    quats = np.column_stack([table[f"q{a}"] for a in "xyzw"])
    attitude = RotationSpline(times, Rotation.from_quat(quats))
    rng = np.random.default_rng(0)
    at = np.arange(0.0, times[-1], 0.01)
    R = attitude(at).as_matrix()
    force = np.einsum("nji,nj->ni", R, place(at, 2) + np.array([0.0, 0.0, 9.80665]))
    samples: list[Sample] = []
    for n, time_s in enumerate(at.tolist()):
        head = {"stamp_ns": START_NS + round(time_s * NS_PER_S), "log_time_ns": START_NS}
        samples.append(
            ImuSample(
                topic=IMU_TOPIC,
                angular_velocity_radps=attitude(time_s, 1) + rng.normal(0.001, 0.002, 3),
                linear_acceleration_mps2=force[n] + rng.normal(0.02, 0.03, 3),
                **head,
            )
        )
        if n % 20 == 0:
            point = place(time_s) - place(0.0) + rng.normal(0, 0.02, 3)
            latitude, longitude, altitude = MAP_ORIGIN.geodetic(point)
            samples.append(
                GnssFix(
                    topic=GNSS_TOPIC,
                    latitude_deg=latitude,
                    longitude_deg=longitude,
                    altitude_m=altitude,
                    covariance_m2=np.eye(3) * 0.02**2,
                    **head,
                )
            )
    here = Transform.identity("base_link", "sensor")
    topics = replace(TOPICS, T_base_gnss=here, T_base_imu=here)
    poses = poses_from_samples(topics, samples, origin=MAP_ORIGIN)
    since = (poses.trajectory.stamps_ns - START_NS) / NS_PER_S
    off = poses.trajectory.matrices[:, :3, 3] - (place(since) - place(0.0))
    turn = np.swapaxes(attitude(since).as_matrix(), 1, 2) @ poses.trajectory.matrices[:, :3, :3]
    heading = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    assert poses.source == "gnss+imu"
    assert np.sqrt(np.mean(off**2)) < 0.02
    assert np.mean(np.linalg.norm(off, axis=1) < 2 * poses.sd_position_m) > 0.9
    assert (np.abs(heading) < 3 * poses.sd_heading_rad).all()
