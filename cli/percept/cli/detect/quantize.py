"""`percept detect quantize`: a network in 8-bit integers, measured against itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from percept.cli.options import JsonOption

__all__ = ["quantize"]


def quantize(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL",
            help="A YOLO network in ONNX, or the word `builtin`: the detector that ships.",
            show_default=False,
        ),
    ],
    *,
    calibration: Annotated[
        Path,
        typer.Option(
            "--calibration",
            metavar="LOG",
            help="A log, or a folder of images, of the kind that the network is for.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE.onnx", help="Default: MODEL_int8.onnx, right here."),
    ] = None,
    images: Annotated[
        int,
        typer.Option("--images", min=1, help="Images to take the ranges of values from."),
    ] = 64,
    classes: Annotated[
        Path | None,
        typer.Option("--classes", help="Class names, one a line or YAML, where it has none."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace --out if it exists.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Make a network smaller and faster on processors, and measure what that costs.

    Its convolutions then work on 8-bit integers. Images from all over the log tell the ranges of
    values; as many again by half, which it has not seen, tell how far both networks agree and how
    fast they are. The file is written where that is good or doubtful; the command ends with 4
    where it is bad.

    Example: percept demo --out demo && percept detect quantize builtin
    --calibration demo/drive.mcap --out small_int8.onnx
    """
    from percept.cli.detect.quantize_run import QuantizeRequest, run_quantization

    request = QuantizeRequest(
        model=model, calibration=calibration, out=out, images=images, classes=classes, force=force
    )
    run = run_quantization(request)
    if as_json:
        typer.echo(json.dumps(run, indent=2))
    else:
        _show(run)
    raise typer.Exit(run["exit_code"])


def _show(run: dict[str, Any]) -> None:
    found, size = run["agreement"], run["bytes"]
    kept = ", ".join(f"{count} {why}" for why, count in run["layers"]["kept"].items())
    rows = [
        f"layers     {run['layers']['quantized']} in integers; as they were: {kept or 'none'}",
        f"images     {run['images']['calibration']} for the ranges, {found['images']} to compare",
        f"boxes      {found['boxes_float']} before, {found['boxes_int8']} after; "
        f"{found['share_iou_50']:.1%} agree at IoU 0.5, {found['share_iou_75']:.1%} at 0.75",
        f"confidence {found['confidence_shift']:+.3f} in the mean, "
        f"95 of 100 change by less than {found['confidence_change_p95']:.3f}",
        f"speed      {found['speed']:.2f} times as fast on one core "
        f"({found['ms_float']:.1f} ms before, {found['ms_int8']:.1f} ms after)",
        f"size       {size['int8'] / 1e6:.2f} MB, before {size['float'] / 1e6:.2f} MB",
    ]
    for row in rows:
        typer.echo(row)
    for reason, count in run["dropped"].items():
        typer.echo(f"left out: {count} {reason}", err=True)
    for note in run["notes"]:
        typer.echo(f"mind: {note}", err=True)
    why = f": {'; '.join(run['why'])}" if run["why"] else ""
    typer.echo(f"verdict: {run['verdict']}{why}")
    typer.echo(run["out"] or "no file was written")
