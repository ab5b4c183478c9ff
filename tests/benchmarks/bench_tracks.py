"""The tracker beside a plain one, on real objects seen by a made-up detector.

    python tests/benchmarks/bench_tracks.py --data ../shared/data

Both get the same boxes, in one process on one core; the plain tracker is
`tests/truth/plain_sort.py`. Online: nobody knows the future. With hindsight stands apart.

- KITTI: the labels of 11 sequences, in the moving frame of the camera, by the benchmark's rules
  with a 3D IoU of 0.25; each tracker at its own best threshold of the tracks' scores.
- Argoverse 2: a drive with ego poses, which our tracker is given; the plain one gets the boxes in
  the city's frame already. Pairs by distance of centres, no threshold; objects without a LiDAR
  point, or beyond 80 m, do not count. The error of the velocity is that of other pairs for each
  tracker, and is not judged.

- KITTI as a network sees it: `tests/truth/network_boxes.py`, whose errors are those that published
  detectors make on these sequences, with neutral and unlabelled objects, and clutter.

Switches are those over gaps too. Ends with 1 where a figure is not better than the plain one's.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from percept.core.box_overlap import iou_3d
from percept.core.results import Detections3D, Tracks
from percept.core.tracked_boxes import TrackedBoxes
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform, matrix_from_quat_xyzw
from percept.datasets.labels.kitti_tracking import read_kitti_tracks
from percept.evaluation.tracks.drive import ClassTrackScores, score_class
from percept.evaluation.tracks.frames import frame_slices
from percept.evaluation.tracks.kitti_rules import KITTI_CLASSES, KittiSequence
from percept.evaluation.tracks.recalls import score_recalls
from percept.evaluation.tracks.replay import FRAME_PERIOD_NS, detection_scans, tracked_boxes
from percept.evaluation.tracks.scores import TrackScores, score_frames
from percept.evaluation.tracks.similarity import space_iou
from percept.tracking import Tracker, track_drive

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "truth"))

from network_boxes import network_detections
from noisy_boxes import LEVELS, noisy_detections
from plain_sort import plain_sort

_DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
_COAST_FRAMES = 2
_NETWORK = "network"
_AV2_LABELS = {
    "REGULAR_VEHICLE": "car",
    "BOX_TRUCK": "truck",
    "TRUCK_CAB": "truck",
    "BICYCLE": "cyclist",
    "MOTORCYCLE": "cyclist",
    "PEDESTRIAN": "pedestrian",
    "CONSTRUCTION_CONE": "cone",
}
_AV2_REACH_M = 80.0

_F64 = NDArray[np.float64]
_Score = Callable[[str, list[TrackedBoxes]], dict[str, float]]


@dataclass(frozen=True, slots=True, eq=False)
class _Sequence:
    """Objects, and the poses of the sensor where they are known."""

    truth: TrackedBoxes
    objects: TrackedBoxes
    frames: int
    poses: Trajectory | None = None


_Detect = Callable[[_Sequence, int], TrackedBoxes]


def main() -> None:
    """Run all levels on both data sets and print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=_DATA)
    parser.add_argument("--level", choices=[*LEVELS, _NETWORK], action="append")
    arguments = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    kitti = list(_kitti(arguments.data / "mot" / "kitti_tracking" / "label_02"))
    av2 = [_av2(arguments.data / "scenes" / "av2" / "7fab2350")]
    worse: list[str] = []
    for name in arguments.level or [*LEVELS, _NETWORK]:
        detect = _detector(name)
        worse += _compare(f"KITTI, {name}", kitti, detect, _score_kitti(kitti))
        if name != _NETWORK:
            worse += _compare(f"Argoverse 2, {name}", av2, detect, _score_av2(av2))
    for row in worse:
        print(f"not better: {row}")
    raise SystemExit(bool(worse))


def _detector(name: str) -> _Detect:
    def network(one: _Sequence, seed: int) -> TrackedBoxes:
        found = network_detections(one.truth, seed)
        return replace(found, scores=expit(found.scores))

    def noisy(one: _Sequence, seed: int) -> TrackedBoxes:
        return noisy_detections(one.objects, LEVELS[name], seed, ego_xy_m=_places(one))

    return network if name == _NETWORK else noisy


