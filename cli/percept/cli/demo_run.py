"""The run behind `percept demo`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

from percept.cli.detect.flags import model_flags, model_requests
from percept.cli.detect.request import DetectRequest
from percept.cli.detect.run import run_detection
from percept.cli.eval.lights_run import score_light_run
from percept.cli.eval.tracks_of_run import score_run_folder
from percept.cli.synth_run import make_drive
from percept.datasets import open_recording
from percept.datasets.inspection import inspect_recording
from percept.datasets.labels import read_detections, read_labels
from percept.datasets.synthetic.drive import DriveConfig
from percept.datasets.synthetic.sensor_rig import CAMERA_NAMES
from percept.evaluation import DetectionScores, score_run
from percept.evaluation.boxes_2d import BoxScoreConfig, BoxScores, score_boxes, scores_as_json
from percept.evaluation.lights import LightCounts

__all__ = ["run_demo"]

_MODEL = "small=builtin"
_LEAST_HEIGHT_PX = 10
_LEAST_VISIBLE = 0.3
_COUNTED = f"objects from {_LEAST_HEIGHT_PX} px high, at least {_LEAST_VISIBLE:.0%} of them seen"


def run_demo(out: Path, *, seed: int, seconds: float, force: bool, talk: bool) -> dict[str, Any]:
    """Make a drive, inspect it, detect on it and score the run.

    Args:
        out: Folder of the drive; the run goes into `out/run`.
        seed: Which world and drive.
        seconds: Length of the drive.
        force: Whether to write into a folder that is not empty.
        talk: Whether to say on stdout what is happening.

    Returns:
        The content of the run's `run.json`, with the scores under `scores`, `scores_2d`,
        `scores_tracks` and `scores_lights`.
    """

    def say(text: str) -> None:
        if talk:
            typer.echo(text)

    say(f"1. a drive of {seconds:g} s through a synthetic street -> {out}")
    config = DriveConfig(seed=seed, seconds=seconds, cameras=CAMERA_NAMES)
    drive = make_drive(out, config, "mcap", force=force)
    say(f"   {drive['counts']['messages']} messages of {len(drive['counts']['topics'])} topics")
    log = out / "drive.mcap"
    with open_recording(log) as recording:
        inspection = inspect_recording(recording)
    say(f"2. percept inspect {log}: verdict {inspection.verdict}")
    run_folder = out / "run"
    models = model_requests([_MODEL], [])
    rig, map_file = out / "rig.yaml", out / "map.osm"
    say(
        f"3. percept detect --bag {log} --rig {rig} --map {map_file} --model {_MODEL} "
        f"--out {run_folder} --mcap"
    )
    request = DetectRequest(
        bags=(log,), out=run_folder, rig=rig, models=models, map_file=map_file,
        flags={"models": model_flags([model.name for model in models])}, overlay=True, force=force,
    )  # fmt: skip
    run = run_detection(request)
    counts = run["counts"]
    say(
        f"   {counts['frames']} scans, {counts['objects']} boxes; {counts['images']} images; "
        f"{sum(counts['tracks'].values())} tracks; {counts['lights']} lights; "
        f"verdict {run['verdict']}"
    )
    scores = score_run(run_folder, out / "truth")
    say("4. against truth (objects with at least 10 returns; +class: the class is right too)")
    say(str(scores))
    in_images = _score_images(run_folder, out / "truth")
    say(f"5. boxes in images against truth ({_COUNTED})")
    say(_as_text(in_images))
    tracks = score_run_folder(run_folder, out / "truth")
    say("6. tracks against truth (pairs within 2 m, of the same class)")
    say(_tracks_as_text(tracks.rows))
    lights = score_light_run(run_folder, out / "truth").total
    say("7. traffic lights against truth, at the moments at which a camera sees them")
    say(_lights_as_text(lights))
    say(f"look at it: {run_folder / 'report.html'}, or `percept view {run_folder}`")
    return {
        **run,
        "scores": _as_dict(scores),
        "scores_2d": scores_as_json(in_images),
        "scores_tracks": tracks.document,
        "scores_lights": lights.document(),
    }


def _score_images(run_folder: Path, truth_folder: Path) -> BoxScores:
    truth = read_labels(truth_folder, "parquet")
    found = read_detections(run_folder, "parquet", truth)
    counted = BoxScoreConfig(min_height_px=_LEAST_HEIGHT_PX, min_visible=_LEAST_VISIBLE)
    return score_boxes(truth, found, counted)


def _as_text(scores: BoxScores) -> str:
    rows = [("all", scores.counts, scores.average)]
    rows += [(score.label, score.counts, score.average) for score in scores.classes]
    lines = [f"   {'class':<14} {'objects':>8} {'recall':>7} {'precision':>10} {'AP50':>6}"]
    lines += [
        f"   {label:<14} {counts.objects:>8} {_figure(counts.recall):>7} "
        f"{_figure(counts.precision):>10} {_figure(average.ap50):>6}"
        for label, counts, average in rows
        if counts.objects
    ]
    return "\n".join(lines)


def _tracks_as_text(rows: Mapping[str, Mapping[str, float | None]]) -> str:
    lines = [f"   {'class':<14} {'objects':>8} {'MOTA':>6} {'IDF1':>6} {'switches':>9} {'m/s':>6}"]
    for label, found in sorted(rows.items(), key=lambda row: row[0] != "all"):
        objects, switches = found["num_objects"], found["num_switches"]
        mota, idf1, speed = (_figure(found[key]) for key in ("mota", "idf1", "velocity_rmse_mps"))
        lines.append(f"   {label:<14} {objects:>8} {mota:>6} {idf1:>6} {switches:>9} {speed:>6}")
    return "\n".join([*lines, "   (m/s: rmse of the velocity)"])


def _lights_as_text(lights: LightCounts) -> str:
    return (
        f"   {lights.moments} moments: {lights.right} right, {lights.unknown} unknown, "
        f"{lights.unreported} not reported, {lights.wrong} wrong, "
        f"{lights.red_as_green} red read as green"
    )


def _as_dict(scores: DetectionScores) -> dict[str, Any]:
    labels = sorted({m.truth for m in scores.matches if m.truth is not None})
    return {
        "recall": scores.recall(),
        "by_class": {
            label: {
                "recall": scores.recall(label),
                "recall_same_class": scores.recall(label, same_class=True),
                "precision_same_class": _or_none(scores.precision(label, same_class=True)),
            }
            for label in labels
        },
    }


def _figure(value: float | None) -> str:
    return "-" if value is None or math.isnan(value) else f"{value:.2f}"


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value
