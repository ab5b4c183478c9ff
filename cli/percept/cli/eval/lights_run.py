"""The run behind `percept eval lights`: from two tables to scores and a report."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from percept.cli.run_folder import RunFolder, describe_input
from percept.evaluation.lights import LightScores, score_lights
from percept.export.image_table import IMAGES_2D
from percept.export.light_evaluation_report import light_scores_report
from percept.export.light_table import read_lights
from percept.export.report import write_report
from percept.export.table_reader import read_batches

__all__ = ["LightEvalRequest", "run_light_eval", "score_light_run"]

_LIGHTS, _IMAGES = "lights.parquet", "images_2d.parquet"
_STAMPS = pa.schema([IMAGES_2D.field("stamp_ns")])
_OUTPUTS = ("scores.json", "report.html")


@dataclass(frozen=True, slots=True, kw_only=True)
class LightEvalRequest:
    """What the command line asked for; see the options of `percept eval lights`."""

    run: Path
    labels: Path
    out: Path | None
    force: bool


def run_light_eval(request: LightEvalRequest) -> tuple[LightScores, dict[str, Any]]:
    """Read both sides, score, and fill the run folder where one is wanted.

    Returns:
        The scores, and the document that `--json` prints.

    Raises:
        PerceptError: If a table or the folder cannot be used, or the run was made without a map.
    """
    truth = _truth_table(request.labels)
    found, images = request.run / _LIGHTS, request.run / _IMAGES
    with ExitStack() as stack:
        out = None
        if request.out is not None:
            out = RunFolder(request.out, force=request.force, outputs=_OUTPUTS)
            stack.enter_context(out)
        scores = score_light_run(request.run, request.labels)
        document = _document(scores)
        if out is not None:
            out.begin()
            _write(out, scores, document, [p for p in (found, images, truth) if p.is_file()])
    return scores, document


def score_light_run(run: Path, labels: Path) -> LightScores:
    """Score the lights of a run folder against the truth of a drive.

    Raises:
        InputError: If a table cannot be used, or the run was made without a map.
    """
    truth, found = _truth_table(labels), run / _LIGHTS
    return score_lights(read_lights(truth), read_lights(found), _stamps(run / _IMAGES))


def _truth_table(labels: Path) -> Path:
    folder = labels / "truth"
    return (folder if folder.is_dir() else labels) / _LIGHTS


def _stamps(images: Path) -> list[int] | None:
    """Return the stamps of the images of a run, or None of one that has no table of them."""
    if not images.is_file():
        return None
    batches = read_batches(images, _STAMPS)
    return sorted({stamp for batch in batches for stamp in batch.column("stamp_ns").to_pylist()})


def _document(scores: LightScores) -> dict[str, Any]:
    return {
        "lights": len(scores.by_light),
        **scores.total.document(),
        "by_light": {str(light): one.document() for light, one in scores.by_light.items()},
        "verdict": str(scores.verdict),
        "why": list(scores.why),
        "dropped": dict(scores.dropped),
    }


def _write(
    folder: RunFolder, scores: LightScores, document: dict[str, Any], inputs: list[Path]
) -> None:
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    (folder.path / "scores.json").write_text(text, encoding="utf-8")
    report = light_scores_report(scores, inputs=[describe_input(path) for path in inputs])
    write_report(folder.path / "report.html", report)
    folder.finish(
        config={},
        inputs=inputs,
        counts={"lights": len(scores.by_light), "moments": scores.total.moments},
        dropped=scores.dropped,
        verdict=scores.verdict,
        why=scores.why,
    )
