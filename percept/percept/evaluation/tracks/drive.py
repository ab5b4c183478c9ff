"""The tracks of a run against the truth of a synthetic drive.

Both are brought into one frame by the poses of the vehicle, which both sides have: tracks may
be in any frame that does not move. Pairs are made by the distance of centres, at most 2 m or half
the object's diagonal: a LiDAR sees one side of an object, so that boxes of a run overlap less than
the objects do.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.tracked_boxes import TrackedBoxes
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.evaluation.runs import read_poses
from percept.evaluation.tracks.clear import match_over_time
from percept.evaluation.tracks.frames import assign_rows, frame_slices, pair_frames
from percept.evaluation.tracks.scores import TrackScores, figure, score_frames
from percept.evaluation.tracks.similarity import centre_closeness
from percept.evaluation.tracks.velocity import VelocityScores, velocity_scores

__all__ = [
    "ClassTrackScores",
    "DriveTruth",
    "align_frames",
    "read_drive_truth",
    "score_class",
    "score_drive",
]

_LEAST = 0.5  # of `centre_closeness`: the gate
_REACH_M = 75.0
_FEWEST_POINTS = 10
_LARGEST_STAMP_DIFFERENCE_NS = 60_000_000
_BOX = ("x", "y", "z", "length", "width", "height", "yaw_rad")

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class DriveTruth:
    """What was really there.

    Attributes:
        objects: In the frame `poses.target`; frames are stamps in ns.
        points: (R,) int64 returns of all LiDARs from each object at that moment.
        poses: Where the vehicle was.
    """

    objects: TrackedBoxes
    points: NDArray[np.int64]
    poses: Trajectory


@dataclass(frozen=True, slots=True)
class ClassTrackScores:
    """One class, or the sum of all.

    Attributes:
        tracks: CLEAR-MOT, IDF1 and HOTA, with the closeness of the centres as similarity.
        velocity: Errors of the velocity of the pairs.
        found: Objects, over all frames, that have a track of whatever class.
    """

    tracks: TrackScores = field(default_factory=TrackScores)
    velocity: VelocityScores = field(default_factory=VelocityScores)
    found: int = 0

    def __add__(self, other: ClassTrackScores) -> ClassTrackScores:
        return ClassTrackScores(
            self.tracks + other.tracks, self.velocity + other.velocity, self.found + other.found
        )

    def document(self) -> dict[str, float | None]:
        """Return all figures by name."""
        objects = self.tracks.clear.objects
        return {
            **self.tracks.document(),
            "recall_any_label": figure(self.found / objects) if objects else None,
            "velocity_rmse_mps": figure(self.velocity.rmse_mps),
        }


def read_drive_truth(folder: Path) -> DriveTruth:
    """Read `objects.parquet` and `poses.parquet` of a truth folder.

    Raises:
        InputError: If one of them is missing or not what it should be.
    """
    columns = ("stamp_ns", "track_id", "label", "points", "vx", "vy", *_BOX)
    path = folder / "objects.parquet"
    try:
        table = pq.read_table(path, columns=list(columns)).sort_by("stamp_ns")
        poses = read_poses(folder / "poses.parquet")
    except (pa.ArrowException, OSError, KeyError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"holds no truth of a drive ({reason})",
            where=folder,
            remedy="Give the truth folder that percept synth drive made",
        ) from error
    objects = TrackedBoxes(
        frames=table["stamp_ns"].to_numpy(),
        ids=table["track_id"].to_numpy(),
        labels=tuple(table["label"].to_pylist()),
        boxes_m=np.column_stack([table[name].to_numpy() for name in _BOX]),
        velocities_mps=np.column_stack([table[name].to_numpy() for name in ("vx", "vy")]),
    )
    return DriveTruth(objects, table["points"].to_numpy(), poses)


def align_frames(run: Trajectory, truth: Trajectory) -> Transform:
    """Return `T_truth_run`, the rigid transform that fits the poses of a run to the true ones.

    The rotation is the mean of what the single poses say (the chordal mean), and the
    translation that which brings the mean place to its own.

    Args:
        run: `T_run_vehicle`.
        truth: `T_truth_vehicle` of the same vehicle frame.

    Raises:
        InputError: If they are of different frames, or share no time.
    """
    if run.source != truth.source:
        raise InputError(f"poses of '{run.source}' do not fit those of '{truth.source}'")
    known, shared = truth.poses_at(run.stamps_ns)
    if not shared.any():
        raise InputError("the poses of the run and the true ones share no time")
    known, own = known[shared], run.matrices[shared]
    turns = known[:, :3, :3] @ np.swapaxes(own[:, :3, :3], 1, 2)
    left, _, right = np.linalg.svd(turns.sum(axis=0))
    matrix = np.eye(4)
    matrix[:3, :3] = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    matrix[:3, 3] = (known[:, :3, 3] - own[:, :3, 3] @ matrix[:3, :3].T).mean(axis=0)
    return Transform(truth.target, run.target, matrix)


def score_drive(
    truth: DriveTruth,
    tracks: TrackedBoxes,
    moments_ns: Iterable[int],
    T_truth_run: Transform,
) -> tuple[dict[str, ClassTrackScores], Counter[str]]:
    """Score the tracks of a run by class.

    An object with fewer than 10 returns at a moment, or farther than 75 m from the vehicle, is
    neither found nor missed then, and a track on it is neither right nor wrong.

    Args:
        truth: What was there.
        tracks: The tracks, in the run's frame; frames are stamps in ns.
        moments_ns: The moments at which tracks were asked for, those without any among them.
        T_truth_run: From the frame of the tracks to that of the truth.

    Returns:
        The scores by class, and what was left out, by reason.

    Raises:
        InputError: If no moment is one of which the truth is known.
    """
    dropped: Counter[str] = Counter()
    asked = np.array(sorted({*moments_ns, *tracks.frames.tolist()}), dtype=np.int64)
    objects, hidden = _at(truth, asked, dropped)
    moved = _near(truth, _moved(tracks, T_truth_run), dropped)
    moved = moved.select(np.isin(moved.frames, np.unique(objects.frames)))
    labels = sorted(set(objects.labels))
    for label in sorted(set(moved.labels) - set(labels)):
        dropped[f"boxes of tracks labelled '{label}', which the truth does not have"] += sum(
            name == label for name in moved.labels
        )
    scores = {}
    for label in labels:
        chosen = np.array([name == label for name in objects.labels], dtype=np.bool_)
        one = score_class(objects.select(chosen), hidden[chosen], moved.labelled(label))
        scores[label] = replace(one, found=_found(objects.select(chosen & ~hidden), moved))
    return scores, dropped


def _found(truth: TrackedBoxes, tracks: TrackedBoxes) -> int:
    frames = pair_frames(truth, tracks, centre_closeness)
    return sum(len(assign_rows(frame.similarity, _LEAST)[0]) for frame in frames)


def _at(
    truth: DriveTruth, moments_ns: NDArray[np.int64], dropped: Counter[str]
) -> tuple[TrackedBoxes, NDArray[np.bool_]]:
    """Return the objects at each moment, carried on with their velocity, and who is hidden."""
    stamps = np.unique(truth.objects.frames)
    if not len(stamps):
        raise InputError("the truth holds no object")
    after = np.clip(np.searchsorted(stamps, moments_ns), 1, max(len(stamps) - 1, 1))
    after = np.minimum(after, len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    closer = np.abs(stamps[before] - moments_ns) <= np.abs(stamps[after] - moments_ns)
    nearest = np.where(closer, stamps[before], stamps[after])
    fits = np.abs(nearest - moments_ns) <= _LARGEST_STAMP_DIFFERENCE_NS
    if not fits.any():
        raise InputError("no moment of the run fits the truth in time")
    if not fits.all():
        dropped["moments without truth"] += int((~fits).sum())
    rows = list(frame_slices(truth.objects.frames, nearest[fits]))
    chosen = np.concatenate(rows)
    moment = np.repeat(moments_ns[fits], [len(part) for part in rows])
    objects = truth.objects
    boxes, speeds = objects.boxes_m[chosen], objects.velocities_mps[chosen]
    boxes[:, :2] += speeds * ((moment - objects.frames[chosen]) * 1e-9)[:, None]
    there = TrackedBoxes(
        frames=moment,
        ids=objects.ids[chosen],
        labels=tuple(objects.labels[row] for row in chosen),
        boxes_m=boxes,
        velocities_mps=speeds,
    )
    return there, (truth.points[chosen] < _FEWEST_POINTS) | ~_within(truth, there)


def _within(truth: DriveTruth, boxes: TrackedBoxes) -> NDArray[np.bool_]:
    poses, _ = truth.poses.poses_at(boxes.frames)
    offsets = boxes.boxes_m[:, :2] - poses[:, :2, 3]
    return np.asarray(np.hypot(offsets[:, 0], offsets[:, 1]) <= _REACH_M)


def _near(truth: DriveTruth, tracks: TrackedBoxes, dropped: Counter[str]) -> TrackedBoxes:
    near = _within(truth, tracks)
    if not near.all():
        dropped["boxes of tracks beyond 75 m, where the truth ends"] += int((~near).sum())
    return tracks.select(near)


def _moved(tracks: TrackedBoxes, T_truth_run: Transform) -> TrackedBoxes:
    rotation = T_truth_run.rotation
    boxes = tracks.boxes_m.copy()
    boxes[:, :3] = T_truth_run.apply(tracks.boxes_m[:, :3])
    yaw = boxes[:, 6] + np.arctan2(rotation[1, 0], rotation[0, 0])
    boxes[:, 6] = np.arctan2(np.sin(yaw), np.cos(yaw))
    return replace(tracks, boxes_m=boxes, velocities_mps=tracks.velocities_mps @ rotation[:2, :2].T)


def score_class(
    truth: TrackedBoxes, hidden: NDArray[np.bool_], tracks: TrackedBoxes
) -> ClassTrackScores:
    """Score one class by the distance of centres.

    Args:
        truth: Its objects.
        hidden: (R,) which of them do not count at a moment, nor does a track on one of them.
        tracks: Its tracks, in the same frame.
    """
    excused = _on_hidden(truth, hidden, tracks)
    truth, tracks = truth.select(~hidden), tracks.select(~excused)
    frames = pair_frames(truth, tracks, centre_closeness)
    matches = match_over_time(frames, _LEAST)
    return ClassTrackScores(
        score_frames(frames, _LEAST), velocity_scores(truth, tracks, frames, matches)
    )


def _on_hidden(
    truth: TrackedBoxes, hidden: NDArray[np.bool_], tracks: TrackedBoxes
) -> NDArray[np.bool_]:
    """Return which boxes of tracks belong to objects that do not count."""
    excused = np.zeros(len(tracks), dtype=np.bool_)
    numbers = np.unique(tracks.frames)
    both = zip(
        frame_slices(truth.frames, numbers), frame_slices(tracks.frames, numbers), strict=True
    )
    for rows, columns in both:
        closeness = centre_closeness(truth.select(rows), tracks.select(columns))
        pairs, others = assign_rows(closeness, _LEAST)
        excused[columns[others[hidden[rows[pairs]]]]] = True
    return excused