def _compare(title: str, sequences: list[_Sequence], detect: _Detect, score: _Score) -> list[str]:
    """Print a level, and return the rows in which the plain tracker is as good."""
    made: dict[str, list[TrackedBoxes]] = {name: [] for name in _TRACKERS}
    seconds = dict.fromkeys(_TRACKERS, 0.0)
    count = 0
    for seed, one in enumerate(sequences):
        boxes = detect(one, seed)
        scans = list(_scans(one, boxes))
        count += len(boxes)
        for name, track in _TRACKERS.items():
            begun = time.perf_counter()
            moments = track(one, boxes, scans)
            seconds[name] += time.perf_counter() - begun
            made[name].append(_reported(name, one, boxes, moments))
    frames = sum(one.frames for one in sequences)
    print(f"\n{title}: {frames} frames, {count} boxes")
    speeds = ", ".join(f"{name} {frames / took:,.0f}" for name, took in seconds.items())
    print(f"  frames a second: {speeds}")
    labels = sorted({name for one in sequences for name in one.objects.labels})
    return [f"{title}, {row}" for label in labels for row in _rows(label, made, score)]


def _rows(label: str, made: dict[str, list[TrackedBoxes]], score: _Score) -> list[str]:
    figures = {name: score(label, tracks) for name, tracks in made.items()}
    print(f"  {label:22}" + "".join(f"{key:>10}" for key in figures["plain"]))
    for name, row in figures.items():
        cells = (f"{v:10.3f}" if key != "switches" else f"{v:10.0f}" for key, v in row.items())
        print(f"    {name:20}" + "".join(cells), flush=True)
    worse = []
    for key, plain in figures["plain"].items():
        ours = figures["percept"][key]
        if ours > plain if key == "switches" else ours <= plain and key != "v rmse":
            worse.append(f"{label}: {key} {ours:.3f}, plain {plain:.3f}")
    return worse


def _reported(
    name: str, one: _Sequence, boxes: TrackedBoxes, moments: TrackedBoxes | list[Tracks]
) -> TrackedBoxes:
    if isinstance(moments, TrackedBoxes):
        return moments
    # With hindsight no track goes on after it was last seen: all are reported.
    coast = one.frames if name == "hindsight" else _COAST_FRAMES
    names = {label.lower(): label for label in set(boxes.labels)}
    return tracked_boxes(boxes, moments, coast_frames=coast, names=names)


def _online(scans: Iterable[Detections3D], poses: Trajectory | None) -> list[Tracks]:
    tracker, moments = Tracker(poses=poses), []
    for scan in scans:
        tracker.push(scan)
        moments.append(tracker.tracks(scan.stamp_ns))
    return moments


_TRACKERS: dict[
    str,
    Callable[[_Sequence, TrackedBoxes, list[Detections3D]], TrackedBoxes | list[Tracks]],
] = {
    "plain": lambda one, boxes, _: plain_sort(boxes, one.frames),
    "percept": lambda one, _, scans: _online(scans, one.poses),
    "hindsight": lambda one, _, scans: list(track_drive(scans, poses=one.poses).frames()),
}


def _scans(one: _Sequence, boxes: TrackedBoxes) -> Iterator[Detections3D]:
    """Yield the scans in the frame of the sensor."""
    for scan in detection_scans(boxes, one.frames):
        pose = None if one.poses is None else one.poses.at(scan.stamp_ns)
        if pose is None:
            yield scan
        else:
            seen = _moved(scan.boxes_m, pose.inverse())
            yield replace(scan, frame_id=pose.source, boxes_m=seen)


def _places(one: _Sequence) -> _F64 | None:
    return None if one.poses is None else one.poses.matrices[:, :2, 3]


def _score_kitti(sequences: list[_Sequence]) -> _Score:
    def score(label: str, tracks: list[TrackedBoxes]) -> dict[str, float]:
        parts = [
            KittiSequence(one.truth, made, label, space_iou, 0.25)
            for one, made in zip(sequences, tracks, strict=True)
        ]
        recalls = score_recalls(parts)
        frames = (part.frames(recalls.best_score) for part in parts)
        best = sum((score_frames(f, 0.25) for f in frames), TrackScores())
        return {"sAMOTA": recalls.samota, "MOTA": recalls.best.mota, **_figures(best)}

    return score


