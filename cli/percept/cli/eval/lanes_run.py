"""The run behind `percept eval lanes`: from what was seen and what is there to scores."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from percept.cli.run_folder import RunFolder, describe_input
from percept.core.errors import InputError
from percept.evaluation.lane_files import (
    is_tusimple,
    lanes_of_documents,
    masks_in,
    named_alike,
    read_documents,
    read_mask_lanes,
    seen_frames,
    tusimple_lanes,
)
from percept.evaluation.lane_pixels import PixelLaneScores, score_pixel_lanes
from percept.evaluation.lane_scores import RoadLaneScores
from percept.evaluation.lanes import score_road_lanes
from percept.evaluation.road_truth import read_road_markings
from percept.evaluation.runs import read_poses
from percept.export.lane_evaluation_report import lane_scores_report
from percept.export.report import write_report

__all__ = ["LaneEvalRequest", "run_lane_eval"]

_MARKINGS, _POSES = "markings.geojson", "poses.parquet"
_RESULTS = "lanes.json"
_OUTPUTS = ("scores.json", "report.html")

Scores = RoadLaneScores | PixelLaneScores


@dataclass(frozen=True, slots=True, kw_only=True)
class LaneEvalRequest:
    """What the command line asked for; see the options of `percept eval lanes`."""

    results: Path
    truth: Path
    out: Path | None
    force: bool


def run_lane_eval(request: LaneEvalRequest) -> tuple[Scores, dict[str, Any]]:
    """Read both sides, score, and fill the run folder where one is wanted.

    Returns:
        The scores, and the document that `--json` prints.

    Raises:
        PerceptError: If a file or the folder cannot be used.
    """
    results = _results_file(request.results)
    with ExitStack() as stack:
        out = None
        if request.out is not None:
            out = RunFolder(request.out, force=request.force, outputs=_OUTPUTS)
            stack.enter_context(out)
        road = _road_folder(request.truth)
        scores: Scores
        if road is not None:
            labels = [road / _MARKINGS, road / _POSES]
            scores = _score_road(results, road)
        else:
            labels = _label_files(request.truth)
            scores = _score_pixels(results, labels)
        document = scores.document()
        if out is not None:
            out.begin([results, *labels])
            _write(out, scores, document, [results, *labels])
    return scores, document


def _results_file(results: Path) -> Path:
    return results / _RESULTS if results.is_dir() else results


def _road_folder(truth: Path) -> Path | None:
    """Return the truth folder of a synthetic drive, or None where labels are in pixels."""
    for folder in (truth, truth / "truth"):
        if (folder / _MARKINGS).is_file():
            return folder
    return None


def _label_files(truth: Path) -> list[Path]:
    files = masks_in(truth)
    if not files:
        raise InputError(
            f"is neither a synthetic drive ({_MARKINGS}) nor a folder of PNG masks", where=truth
        )
    return files


def _score_road(results: Path, road: Path) -> RoadLaneScores:
    frames = seen_frames(read_documents(results), results)
    markings = read_road_markings(road / _MARKINGS)
    return score_road_lanes(frames, markings, read_poses(road / _POSES))


def _score_pixels(results: Path, labels: list[Path]) -> PixelLaneScores:
    widths: dict[str, int] = {}
    if labels[0].suffix.lower() == ".png":
        truth, widths = read_mask_lanes(labels)
    else:
        truth = tusimple_lanes(read_documents(labels[0]), labels[0])
    documents = read_documents(results)
    read = tusimple_lanes if is_tusimple(documents) else lanes_of_documents
    return score_pixel_lanes(named_alike(read(documents, results), truth), truth, widths)


def _write(folder: RunFolder, scores: Scores, document: dict[str, Any], inputs: list[Path]) -> None:
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    (folder.path / "scores.json").write_text(text, encoding="utf-8")
    report = lane_scores_report(scores, inputs=[describe_input(path) for path in inputs])
    write_report(folder.path / "report.html", report)
    images = scores.frames if isinstance(scores, RoadLaneScores) else len(scores.by_image)
    folder.finish(
        config={},
        inputs=inputs,
        counts={"images": images},
        dropped=scores.dropped,
        verdict=scores.verdict,
        why=scores.why,
    )
