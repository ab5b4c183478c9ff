"""The tracks of a run folder against the truth of a synthetic drive."""

from __future__ import annotations

from pathlib import Path

from percept.cli.eval.tracks_result import TrackEvalRun
from percept.core.errors import InputError
from percept.core.transform import Transform
from percept.evaluation.tracks import (
    ClassTrackScores,
    DriveTruth,
    align_frames,
    full_tracks,
    read_drive_truth,
    score_drive,
)
from percept.export.pose_table import read_poses
from percept.export.scan_table import read_scans
from percept.export.track_table import read_tracks

__all__ = ["score_run_folder"]

_TRACKS, _POSES, _SCANS = "tracks.parquet", "poses.parquet", "scans_3d.parquet"


def score_run_folder(run: Path, labels: Path) -> TrackEvalRun:
    """Score a run by class, in the frame of the truth.

    Raises:
        InputError: If a table is missing, or cannot be brought into the frame of the truth.
    """
    folder = labels / "truth" if (labels / "truth").is_dir() else labels
    truth = read_drive_truth(folder)
    tracks, frame_ids = full_tracks(read_tracks(run / _TRACKS))
    T_truth_run, notes = _place(run, truth, frame_ids)
    moments = _moments(run / _SCANS)
    scores, dropped = score_drive(truth, tracks, moments, T_truth_run)
    whole = sum(scores.values(), ClassTrackScores())
    rows = {label: one.document() for label, one in scores.items()}
    figures = whole.document()
    return TrackEvalRun(
        document={
            "format": "run",
            "frames": len({*moments, *tracks.frames.tolist()}),
            **figures,
            "by_class": rows,
            "T_truth_run": T_truth_run.matrix.tolist(),
        },
        rows={**rows, "all": figures},
        objects=whole.tracks.clear.objects,
        inputs=[
            path
            for path in (run / _TRACKS, run / _POSES, run / _SCANS, folder / "objects.parquet")
            if path.is_file()
        ],
        dropped=dropped,
        notes=notes,
    )


def _moments(path: Path) -> list[int]:
    return [scan.stamp_ns for scan, _ in read_scans(path)] if path.is_file() else []


def _place(run: Path, truth: DriveTruth, frame_ids: tuple[str, ...]) -> tuple[Transform, list[str]]:
    """Return the transform from the tracks' frame to that of the truth, and what is to say."""
    target = truth.poses.target
    if len(frame_ids) > 1:
        raise InputError(f"tracks are in several frames: {', '.join(frame_ids)}", where=run)
    source = frame_ids[0] if frame_ids else target
    if not (run / _POSES).is_file():
        if source not in (target, truth.poses.source):
            raise InputError(
                f"tracks are in '{source}' and there is no {_POSES} to bring them into '{target}'",
                where=run,
            )
        note = f"without {_POSES} the tracks are taken to be in '{target}' as they are"
        return Transform.identity(target, source), [note]
    poses = read_poses(run / _POSES)
    if frame_ids and poses.target != source:
        raise InputError(f"tracks are in '{source}' but poses in '{poses.target}'", where=run)
    placed = align_frames(poses, truth.poses)
    shift = sum(value**2 for value in placed.translation_m.tolist()) ** 0.5
    return placed, [f"'{source}' lies {shift:.2f} m from '{target}', by the poses of both"]
