"""KITTI's sequences: a detector's boxes are tracked, tracks are scored."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from percept.cli.eval.tracks_result import TrackEvalRequest, TrackEvalRun
from percept.cli.progress import progress_bar
from percept.core.errors import InputError
from percept.core.results import Detections3D, Tracks
from percept.core.settings import load_settings
from percept.core.tracked_boxes import TrackedBoxes
from percept.datasets.labels.kitti_tracking import read_kitti_detections, read_kitti_tracks
from percept.evaluation.tracks import detection_scans, score_kitti, tracked_boxes
from percept.evaluation.tracks.score_scale import ScoreScale
from percept.tracking import Tracker, TrackerConfig, track_drive

__all__ = ["score_detections", "score_track_files"]

_NAMES = {"car": "Car", "pedestrian": "Pedestrian", "cyclist": "Cyclist"}
_COAST_FRAMES = 2
_WARM_UP_SCANS = 3
_LOGITS = (
    "scores of {lowest:.4g} to {highest:.4g} are logits: the tracker was given their logistic "
    "function, a probability; scores of tracks are in the unit of the files"
)


def score_detections(request: TrackEvalRequest) -> TrackEvalRun:
    """Track the sequences of a detector, and score those that have labels.

    Raises:
        InputError: If a file is none of the format, or no sequence has labels.
    """
    config = load_settings(TrackerConfig, request.config)
    files = _files(*request.detections)
    labels = _files(request.labels)
    dropped: Counter[str] = Counter()
    coast = _COAST_FRAMES if request.coast is None else request.coast
    made: dict[str, TrackedBoxes] = {}
    truths = {name: read_kitti_tracks(labels[name][0]) for name in files if name in labels}
    found = {name: read_kitti_detections(parts) for name, parts in files.items()}
    scale = ScoreScale.of(boxes.scores for boxes in found.values())
    frames, seconds = 0, 0.0
    with progress_bar("tracking", len(files)) as show:
        for done, (name, boxes) in enumerate(found.items()):
            likely = replace(boxes, scores=scale.probabilities(boxes.scores))
            scans = list(detection_scans(likely, _frames(boxes, truths.get(name))))
            tracks, took = _track(scans, config, dropped, online=request.online)
            # With hindsight no track goes on after it was last seen: all are reported.
            known = coast if request.online else len(scans)
            made[name] = tracked_boxes(
                boxes, tracks, coast_frames=known, names=_NAMES, weak_score=scale.weak
            )
            frames, seconds = frames + len(scans), seconds + took
            show(done + 1)
    run = _scored(truths, made, dropped)
    run.document["speed"] = {
        "frames": frames,
        "seconds": round(seconds, 6),
        "frames_per_second": round(frames / seconds, 1) if seconds else None,
    }
    run.inputs = [path for parts in files.values() for path in parts]
    run.inputs += [path for name in truths for path in labels[name]]
    if scale.logits:
        run.notes.append(_LOGITS.format(lowest=scale.lowest, highest=scale.highest))
    run.notes += _lone("labels", set(files) - set(labels))
    run.notes += _lone("detections", set(labels) - set(files))
    run.config = {
        **config.model_dump(mode="json"), "coast_frames": coast, "online": request.online
    }  # fmt: skip
    run.tracks = made
    return run


def score_track_files(tracks: Path, labels: Path) -> TrackEvalRun:
    """Score KITTI tracking files of whatever tool.

    Raises:
        InputError: If a file is none of the format, or no sequence has labels.
    """
    made_files, label_files = _files(tracks), _files(labels)
    both = [name for name in made_files if name in label_files]
    made = {name: read_kitti_tracks(made_files[name][0]) for name in both}
    for name, boxes in made.items():
        if any(map(math.isnan, boxes.scores.tolist())):
            raise InputError("has tracks without a score", where=made_files[name][0])
    truths = {name: read_kitti_tracks(label_files[name][0]) for name in both}
    run = _scored(truths, made, Counter())
    run.inputs = [path for name in both for path in (*made_files[name], *label_files[name])]
    run.notes += _lone("labels", set(made_files) - set(label_files))
    run.notes += _lone("tracks", set(label_files) - set(made_files))
    return run


def _files(*folders: Path) -> dict[str, list[Path]]:
    """Return the text files of all folders by the name of their sequence."""
    found: dict[str, list[Path]] = {}
    for folder in folders:
        files = sorted(folder.glob("*.txt")) if folder.is_dir() else []
        if not files:
            raise InputError("is no folder with files of sequences (NNNN.txt)", where=folder)
        for file in files:
            found.setdefault(file.stem, []).append(file)
    return dict(sorted(found.items()))


def _frames(*both: TrackedBoxes | None) -> int:
    return 1 + max((int(one.frames[-1]) for one in both if one is not None and len(one)), default=0)


def _track(
    scans: Sequence[Detections3D], config: TrackerConfig, dropped: Counter[str], *, online: bool
) -> tuple[list[Tracks], float]:
    """Return the tracks at each scan, and how long the tracker alone took."""
    some = [scan for scan in scans if len(scan)][:_WARM_UP_SCANS]
    _moments(some, config, online=online)  # reads the compiled code from disk, which is no tracking
    begun = time.perf_counter()
    moments, lost = _moments(scans, config, online=online)
    took = time.perf_counter() - begun
    dropped.update(lost)
    return moments, took


def _moments(
    scans: Sequence[Detections3D], config: TrackerConfig, *, online: bool
) -> tuple[list[Tracks], Counter[str]]:
    """Return the tracks at each scan, and what was dropped."""
    if not online:
        drive = track_drive(scans, config)
        return list(drive.frames()), drive.dropped
    tracker, moments = Tracker(config), []
    for scan in scans:
        tracker.push(scan)
        moments.append(tracker.tracks(scan.stamp_ns))
    return moments, tracker.dropped


def _scored(
    truths: dict[str, TrackedBoxes], made: dict[str, TrackedBoxes], dropped: Counter[str]
) -> TrackEvalRun:
    if not truths:
        raise InputError("no sequence has both tracks and labels: names of files do not meet")
    with progress_bar("scoring", 1.0) as show:
        scores = score_kitti([(truth, made[name]) for name, truth in truths.items()], show)
    by_class: dict[str, dict[str, Any]] = {
        label: {name: one.document() for name, one in parts.items()}
        for label, parts in scores.items()
    }
    first = [next(iter(parts.values())) for parts in scores.values()]
    return TrackEvalRun(
        document={
            "format": "kitti",
            "sequences": sorted(truths),
            "frames": sum(_frames(truth) for truth in truths.values()),
            "by_class": by_class,
        },
        rows={
            f"{label} {name}": figures
            for label, parts in by_class.items()
            for name, figures in parts.items()
        },
        objects=sum(one.recalls.best.objects for one in first),
        inputs=[],
        dropped=dropped,
        curves={
            f"{label} {name}": one.recalls.curve
            for label, parts in scores.items()
            for name, one in parts.items()
        },
    )


def _lone(what: str, names: set[str]) -> list[str]:
    if not names:
        return []
    return [f"not scored, without {what}: sequence {', '.join(sorted(names))}"]
