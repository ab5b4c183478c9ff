"""Hindsight on the synthetic drives: velocities by a fifth better than the tracker's, or more."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from percept.core.results import Detections3D, Tracks
from percept.core.trajectory import Trajectory
from percept.datasets.synthetic.drive import START_NS, Drive, DriveConfig
from percept.datasets.synthetic.lidar import cloud_of_scan
from percept.datasets.synthetic.truth import object_rows
from percept.lidar import prepare_detector
from percept.lidar.merge import merge_clouds
from percept.tracking import TrackedDrive, track_drive
from percept.tracking.tracker import Tracker

F64 = NDArray[np.float64]

_BOX = ("x", "y", "z", "length", "width", "height", "yaw_rad")
_GATE_M = 2.0


@dataclass(frozen=True)
class Truth:
    """The objects near the vehicle at one time."""

    ids: NDArray[np.int64]
    boxes: F64
    velocities: F64
    labels: tuple[str, ...]

    @classmethod
    def at(cls, drive: Drive, stamp_ns: int, returns: dict[int, int] | None = None) -> Truth:
        """Return all objects, or those from which ten returns or more came."""
        rows = object_rows(drive.world, drive.ego, stamp_ns, returns or {})
        rows = [row for row in rows if returns is None or row["points"] >= 10]
        return cls(
            np.array([row["track_id"] for row in rows]),
            np.array([[row[name] for name in _BOX] for row in rows]).reshape(-1, 7),
            np.array([[row["vx"], row["vy"]] for row in rows]).reshape(-1, 2),
            tuple(row["label"] for row in rows),
        )


def poses_of(drive: Drive) -> Trajectory:
    stamps = np.arange(START_NS, START_NS + drive.duration_ns + 1, 5_000_000)
    return drive.ego.trajectory(stamps)


def noisy(truth: Truth, stamp_ns: int, rng: np.random.Generator) -> Detections3D:
    """What a good detector would see: a tenth missed, some noise, a false box now and then."""
    seen = rng.random(len(truth.ids)) > 0.1
    boxes, labels = truth.boxes[seen].copy(), np.array(truth.labels)[seen].tolist()
    boxes[:, :2] += rng.normal(0, 0.2, (len(boxes), 2))
    boxes[:, 2] += rng.normal(0, 0.1, len(boxes))
    boxes[:, 3:6] *= np.exp(rng.normal(0, 0.06, (len(boxes), 3)))
    boxes[:, 6] += rng.normal(0, 0.1, len(boxes))
    if rng.random() < 0.3:
        false = truth.boxes[rng.integers(len(truth.boxes))].copy()
        false[:2] += rng.normal(0, 8.0, 2)
        boxes, labels = np.vstack([boxes, false]), [*labels, "unknown"]
    return Detections3D(
        stamp_ns=stamp_ns,
        sensor="made",
        frame_id="map",
        boxes_m=boxes,
        labels=tuple(labels),
        confidences=rng.uniform(0.5, 0.95, len(boxes)),
    )


@dataclass(frozen=True)
class Errors:
    """How far full tracks are from the truth that they match, and how often ids change."""

    velocity_mps: F64
    switches: int
    matched: int
    merged: int

    @property
    def velocity_rmse(self) -> float:
        return float(np.sqrt((self.velocity_mps**2).mean()))


def errors_of(frames: Iterable[Tracks], truths: dict[int, Truth]) -> Errors:
    errors: list[float] = []
    names: dict[int, int] = {}
    owners: dict[int, set[int]] = {}
    switches = 0
    for tracks in frames:
        truth = truths[tracks.stamp_ns]
        full = np.flatnonzero([state == "full" for state in tracks.states])
        apart = np.linalg.norm(tracks.boxes_m[full, None, :2] - truth.boxes[None, :, :2], axis=2)
        for row, column in zip(*linear_sum_assignment(np.minimum(apart, _GATE_M)), strict=True):
            if apart[row, column] >= _GATE_M:
                continue
            track, name = full[row], int(truth.ids[column])
            found = int(tracks.ids[track])
            switches += names.get(name, found) != found
            names[name] = found
            owners.setdefault(found, set()).add(name)
            off = tracks.velocities_mps[track] - truth.velocities[column]
            errors.append(float(np.hypot(*off)))
    merged = sum(len(of_one) > 1 for of_one in owners.values())
    return Errors(np.array(errors), switches, len(errors), merged)


def compared(
    scans: list[Detections3D], tracked: TrackedDrive, poses: Trajectory, truths: dict[int, Truth]
) -> tuple[Errors, Errors]:
    """Return the errors of the tracker right after each scan, and those with hindsight."""
    tracker, online = Tracker(poses=poses), []
    for scan in scans:
        tracker.push(scan)
        online.append(tracker.tracks(scan.stamp_ns))
    return errors_of(online, truths), errors_of(tracked.frames(), truths)


def test_with_hindsight_velocities_are_better_by_a_fifth() -> None:
    switches, merged = [0, 0], [0, 0]
    for seed in range(3):
        drive = Drive(DriveConfig(seed=seed, seconds=8.0, cameras=()))
        rng = np.random.default_rng(seed)
        stamps = [drive.scan_stamp_ns(drive.lidars[0], number) for number in range(drive.scans)]
        truths = {stamp_ns: Truth.at(drive, stamp_ns) for stamp_ns in stamps}
        scans = [noisy(truths[stamp_ns], stamp_ns, rng) for stamp_ns in stamps]
        poses = poses_of(drive)
        found = compared(scans, track_drive(scans, poses=poses), poses, truths)
        assert found[1].velocity_rmse < 0.8 * found[0].velocity_rmse
        assert found[1].matched > found[0].matched  # from the first detection on
        switches = [total + one.switches for total, one in zip(switches, found, strict=True)]
        merged = [total + one.merged for total, one in zip(merged, found, strict=True)]
    assert switches[1] <= switches[0]
    assert merged[1] <= merged[0]  # joining brought no two objects together


def test_with_hindsight_velocities_of_own_detections_are_better_by_a_fifth() -> None:
    drive = Drive(DriveConfig(seed=1, seconds=4.0, cameras=(), beam_share=0.5))
    places = {f"/{model.name}/points": model.T_base_sensor for model in drive.lidars}
    clouds, truths = [], {}
    for number in range(drive.scans):
        scans = [drive.scan(sensor, number) for sensor in range(len(drive.lidars))]
        merged = merge_clouds(
            [cloud_of_scan(s, m.name) for s, m in zip(scans, drive.lidars, strict=True)], places
        )
        clouds.append(merged)
        hit, counts = np.unique(
            np.concatenate([scan.object_ids for scan in scans]), return_counts=True
        )
        returns = dict(zip(hit.tolist(), counts.tolist(), strict=True))
        truths[merged.stamp_ns] = Truth.at(drive, merged.stamp_ns, returns)
    detector = prepare_detector(clouds[:5], sensor="lidars", merged=True)
    found = [detector.detect(cloud).detections for cloud in clouds]
    poses = poses_of(drive)
    tracked = track_drive(found, poses=poses)
    online, offline = compared(found, tracked, poses, truths)
    assert online.matched > 300
    assert offline.velocity_rmse < 0.8 * online.velocity_rmse
    assert offline.switches < online.switches
    assert tracked.joined > 0
