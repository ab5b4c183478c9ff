"""`percept eval detections`: 2D boxes against labels."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.options import ConfigOption, ForceOption, JsonOption, named_values

__all__ = ["detections"]


class _Format(StrEnum):
    AUTO = "auto"
    COCO = "coco"
    YOLO = "yolo"
    KITTI = "kitti"
    CVAT = "cvat"
    LABEL_STUDIO = "label-studio"
    PARQUET = "parquet"


def detections(
    *,
    detections: Annotated[
        Path,
        typer.Option(
            "--detections",
            help="What was found: a run folder of percept detect, a COCO file of results, a "
            "folder of YOLO or KITTI files with confidences, or a table of boxes.",
            show_default=False,
        ),
    ],
    labels: Annotated[
        Path,
        typer.Option(
            "--labels",
            help="What is there: the truth folder of a synthetic drive, a COCO file of "
            "instances, a YOLO data set, KITTI's label_2, CVAT's annotations.xml, or Label "
            "Studio's JSON.",
            show_default=False,
        ),
    ],
    file_format: Annotated[
        _Format, typer.Option("--format", help="Format of both; auto looks at the files.")
    ] = _Format.AUTO,
    labels_format: Annotated[
        _Format | None,
        typer.Option("--labels-format", help="Format of the labels, where it is another."),
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            "--model", metavar="NAME", help="The network to score, of a run with several."
        ),
    ] = None,
    rename: Annotated[
        list[str] | None,
        typer.Option(
            "--map",
            metavar="OLD=NEW",
            help="Take a class of the labels or the detections for another. Repeat it for several.",
        ),
    ] = None,
    iou: Annotated[
        float | None,
        typer.Option("--iou", help="Overlap from which a detection is an object. [default: 0.5]"),
    ] = None,
    score: Annotated[
        float | None,
        typer.Option(
            "--score",
            help="Confidence from which a detection counts in precision and recall. AP takes "
            "all. [default: 0.25]",
        ),
    ] = None,
    min_height: Annotated[
        float | None,
        typer.Option("--min-height", metavar="PX", help="Lower objects do not count."),
    ] = None,
    min_visible: Annotated[
        float | None,
        typer.Option(
            "--min-visible",
            metavar="SHARE",
            help="Objects of which the labels say that less can be seen do not count.",
        ),
    ] = None,
    image_size: Annotated[
        str | None,
        typer.Option(
            "--image-size",
            metavar="WxH",
            help="Size of the images of YOLO files that are not beside them.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Run folder with scores.json and report.html; new or empty."),
    ] = None,
    config: ConfigOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Score 2D detections against labels, by the rules of COCO.

    Prints AP50, AP75 and AP, and precision, recall and F1 at one threshold, by class, size and
    distance; what is taken for what; and how far the figures can be trusted. Labels and
    detections may have different formats. Ends with 4 when there is no object to find.

    Example: percept demo --out demo && percept eval detections --detections demo/run
    --labels demo/truth
    """
    from percept.cli.eval.detections_run import EvalRequest, run_eval
    from percept.cli.eval.detections_table import show_scores

    run = run_eval(
        EvalRequest(
            detections=detections,
            labels=labels,
            detections_format=None if file_format is _Format.AUTO else file_format.value,
            labels_format=_labels_format(labels_format, file_format),
            model=model,
            image_size=image_size,
            flags={
                "label_map": named_values(rename or [], "--map") or None,
                "iou": iou,
                "score": score,
                "min_height_px": min_height,
                "min_visible": min_visible,
            },
            config=config,
            out=out,
            force=force,
        )
    )
    if as_json:
        typer.echo(json.dumps(run.document, indent=2, allow_nan=False))
    else:
        show_scores(run.scores, out)
    raise typer.Exit(run.scores.verdict.exit_code)


def _labels_format(given: _Format | None, both: _Format) -> str | None:
    chosen = given or both
    return None if chosen is _Format.AUTO else chosen.value
