"""The run behind `percept demo`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import typer

from percept.cli.detect_run import DetectRequest, run_detection
from percept.cli.synth_run import make_drive
from percept.datasets import open_recording
from percept.datasets.inspection import inspect_recording
from percept.datasets.synthetic.drive import DriveConfig
from percept.evaluation import DetectionScores, score_run

__all__ = ["run_demo"]


def run_demo(out: Path, *, seed: int, seconds: float, force: bool, talk: bool) -> dict[str, Any]:
    """Make a drive, inspect it, detect on it and score the run.

    Args:
        out: Folder of the drive; the run goes into `out/run`.
        seed: Which world and drive.
        seconds: Length of the drive.
        force: Whether to write into a folder that is not empty.
        talk: Whether to say on stdout what is happening.

    Returns:
        The content of the run's `run.json`, with the scores under `scores`.
    """

    def say(text: str) -> None:
        if talk:
            typer.echo(text)

    say(f"1. a drive of {seconds:g} s through a synthetic street -> {out}")
    drive = make_drive(out, DriveConfig(seed=seed, seconds=seconds), "mcap", force=force)
    say(f"   {drive['counts']['messages']} messages of {len(drive['counts']['topics'])} topics")
    log = out / "drive.mcap"
    with open_recording(log) as recording:
        inspection = inspect_recording(recording)
    say(f"2. percept inspect {log}: verdict {inspection.verdict}")
    run_folder = out / "run"
    say(f"3. percept detect --bag {log} --rig {out / 'rig.yaml'} --out {run_folder} --mcap")
    request = DetectRequest(
        bags=(log,), out=run_folder, rig=out / "rig.yaml", topics={}, flags={}, overlay=True,
        force=force,
    )  # fmt: skip
    run = run_detection(request)
    counts = run["counts"]
    say(f"   {counts['frames']} scans, {counts['objects']} boxes, verdict {run['verdict']}")
    scores = score_run(run_folder, out / "truth")
    say("4. against truth (objects with at least 10 returns; +class: the class is right too)")
    say(str(scores))
    say(f"look at it: {run_folder / 'report.html'}, or `percept view {run_folder}`")
    return {**run, "scores": _as_dict(scores)}


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


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value
