"""`percept dataset diff`: what changed between two labellings of the same images."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.options import ConfigOption, ForceOption, JsonOption, OutOption

__all__ = ["diff"]


def diff(
    a: Annotated[
        Path,
        typer.Argument(
            metavar="A",
            help="The first labelling: a folder of `percept dataset prepare` or `import`.",
            show_default=False,
        ),
    ],
    b: Annotated[
        Path,
        typer.Argument(
            metavar="B",
            help="The second, such as what `percept dataset import` made of corrected labels.",
            show_default=False,
        ),
    ],
    *,
    out: OutOption,
    iou: Annotated[
        float | None,
        typer.Option(
            "--iou",
            help="Overlap from which a box of A with the right class counts as right in precision "
            "and recall. [default: 0.5]",
        ),
    ] = None,
    config: ConfigOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Say what changed from one labelling to another, box by box.

    Boxes are paired one to one: by place, by their numbers where these survived, and by overlap.
    Each is unchanged (no side moved by 0.5 px), moved, relabelled, added or removed. Precision and
    recall of A against B are the detector's where B is what people made of A. Writes
    diff.parquet, diff_3d.parquet, diff.json and report.html with pictures of the changes.

    Example: percept demo --out demo && percept dataset prepare --run demo/run --format coco
    --out set && percept dataset import set/coco --of set --out back
    && percept dataset diff set back --out changes
    """
    from percept.cli.dataset.diff_run import DiffRequest, run_diff
    from percept.cli.dataset.diff_table import show_diff

    run = run_diff(DiffRequest(a=a, b=b, out=out, flags={"iou": iou}, config=config, force=force))
    if as_json:
        typer.echo(json.dumps(run.document, indent=2, allow_nan=False))
    else:
        show_diff(run, out)
    raise typer.Exit(run.verdict.exit_code)
