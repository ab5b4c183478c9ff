"""The run behind `percept eval detections`: from two sets of files to scores and a report."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from percept.cli.progress import progress_bar
from percept.cli.run_folder import RunFolder, describe_input
from percept.core.errors import UsageError
from percept.core.labels import LabelSet
from percept.core.settings import load_settings
from percept.datasets.labels import LabelFormat, label_format, read_detections, read_labels
from percept.evaluation.boxes_2d import BoxScoreConfig, BoxScores, score_boxes, scores_as_json
from percept.export.evaluation_report import box_scores_report
from percept.export.report import write_report

__all__ = ["EvalRequest", "EvalRun", "run_eval"]

_OUTPUTS = ("scores.json", "report.html")
_MOST_INPUTS = 20
_SIZE = re.compile(r"(\d{1,6})x(\d{1,6})")


@dataclass(frozen=True, slots=True, kw_only=True)
class EvalRequest:
    """What the command line asked for; see the options of `percept eval detections`.

    A format of None is told by looking at the files.
    """

    detections: Path
    labels: Path
    detections_format: str | None
    labels_format: str | None
    model: str | None
    image_size: str | None
    flags: Mapping[str, Any]
    config: Path | None
    out: Path | None
    force: bool


@dataclass(frozen=True, slots=True, eq=False)
class EvalRun:
    """What a run came to: the scores, and the document that `--json` prints."""

    scores: BoxScores
    document: dict[str, Any]


def run_eval(request: EvalRequest) -> EvalRun:
    """Read both sides, score them, and fill the run folder where one is wanted.

    Raises:
        PerceptError: If the input, a setting or the folder cannot be used.
    """
    config = load_settings(BoxScoreConfig, request.config, dict(request.flags))
    size = _image_size(request.image_size)
    with ExitStack() as stack:
        folder = None
        if request.out is not None:
            folder = RunFolder(request.out, force=request.force, outputs=_OUTPUTS)
            stack.enter_context(folder)
        with progress_bar("scoring", None):
            truth, found, formats = _read(request, size)
            scores = score_boxes(truth, found, config)
        document = {**formats, **scores_as_json(scores)}
        if folder is not None:
            folder.begin()
            _write(folder, config, (*found.files, *truth.files), scores, document)
    return EvalRun(scores, document)


def _read(
    request: EvalRequest, size: tuple[int, int] | None
) -> tuple[LabelSet, LabelSet, dict[str, str]]:
    ours = cast("LabelFormat", request.labels_format or label_format(request.labels))
    theirs = cast("LabelFormat", request.detections_format or label_format(request.detections))
    truth = read_labels(request.labels, ours, image_size=size)
    found = read_detections(request.detections, theirs, truth, image_size=size, model=request.model)
    return truth, found, {"detections_format": theirs, "labels_format": ours}


def _image_size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = _SIZE.fullmatch(text)
    if found is None or not all(int(side) for side in found.groups()):
        raise UsageError(f"--image-size '{text}' is not of the form WxH, such as 1242x375")
    return int(found[1]), int(found[2])


def _write(
    folder: RunFolder,
    config: BoxScoreConfig,
    files: Iterable[Path],
    scores: BoxScores,
    document: Mapping[str, Any],
) -> None:
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    (folder.path / "scores.json").write_text(text, encoding="utf-8")
    inputs = list(dict.fromkeys(files))
    settings = config.model_dump(mode="json")
    report = box_scores_report(
        scores,
        inputs=[describe_input(path) for path in inputs[:_MOST_INPUTS]],
        files=len(inputs),
        settings=settings,
    )
    write_report(folder.path / "report.html", report)
    folder.finish(
        config=settings,
        inputs=inputs,
        counts={key: document[key] for key in ("images", "objects", "detections")},
        dropped=scores.dropped,
        verdict=scores.verdict,
        why=scores.why,
    )