def _score_av2(sequences: list[_Sequence]) -> _Score:
    def score(label: str, tracks: list[TrackedBoxes]) -> dict[str, float]:
        total = ClassTrackScores()
        for one, made in zip(sequences, tracks, strict=True):
            truth = one.truth.labelled(label)
            total += score_class(truth, truth.occluded > 0, made.labelled(label))
        mota = total.tracks.clear.mota
        return {"MOTA": mota, **_figures(total.tracks), "v rmse": total.velocity.rmse_mps}

    return score


def _figures(scores: TrackScores) -> dict[str, float]:
    return {
        "IDF1": scores.identity.idf1,
        "HOTA": scores.hota.hota,
        "switches": float(scores.clear.switches),
    }


def _kitti(folder: Path) -> Iterator[_Sequence]:
    for path in sorted(folder.glob("*.txt")):
        truth = read_kitti_tracks(path)
        yield _Sequence(truth, truth.labelled(*KITTI_CLASSES), int(truth.frames[-1]) + 1)


def _av2(folder: Path) -> _Sequence:
    """Return the objects in the frame of the city; those that cannot be seen are occluded."""
    path = folder / "annotations.csv"
    table = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=[0, 2, *range(4, 12)])
    kinds = np.loadtxt(path, str, delimiter=",", skiprows=1, usecols=3)
    frames, tracks = table[:, 0].astype(np.int64), table[:, 1].astype(np.int64)
    poses = _av2_poses(folder / "city_SE3_egovehicle_at_annotations.csv")
    boxes = table[:, 2:9].copy()
    for k, matrix in enumerate(poses.matrices):
        pose = Transform(poses.target, poses.source, matrix)
        boxes[frames == k] = _moved(boxes[frames == k], pose)
    hidden = (table[:, 9] == 0) | (np.hypot(table[:, 2], table[:, 3]) > _AV2_REACH_M)
    truth = TrackedBoxes(
        frames=frames,
        ids=tracks,
        labels=tuple(_AV2_LABELS.get(kind, "") for kind in kinds),
        boxes_m=boxes,
        velocities_mps=_velocities(tracks, frames, boxes),
        occluded=hidden.astype(np.int64),
    ).labelled(*_AV2_LABELS.values())
    truth = truth.select(~_labelled_twice(truth))
    return _Sequence(truth, truth.select(truth.occluded == 0), len(poses), poses)


def _labelled_twice(truth: TrackedBoxes) -> NDArray[np.bool_]:
    """Return which boxes lie in another one of a smaller id: a car of the drive has two labels."""
    twice = np.zeros(len(truth), dtype=bool)
    for rows in frame_slices(truth.frames, np.unique(truth.frames)):
        overlap = iou_3d(truth.boxes_m[rows], truth.boxes_m[rows]) > 0.5
        twice[rows] = (overlap & (truth.ids[rows][None, :] < truth.ids[rows][:, None])).any(axis=1)
    return twice


def _av2_poses(path: Path) -> Trajectory:
    rows = np.genfromtxt(path, delimiter=",", skip_header=1)  # frame, stamp, w, x, y, z, place
    matrices = np.tile(np.eye(4), (len(rows), 1, 1))
    matrices[:, :3, :3] = [matrix_from_quat_xyzw(row[[3, 4, 5, 2]]) for row in rows]
    matrices[:, :3, 3] = rows[:, 6:9] - rows[0, 6:9]
    stamps = np.arange(len(rows), dtype=np.int64) * FRAME_PERIOD_NS
    return Trajectory("city", "base_link", stamps, matrices)


def _velocities(ids: NDArray[np.int64], frames: NDArray[np.int64], boxes_m: _F64) -> _F64:
    """Return velocities (R, 2) from the labels of two frames before to two frames after."""
    velocities = np.full((len(ids), 2), np.nan)
    place = {
        (int(name), int(frame)): row
        for row, (name, frame) in enumerate(zip(ids, frames, strict=True))
    }
    for (name, frame), row in place.items():
        before, after = place.get((name, frame - 2)), place.get((name, frame + 2))
        if before is not None and after is not None:
            velocities[row] = (boxes_m[after, :2] - boxes_m[before, :2]) / 0.4
    return velocities


def _moved(boxes_m: _F64, transform: Transform) -> _F64:
    moved = boxes_m.copy()
    moved[:, :3] = transform.apply(boxes_m[:, :3])
    moved[:, 6] += np.arctan2(transform.rotation[1, 0], transform.rotation[0, 0])
    return moved


if __name__ == "__main__":
    main()
