"""The run behind `percept eval tracks`: from files to scores, and what is written of them."""

from __future__ import annotations

import json
from contextlib import ExitStack

from percept.cli.eval import tracks_kitti, tracks_mot, tracks_of_run
from percept.cli.eval.tracks_result import TrackEvalRequest, TrackEvalRun
from percept.cli.run_folder import RunFolder, describe_input
from percept.core.errors import UsageError
from percept.datasets.labels.kitti_tracking import write_kitti_tracks
from percept.export.report import write_report
from percept.export.tracking_evaluation_report import track_scores_report

__all__ = ["run_track_eval"]

_OUTPUTS = ("scores.json", "report.html", "tracks")
_MOST_INPUTS = 20


def run_track_eval(request: TrackEvalRequest) -> TrackEvalRun:
    """Read both sides, track where that is asked for, score, and fill the run folder.

    Raises:
        PerceptError: If the input, a setting or the folder cannot be used.
    """
    _check(request)
    with ExitStack() as stack:
        folder = None
        if request.out is not None:
            folder = RunFolder(request.out, force=request.force, outputs=_OUTPUTS)
            stack.enter_context(folder)
        done = _score(request)
        done.document |= {
            "verdict": str(done.verdict),
            "why": done.why,
            "dropped": dict(done.dropped),
            "notes": done.notes,
        }
        if folder is not None:
            folder.begin()
            _write(folder, done)
    return done


def _check(request: TrackEvalRequest) -> None:
    given = (request.run is not None, bool(request.detections), request.tracks is not None)
    if sum(given) != 1:
        raise UsageError("give one of RUN, --detections and --tracks")
    for flag, value in (
        ("--config", request.config),
        ("--online", request.online or None),
        ("--coast", request.coast),
    ):
        if value is not None and not request.detections:
            raise UsageError(f"{flag} needs --detections: nothing is tracked here")
    if request.coast is not None and not request.online:
        raise UsageError(
            "--coast needs --online: with hindsight tracks end where they were last seen"
        )
    if request.detections and request.file_format == "mot":
        raise UsageError("--detections are KITTI-format files; --format mot is for --tracks")
    if request.run is not None and request.file_format is not None:
        raise UsageError("a run has its own format; leave --format out")


def _score(request: TrackEvalRequest) -> TrackEvalRun:
    if request.run is not None:
        return tracks_of_run.score_run_folder(request.run, request.labels)
    if request.detections:
        return tracks_kitti.score_detections(request)
    tracks = request.tracks or request.labels  # checked: one of the three is given
    if (request.file_format or ("kitti" if tracks.is_dir() else "mot")) == "kitti":
        return tracks_kitti.score_track_files(tracks, request.labels)
    return tracks_mot.score_mot(tracks, request.labels)


def _write(folder: RunFolder, done: TrackEvalRun) -> None:
    text = json.dumps(done.document, indent=2, allow_nan=False) + "\n"
    (folder.path / "scores.json").write_text(text, encoding="utf-8")
    for name, boxes in done.tracks.items():
        (folder.path / "tracks").mkdir(exist_ok=True)
        write_kitti_tracks(folder.path / "tracks" / f"{name}.txt", boxes)
    inputs = list(dict.fromkeys(done.inputs))
    report = track_scores_report(
        done.rows,
        verdict=done.verdict,
        why=done.why,
        curves=done.curves,
        dropped=done.dropped,
        notes=done.notes,
        inputs=[describe_input(path) for path in inputs[:_MOST_INPUTS]],
        files=len(inputs),
        settings=done.config,
    )
    write_report(folder.path / "report.html", report)
    folder.finish(
        config=done.config,
        inputs=inputs,
        counts={"objects": done.objects, "tracks_files": len(done.tracks)},
        dropped=done.dropped,
        verdict=done.verdict,
        why=done.why,
        notes=done.notes,
    )
