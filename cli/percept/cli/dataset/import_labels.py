"""`percept dataset import`: labels that people corrected in a tool, back as tables."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.options import ForceOption, JsonOption, OutOption

__all__ = ["import_labels"]


class _Format(StrEnum):
    AUTO = "auto"
    COCO = "coco"
    YOLO = "yolo"
    KITTI = "kitti"
    CVAT = "cvat"
    LABEL_STUDIO = "label-studio"


def import_labels(
    labels: Annotated[
        Path,
        typer.Argument(
            metavar="LABELS",
            help="What the tool wrote, unpacked: a COCO file, a folder of YOLO or KITTI, CVAT's "
            "annotations.xml, or Label Studio's JSON.",
            show_default=False,
        ),
    ],
    *,
    of: Annotated[
        Path,
        typer.Option(
            "--of",
            metavar="DIR",
            help="The folder of `percept dataset prepare` that was given to the labellers.",
            show_default=False,
        ),
    ],
    out: OutOption,
    file_format: Annotated[
        _Format, typer.Option("--format", help="Format of the labels; auto looks at the files.")
    ] = _Format.AUTO,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Bring corrected labels back into the tables of a data set.

    Writes a folder with the tables of DIR, without its images: for each image that the labels
    have, the boxes that they say. What the format cannot hold, such as numbers of tracks and
    networks, is taken from DIR where a box is one of its. Images that the labels do not have
    are left out and counted; those that DIR does not have are named. DIR is not changed.

    Example: percept demo --out demo && percept dataset prepare --run demo/run --format coco
    --out set && percept dataset import set/coco --of set --out back
    """
    from percept.cli.dataset.import_run import ImportRequest, run_import

    run = run_import(
        ImportRequest(
            labels=labels,
            of=of,
            out=out,
            label_format=None if file_format is _Format.AUTO else file_format.value,
            force=force,
        )
    )
    if as_json:
        typer.echo(json.dumps(run, indent=2, allow_nan=False))
        return
    counts = run["counts"]
    typer.echo(
        f"{counts['boxes_2d']:,} 2D and {counts['boxes_3d']:,} 3D boxes in {counts['images']:,} "
        f"images, from {run['config']['format']}"
    )
    for reason, number in run["dropped"].items():
        typer.echo(f"left out: {number:,} {reason}")
    for note in run.get("notes", ()):
        typer.echo(f"note: {note}")
    typer.echo(f"verdict: {run['verdict']}")
    for reason in run["why"]:
        typer.echo(f"  - {reason}")
    typer.echo(f"what changed: percept dataset diff {of} {out} --out CHANGES")
